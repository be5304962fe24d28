//! Key state: turns keys into operator commands.
//!
//! Invariant: a pure function of key, time and model. Space is feed hold whatever dialog is open, except while a line
//! is typed where nothing runs: there it is a blank.

mod jog_keys;
mod list_keys;
mod turn_confirmation;

use retrace_controller::{CutStart, FrameShape, HeightCommand, ManualTask, OperatorCommand};
use retrace_core::Rate;
use retrace_core::mode::Mode;
use retrace_link::channel;

use crate::contour_page::ContourMark;
use crate::files;
use crate::keys::{self, Key, KeyAction, Situation};
use crate::model::{ScreenModel, ScreenStage};
use crate::pending_question::PendingQuestion;
use crate::prompt_answer::answer;
use crate::shop_job_page::{self, ShopJobMark};
use crate::ui_command::UiCommand;
pub(crate) use jog_keys::JogStep;
use jog_keys::{HeldKeys, JOG_STEPS};
use turn_confirmation::TurnConfirmation;

/// Dialog over the screen.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum OpenDialog {
    /// No dialog.
    #[default]
    Nothing,
    /// List of keys, with the page number; pages wrap around.
    Help(usize),
    /// The tool table.
    Tools,
    /// The contours, with the number of the one that was marked.
    Contours(ContourMark),
    /// The jobs of the shop.
    ShopJobs(ShopJobMark),
    /// All messages, with the number of lines scrolled back.
    Messages(usize),
    /// Prompt: question, text typed so far, and the error in it.
    Prompt(PendingQuestion, String, Option<String>),
}

/// View of the drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum View {
    /// From above.
    Xy,
    /// From the front.
    Xz,
    /// From the side.
    Yz,
    /// From a corner.
    Iso,
    /// A lathe from above: Z to the right, X up.
    Zx,
}

impl View {
    /// The view in which the most of a program is seen: that of a lathe without a Y axis, and from the front where the
    /// path goes up and down and not to the back.
    fn of(model: &ScreenModel) -> Self {
        let [has_x, has_y, has_z] = model.facts.space().map(|axis| axis.is_some());
        let span = model.facts.preview.path.extent().map(|[least, most]| [0, 1, 2].map(|i| most[i] - least[i]));
        match span {
            _ if has_x && has_z && !has_y => Self::Zx,
            Some([_, 0.0, up]) if up > 0.0 => Self::Xz,
            _ => Self::Xy,
        }
    }

    /// The view after this one.
    const fn next(self) -> Self {
        match self {
            Self::Xy => Self::Xz,
            Self::Xz => Self::Yz,
            Self::Yz => Self::Iso,
            Self::Iso => Self::Zx,
            Self::Zx => Self::Xy,
        }
    }
}

/// Region that the drawing shows at zoom 1 without pan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Fit {
    /// Path of the program, and the tool.
    #[default]
    Program,
    /// Table: the volume inside the soft limits, and the path.
    Table,
}

/// Frame of the drawing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frame {
    /// Region that it is fitted to.
    pub fit: Fit,
    /// Zoom relative to the fitted drawing, 1 to [`MAX_ZOOM`].
    pub zoom: f64,
    /// Offset of the centre from that of the fitted drawing, across and up, as fractions of the fitted drawing.
    pub pan: [f64; 2],
}

/// Maximum zoom.
pub(crate) const MAX_ZOOM: f64 = 256.0;

impl Default for Frame {
    fn default() -> Self {
        Self { fit: Fit::default(), zoom: 1.0, pan: [0.0; 2] }
    }
}

impl Frame {
    /// Multiplies the zoom by a factor.
    fn zoom_by(&mut self, factor: f64) {
        self.zoom = (self.zoom * factor).clamp(1.0, MAX_ZOOM);
        self.pan_by([0.0; 2]);
    }

    /// Pans by fractions of the visible region. The view stays within the fitted drawing.
    fn pan_by(&mut self, shares: [f64; 2]) {
        let most = 0.5 - 0.5 / self.zoom;
        for (pan, share) in self.pan.iter_mut().zip(shares) {
            *pan = (*pan + share / self.zoom).clamp(-most, most);
        }
    }
}

/// Rates that repeated presses of a key select, in per cent.
const RATES: [i64; 4] = [100, 50, 25, 10];

/// Maximum number of lines that the messages can be scrolled back.
const MAX_SCROLL: usize = 2_000;

/// Duration of a notice, ms.
const NOTICE_MS: u64 = 4_000;

/// Maximum time between two arrows of a key that is held down, ms.
const REPEATED_MS: u64 = 150;

/// Steps of the rapid override, in per cent.
const RAPID_OVERRIDES: [f64; 4] = [100.0, 50.0, 25.0, 0.0];
/// Minimum and maximum of the override that keys can request, in per cent.
const OVERRIDES: [f64; 2] = [0.0, 200.0];

/// State of the keys: open dialog, view, jog settings.
#[derive(Clone, Debug, Default)]
pub(crate) struct KeyState {
    /// Open dialog.
    pub open: OpenDialog,
    /// Whether the question follows as soon as the second point on the edge of the sheet is taken.
    pub awaits_edge: bool,
    turn: TurnConfirmation,
    /// Whether the operator hid the alarm's box.
    pub alarm_aside: bool,
    /// View of the drawing, once the operator has chosen one.
    view: Option<View>,
    /// Frame of the drawing.
    pub frame: Frame,
    /// Index of the jog step.
    pub step: usize,
    /// Index of the selected axis.
    pub axis: usize,
    notice: Option<(String, u64)>,
    /// Direction, and index of the rate, that was requested last.
    last_rate: Option<(Mode, usize)>,
    last_turn: Option<(bool, u64, i32)>,
    held_keys: HeldKeys,
    /// Override that was requested last, in per cent, and when: the model may not show it yet.
    overridden: Option<(f64, u64)>,
}

/// The order for a speed override that differs by some per cent from the one in force.
fn speed_override(model: &ScreenModel, by: f64) -> OperatorCommand {
    let percent = ((model.speed_override * 10.0).round() * 10.0 + by).clamp(10.0, 200.0);
    OperatorCommand::SpeedOverride(Rate::percent(percent as i64))
}

impl KeyState {
    /// State with a jog step of 1 mm.
    #[must_use]
    pub(crate) fn new() -> Self {
        Self { step: 2, ..Self::default() }
    }

    /// View of the drawing.
    #[must_use]
    pub(crate) fn view(&self, model: &ScreenModel) -> View {
        self.view.unwrap_or_else(|| View::of(model))
    }

    /// Notice about the last key, while it is recent.
    #[must_use]
    pub(crate) fn notice(&self, now_ms: u64) -> Option<&str> {
        self.notice.as_ref().filter(|(_, until)| now_ms < *until).map(|(text, _)| text.as_str())
    }

    /// Shows a notice.
    pub(crate) fn show_notice(&mut self, text: impl Into<String>, now_ms: u64) {
        self.notice = Some((text.into(), now_ms + NOTICE_MS));
    }

    /// Handles a notch of the mouse wheel: four counts in handwheel mode, nothing otherwise.
    #[must_use]
    pub(crate) fn mouse_wheel(&mut self, forward: bool, model: &ScreenModel) -> Option<UiCommand> {
        let is_wheel = Situation::of(model) == Situation::Wheel && self.open == OpenDialog::Nothing;
        is_wheel.then_some(UiCommand::Turn(if forward { 4 } else { -4 }))
    }

    /// Open dialog, if it still applies: a question about a job closes with the job, one about the machine when a job
    /// starts.
    #[must_use]
    pub(crate) fn open(&self, model: &ScreenModel) -> &OpenDialog {
        let is_job = model.stage == ScreenStage::Job;
        match &self.open {
            OpenDialog::Prompt(PendingQuestion::Program, ..) if is_job && !model.is_at_program_end() => {
                &OpenDialog::Nothing
            }
            OpenDialog::Prompt(
                PendingQuestion::Stop | PendingQuestion::BackBy | PendingQuestion::Shift | PendingQuestion::ToolLength,
                ..,
            ) if !is_job => &OpenDialog::Nothing,
            OpenDialog::Prompt(
                PendingQuestion::Mdi
                | PendingQuestion::Probe
                | PendingQuestion::WorkZero
                | PendingQuestion::SheetPoint
                | PendingQuestion::AlignSheet
                | PendingQuestion::StartTurned
                | PendingQuestion::Frame(_)
                | PendingQuestion::StartContour(_),
                ..,
            ) if is_job => &OpenDialog::Nothing,
            OpenDialog::ShopJobs(mark) if !shop_job_page::applies(model, mark) => &OpenDialog::Nothing,
            open => open,
        }
    }

    /// Opens the question that follows the second point on the edge of the sheet.
    pub(crate) fn follow(&mut self, model: &ScreenModel) {
        self.awaits_edge &= !model.sheet_points.is_empty();
        if self.awaits_edge && model.sheet_points.len() > 1 && self.open == OpenDialog::Nothing {
            self.awaits_edge = false;
            self.open = OpenDialog::Prompt(PendingQuestion::AlignSheet, String::new(), None);
        }
    }

    /// Handles a key.
    #[must_use]
    pub(crate) fn key(&mut self, key: Key, now_ms: u64, model: &ScreenModel) -> Option<UiCommand> {
        self.follow(model);
        match model.alarm {
            None => self.alarm_aside = false,
            // An alarm closes any open dialog.
            Some(_) if !self.alarm_aside => self.open = OpenDialog::Nothing,
            Some(_) => {}
        }
        self.open = self.open(model).clone();
        let row = keys::row_of(key, Situation::of(model)).filter(|_| self.open == OpenDialog::Nothing);
        let ends_jog = !row.is_some_and(|row| row.action.jogs()) && self.held_keys.interrupt(now_ms);
        let command = self.handle_key(key, row, now_ms, model);
        // Any other key ends the jog at once, whatever it does.
        command.or(ends_jog.then_some(UiCommand::JogReleased))
    }

    /// Handles a key; `row` is its row in the key table where no dialog is open.
    fn handle_key(
        &mut self,
        key: Key,
        row: Option<&'static keys::Row>,
        now_ms: u64,
        model: &ScreenModel,
    ) -> Option<UiCommand> {
        if self.open != OpenDialog::Nothing {
            return self.key_in_box(key, now_ms, model);
        }
        if key == Key::Esc {
            self.alarm_aside = true;
            let is_refusal = model.alarm.as_ref().is_some_and(|alarm| alarm.is_refusal);
            let forgets = model.stage == ScreenStage::Setup && !model.sheet_points.is_empty();
            return is_refusal.then_some(UiCommand::CloseRefusal).or(forgets.then_some(UiCommand::ForgetSheet));
        }
        let Some(row) = row else {
            if let Some((row, when)) = keys::row_elsewhere(key) {
                self.show_notice(format!("{} ({}) works {}", row.shown, row.short, when.text()), now_ms);
            } else if key != Key::Enter && key != Key::Backspace {
                self.show_notice("this key has no function; ? shows all keys", now_ms);
            }
            return None;
        };
        self.perform(row.action, key, now_ms, model)
    }

    fn perform(&mut self, act: KeyAction, key: Key, now_ms: u64, model: &ScreenModel) -> Option<UiCommand> {
        // The next action releases a program that has come to its end.
        let is_job = model.stage == ScreenStage::Job && !model.is_at_program_end();
        let command = match act {
            KeyAction::CycleStart if !is_job && !self.turn.is_confirmed(model) => {
                self.open_dialog(act, key, model);
                return None;
            }
            KeyAction::CycleStart if !is_job => return Some(UiCommand::Start),
            KeyAction::SetUp => {
                self.turn.forget();
                return Some(UiCommand::SetUp);
            }
            KeyAction::CycleStart => OperatorCommand::CycleStart,
            KeyAction::Hold => OperatorCommand::Hold,
            KeyAction::Reverse => OperatorCommand::Reverse(self.next_rate(Mode::Reverse, model)),
            KeyAction::Forward => OperatorCommand::Forward(self.next_rate(Mode::Forward, model)),
            KeyAction::ReverseRapid => OperatorCommand::Reverse(Rate::MAX),
            KeyAction::ForwardRapid => OperatorCommand::Forward(Rate::MAX),
            KeyAction::Wheel => OperatorCommand::Wheel { counts_per_s: 0.0, seconds: 0.0 },
            KeyAction::Turn => return Some(UiCommand::Turn(self.turn(key, now_ms))),
            KeyAction::Leave => OperatorCommand::Leave { ask: false },
            KeyAction::LeaveAsk => OperatorCommand::Leave { ask: true },
            KeyAction::Agree if model.question.is_some() => return Some(UiCommand::Answer(true)),
            KeyAction::Decline if model.question.is_some() => return Some(UiCommand::Answer(false)),
            KeyAction::Decline => {
                let is_open = !model.differing_outputs.is_empty();
                let waits = "nothing is switched, and nothing moves, until you choose: r and w go back along the path";
                self.show_notice(if is_open { waits } else { "no question is open" }, now_ms);
                return None;
            }
            KeyAction::Agree if model.differing_outputs.is_empty() => {
                self.show_notice("nothing to confirm", now_ms);
                return None;
            }
            KeyAction::Agree => OperatorCommand::Confirm,
            KeyAction::BackBlock => OperatorCommand::BackToBlock,
            KeyAction::BackJet => OperatorCommand::BackToPierce,
            KeyAction::BackToCutEnd => OperatorCommand::BackToCutEnd,
            KeyAction::CutFromHere => OperatorCommand::CutFromHere(CutStart::Usual),
            KeyAction::Faster => OperatorCommand::Override(self.request_override(model, 10.0, now_ms)),
            KeyAction::Slower => OperatorCommand::Override(self.request_override(model, -10.0, now_ms)),
            KeyAction::Whole => {
                self.overridden = Some((100.0, now_ms));
                OperatorCommand::Override(Rate::ONE)
            }
            KeyAction::SpindleFaster => speed_override(model, 10.0),
            KeyAction::SpindleSlower => speed_override(model, -10.0),
            KeyAction::RapidOverride => {
                let next = RAPID_OVERRIDES.iter().find(|&&percent| percent < model.rapid_override * 100.0 - 0.5);
                OperatorCommand::RapidOverride(Rate::percent(next.unwrap_or(&100.0).round() as i64))
            }
            KeyAction::Single => OperatorCommand::Single,
            KeyAction::Pause => OperatorCommand::Pause,
            KeyAction::Park => OperatorCommand::Park,
            KeyAction::Pointer => OperatorCommand::Pointer,
            KeyAction::ChangeDone => OperatorCommand::ChangeDone,
            KeyAction::CutterOff => return Some(UiCommand::CutterOff),
            KeyAction::CutterOn => OperatorCommand::CutterOn,
            KeyAction::Recover => OperatorCommand::Recover,
            KeyAction::SkipContour => OperatorCommand::SkipContour,
            KeyAction::OptionalStop => {
                return Some(UiCommand::OptionalStop(!model.optional_stop));
            }
            KeyAction::Spindle if model.output(channel::SPINDLE) == 0 => OperatorCommand::SpindleStart,
            KeyAction::Spindle => OperatorCommand::SpindleStop,
            KeyAction::HeightUp => OperatorCommand::Height(HeightCommand::Up),
            KeyAction::HeightDown => OperatorCommand::Height(HeightCommand::Down),
            KeyAction::HeightReset => OperatorCommand::Height(HeightCommand::Reset),
            KeyAction::HeightControl => {
                let is_off = model.output(channel::HEIGHT_OFFSET) == channel::HEIGHT_STAYS;
                OperatorCommand::Height(HeightCommand::Control(is_off))
            }
            KeyAction::FollowSpindle => OperatorCommand::FollowSpindle(!model.follows_spindle),
            KeyAction::Online => OperatorCommand::Online,
            KeyAction::Jog | KeyAction::JogDown | KeyAction::JogUp => return self.jog(key, now_ms, model),
            KeyAction::ClearAlarm if model.alarm.is_none() => {
                self.show_notice("no alarm is active", now_ms);
                return None;
            }
            KeyAction::ClearAlarm if model.alarm.as_ref().is_some_and(|alarm| alarm.is_refusal) => {
                return Some(UiCommand::CloseRefusal);
            }
            KeyAction::ClearAlarm => return Some(UiCommand::Task(ManualTask::ClearAlarm)),
            // It is refused then, which says why.
            KeyAction::Frame if !model.sheet_points.is_empty() => return Some(UiCommand::Frame(FrameShape::Rectangle)),
            KeyAction::Outline if !model.sheet_points.is_empty() => return Some(UiCommand::Frame(FrameShape::Outline)),
            KeyAction::Home => return Some(UiCommand::Task(ManualTask::Home(None))),
            KeyAction::SheetEdge if model.sheet_points.len() == 1 => {
                self.awaits_edge = true;
                return Some(UiCommand::SheetPoint);
            }
            KeyAction::DryRun => {
                return Some(UiCommand::DryRun(!model.dry_run));
            }
            // Whoever is at the edge of a sheet wants to leave that first.
            KeyAction::Quit if !model.sheet_points.is_empty() => return Some(UiCommand::ForgetSheet),
            KeyAction::Quit if !is_job => return Some(UiCommand::Quit),
            _ => {
                self.open_dialog(act, key, model);
                return None;
            }
        };
        Some(UiCommand::Job(command))
    }

    /// Handles functions that send no command: dialogs and the drawing.
    fn open_dialog(&mut self, act: KeyAction, key: Key, model: &ScreenModel) {
        let ask = |ask, text: &str| OpenDialog::Prompt(ask, text.into(), None);
        self.open = match act {
            KeyAction::CycleStart => ask(PendingQuestion::StartTurned, ""),
            KeyAction::BackBy => ask(PendingQuestion::BackBy, "20"),
            KeyAction::Shift => ask(PendingQuestion::Shift, ""),
            KeyAction::Output => ask(PendingQuestion::Output, ""),
            KeyAction::Mdi => ask(PendingQuestion::Mdi, ""),
            KeyAction::Probe => ask(PendingQuestion::Probe, ""),
            KeyAction::WorkZero => ask(PendingQuestion::WorkZero, "all"),
            KeyAction::SheetEdge if model.sheet_points.is_empty() => ask(PendingQuestion::SheetPoint, ""),
            KeyAction::SheetEdge => ask(PendingQuestion::AlignSheet, ""),
            KeyAction::Frame => ask(PendingQuestion::Frame(FrameShape::Rectangle), ""),
            KeyAction::Outline => ask(PendingQuestion::Frame(FrameShape::Outline), ""),
            KeyAction::ToolLength => ask(PendingQuestion::ToolLength, ""),
            KeyAction::OpenProgram => ask(PendingQuestion::Program, ""),
            KeyAction::TestPulse => ask(PendingQuestion::TestPulse, ""),
            KeyAction::SenseTest => ask(PendingQuestion::SenseTest, ""),
            KeyAction::ConsumablesChanged => ask(PendingQuestion::ConsumablesChanged, ""),
            KeyAction::Quit => ask(PendingQuestion::Stop, ""),
            KeyAction::Help => OpenDialog::Help(0),
            KeyAction::Tools => OpenDialog::Tools,
            KeyAction::Contours => OpenDialog::Contours(ContourMark::default()),
            KeyAction::ShopJobs => OpenDialog::ShopJobs(ShopJobMark::default()),
            KeyAction::Messages => OpenDialog::Messages(0),
            _ => OpenDialog::Nothing,
        };
        match act {
            KeyAction::View => {
                // Pan and zoom do not carry over to another view.
                self.frame = Frame { fit: self.frame.fit, ..Frame::default() };
                self.view = Some(self.view(model).next());
            }
            KeyAction::ZoomIn => self.frame.zoom_by(2.0),
            KeyAction::ZoomOut => self.frame.zoom_by(0.5),
            KeyAction::Pan => self.frame.pan_by(match key {
                Key::ShiftLeft => [-0.25, 0.0],
                Key::ShiftRight => [0.25, 0.0],
                Key::ShiftUp => [0.0, 0.25],
                _ => [0.0, -0.25],
            }),
            KeyAction::Fit => {
                let fit = if self.frame.fit == Fit::Program { Fit::Table } else { Fit::Program };
                self.frame = Frame { fit, ..Frame::default() };
            }
            KeyAction::Step => self.step = (self.step + 1) % JOG_STEPS.len(),
            KeyAction::NextAxis => self.axis = (self.axis + 1) % model.facts.axes.len().max(1),
            _ => {}
        }
    }

    /// Rate of a key that is pressed repeatedly.
    fn next_rate(&mut self, mode: Mode, model: &ScreenModel) -> Rate {
        let index = match self.last_rate {
            Some((last, index)) if last == mode && model.mode == mode => (index + 1) % RATES.len(),
            _ => 0,
        };
        self.last_rate = Some((mode, index));
        Rate::percent(RATES[index])
    }

    /// Requested override, in steps of 10 %; quick repeated keys add up.
    fn request_override(&mut self, model: &ScreenModel, by: f64, now_ms: u64) -> Rate {
        let [least, most] = OVERRIDES;
        let shown = model.override_rate * 100.0;
        let from = match self.overridden {
            Some((asked, at)) if now_ms.saturating_sub(at) < REPEATED_MS => asked,
            _ => shown,
        };
        let percent = ((from / 10.0).round() * 10.0 + by).clamp(least, most);
        self.overridden = Some((percent, now_ms));
        Rate::percent(percent.round() as i64)
    }

    /// Counts of a key that turns the handwheel; a key that is held down turns it faster.
    fn turn(&mut self, key: Key, now_ms: u64) -> i32 {
        let (forward, counts) = match key {
            Key::PageUp => (true, 10),
            Key::PageDown => (false, 10),
            Key::Right | Key::Up => (true, 1),
            _ => (false, 1),
        };
        let repeated = match self.last_turn {
            Some((last, at, n)) if last == forward && now_ms.saturating_sub(at) < REPEATED_MS => (n + 1).min(5),
            _ => 1,
        };
        self.last_turn = Some((forward, now_ms, repeated));
        let counts = if counts == 1 { repeated } else { counts };
        if forward { counts } else { -counts }
    }

    /// Handles a key while a dialog is open.
    fn key_in_box(&mut self, key: Key, now_ms: u64, model: &ScreenModel) -> Option<UiCommand> {
        // At the end of the program nothing moves, and file names may have blanks.
        let is_job = model.stage == ScreenStage::Job && !model.is_at_program_end();
        if key == Key::Char(' ') && (is_job || !matches!(self.open, OpenDialog::Prompt(..))) {
            self.open = OpenDialog::Nothing;
            return (!matches!(model.stage, ScreenStage::Ended(_))).then_some(UiCommand::Job(OperatorCommand::Hold));
        }
        let is_text_prompt = matches!(&self.open, OpenDialog::Prompt(ask, ..) if ask.takes_text());
        if matches!(key, Key::Char('x' | 'X')) && !is_text_prompt {
            self.open = OpenDialog::Nothing;
            return Some(UiCommand::CutterOff);
        }
        if let OpenDialog::Contours(mark) = self.open {
            return self.key_in_contours(key, mark, now_ms, model);
        }
        if let OpenDialog::ShopJobs(mark) = self.open.clone() {
            return self.key_in_shop_jobs(key, &mark, now_ms, model);
        }
        let OpenDialog::Prompt(ask, text, wrong) = &mut self.open else {
            match (&mut self.open, key) {
                (OpenDialog::Help(page), Key::Down | Key::PageDown | Key::Tab | Key::Char('?')) => *page += 1,
                (OpenDialog::Help(page), Key::Up | Key::PageUp) => *page = page.saturating_sub(1),
                (OpenDialog::Messages(back), Key::Up) => *back = (*back + 1).min(MAX_SCROLL),
                (OpenDialog::Messages(back), Key::PageUp) => *back = (*back + 15).min(MAX_SCROLL),
                (OpenDialog::Messages(back), Key::Down) => *back = back.saturating_sub(1),
                (OpenDialog::Messages(back), Key::PageDown) => *back = back.saturating_sub(15),
                _ => self.open = OpenDialog::Nothing,
            }
            return None;
        };
        *wrong = None;
        let done = match (*ask, key) {
            (PendingQuestion::Stop, Key::Char('y') | Key::Interrupt) => Ok(UiCommand::Job(OperatorCommand::Stop)),
            (
                ask @ (PendingQuestion::TestPulse | PendingQuestion::SenseTest | PendingQuestion::SheetPoint),
                Key::Char('y'),
            ) => answer(ask, "", model),
            // A figure is looked at more often than reset.
            (ask @ PendingQuestion::ConsumablesChanged, Key::Char('0')) => answer(ask, "", model),
            (PendingQuestion::StartTurned, Key::Char('y')) => {
                self.turn.confirm(model);
                Ok(UiCommand::Start)
            }
            (PendingQuestion::StartContour(number), Key::Char('y')) => Ok(UiCommand::StartContour(number)),
            (PendingQuestion::Frame(shape), Key::Char('y')) => Ok(UiCommand::Frame(shape)),
            (PendingQuestion::AlignSheet, Key::Char('y')) => {
                self.turn.begin_to_set(model);
                Ok(UiCommand::AlignSheet)
            }
            (PendingQuestion::AlignSheet, Key::Char('n') | Key::Esc | Key::Interrupt) => Ok(UiCommand::ForgetSheet),
            // Two points took their time: a jog that comes late, or the key that has opened the question, loses none.
            (PendingQuestion::AlignSheet, _) => return None,
            (ask, _) if !ask.takes_text() => {
                self.open = OpenDialog::Nothing;
                return None;
            }
            (_, Key::Esc | Key::Interrupt) => {
                self.open = OpenDialog::Nothing;
                return None;
            }
            (PendingQuestion::Program, Key::Tab) => {
                *wrong = files::complete(text);
                return None;
            }
            (ask, Key::Enter) => answer(ask, text.trim(), model),
            (_, Key::Backspace) => {
                text.pop();
                return None;
            }
            (ask, Key::Char(c)) if text.chars().count() < 500 => {
                // The text is a suggestion: the first key replaces it.
                let suggested = matches!(
                    (ask, text.as_str()),
                    (PendingQuestion::BackBy, "20") | (PendingQuestion::WorkZero, "all")
                );
                if suggested {
                    text.clear();
                }
                text.push(c);
                return None;
            }
            _ => return None,
        };
        match done {
            Ok(command) => {
                self.open = OpenDialog::Nothing;
                self.notice = None;
                Some(command)
            }
            Err(why) => {
                *wrong = Some(why);
                self.show_notice("invalid input", now_ms);
                None
            }
        }
    }
}
