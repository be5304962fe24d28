//! Keys of the lists: the contours, and the jobs of the shop.
//!
//! Invariant: a list decides what its keys mean; here they only open, close and send.

use super::{KeyState, OpenDialog};
use crate::contour_page::{self, ContourChoice, ContourMark};
use crate::keys::Key;
use crate::model::ScreenModel;
use crate::pending_question::PendingQuestion;
use crate::shop_job_page::{self, ShopJobChoice, ShopJobMark};
use crate::ui_command::UiCommand;

impl KeyState {
    /// Handles a key while the contours are shown.
    pub(super) fn key_in_contours(
        &mut self,
        key: Key,
        mark: ContourMark,
        ms: u64,
        model: &ScreenModel,
    ) -> Option<UiCommand> {
        if let Some(mark) = contour_page::moved(model, mark, key) {
            self.open = OpenDialog::Contours(mark);
            return None;
        }
        let at = mark.chosen;
        if matches!(key, Key::Char('n' | 'N')) {
            // The list stays open: several are skipped at a time.
            match contour_page::skip(model, at) {
                ContourChoice::Send(command) => return Some(command),
                ContourChoice::Refuse(why) => self.show_notice(why, ms),
                ContourChoice::Start(_) => {}
            }
            return None;
        }
        self.open = OpenDialog::Nothing;
        if key == Key::Enter {
            match contour_page::choice(model, at) {
                ContourChoice::Send(command) => return Some(command),
                ContourChoice::Start(number) => {
                    self.open = OpenDialog::Prompt(PendingQuestion::StartContour(number), String::new(), None);
                }
                ContourChoice::Refuse(why) => self.show_notice(why, ms),
            }
        }
        None
    }

    /// Handles a key while the jobs of the shop are shown.
    pub(super) fn key_in_shop_jobs(
        &mut self,
        key: Key,
        mark: &ShopJobMark,
        ms: u64,
        model: &ScreenModel,
    ) -> Option<UiCommand> {
        match shop_job_page::choice(model, mark, key) {
            ShopJobChoice::Show(mark) => self.open = OpenDialog::ShopJobs(mark),
            ShopJobChoice::Refuse(why) => self.show_notice(why, ms),
            ShopJobChoice::Close => self.open = OpenDialog::Nothing,
            ShopJobChoice::Start(id, pieces) => {
                self.open = OpenDialog::Nothing;
                return Some(UiCommand::StartShopJob { id, pieces });
            }
        }
        None
    }
}
