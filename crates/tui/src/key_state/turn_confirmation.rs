//! Whether the operator knows that the work coordinates are turned.
//!
//! Invariant: a turn is confirmed by who has set it, or has answered for it, since the last job was released; one of an
//! earlier job, whose sheet may lie no more, is not.

use crate::model::ScreenModel;

/// The turn that is confirmed, in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct TurnConfirmation {
    confirmed_deg: Option<f64>,
    /// The turn before the one that is being set.
    before_deg: Option<f64>,
}

impl TurnConfirmation {
    /// The turn that follows is set by the operator.
    pub(super) const fn begin_to_set(&mut self, model: &ScreenModel) {
        self.before_deg = Some(model.work_rotation_deg);
    }

    /// The operator answers for the turn in force.
    pub(super) const fn confirm(&mut self, model: &ScreenModel) {
        self.confirmed_deg = Some(model.work_rotation_deg);
    }

    /// The job is released: what lies on the table next may lie otherwise.
    pub(super) const fn forget(&mut self) {
        *self = Self { confirmed_deg: None, before_deg: None };
    }

    /// Whether a program may start without a question: it is not turned, or the turn is confirmed.
    pub(super) fn is_confirmed(&mut self, model: &ScreenModel) -> bool {
        let turn = model.work_rotation_deg;
        if self.before_deg.take().is_some_and(|before| before != turn) {
            self.confirm(model);
        }
        turn == 0.0 || self.confirmed_deg == Some(turn)
    }
}
