//! What the operator is doing at the keys: from a key to the words that it says.
//!
//! Invariant: a pure function of the key, the time and the picture; a hold is said whatever is open, but while a line is being typed
//! that spaces belong to, where nothing runs.

use retrace_controller::manual::ManualTask;
use retrace_controller::operator::OperatorCommand;
use retrace_controller::tool_length::EnteredLength;
use retrace_core::mode::Mode;
use retrace_core::{ONE, Travel};
use retrace_link::channel;

use super::UiCommand;
use super::files;
use super::keys::{self, Key, KeyAction, Situation};
use super::model::{ScreenModel, ScreenStage};

/// What a prompt asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PendingQuestion {
    /// So many mm back.
    BackBy,
    /// The number of an output.
    Output,
    /// A block.
    Mdi,
    /// An axis, or all.
    WorkZero,
    /// The length of a tool.
    ToolLength,
    /// Whether to stop the job.
    Stop,
    /// The file of another program.
    Program,
}

/// What lies over the screen.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum OpenDialog {
    /// Nothing.
    #[default]
    Nothing,
    /// All keys, this page of them; pages begin again behind the last.
    Help(usize),
    /// The tool table.
    Tools,
    /// All messages, so many lines above the newest.
    Messages(usize),
    /// A question, what was typed so far, and what was wrong with it.
    Prompt(PendingQuestion, String, Option<String>),
}

/// From where the path is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum View {
    /// From above.
    #[default]
    Xy,
    /// From the front.
    Xz,
    /// From the side.
    Yz,
    /// From a corner.
    Iso,
}

/// What the drawing shows whole where it is neither zoomed nor panned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Fit {
    /// The program's path and the tool.
    #[default]
    Program,
    /// The table: all that the soft limits enclose, and the path.
    Table,
}

/// How the drawing is framed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// What it is fitted to.
    pub fit: Fit,
    /// How many times as large as fitted, 1 to [`MAX_ZOOM`].
    pub zoom: f64,
    /// How far its centre lies off that of the fitted drawing, across and up, as shares of the fitted drawing.
    pub pan: [f64; 2],
}

/// The largest zoom.
pub const MAX_ZOOM: f64 = 256.0;

impl Default for Frame {
    fn default() -> Self {
        Self { fit: Fit::default(), zoom: 1.0, pan: [0.0; 2] }
    }
}

impl Frame {
    /// Zooms by a factor.
    fn zoom_by(&mut self, factor: f64) {
        self.zoom = (self.zoom * factor).clamp(1.0, MAX_ZOOM);
        self.pan_by([0.0; 2]);
    }

    /// Moves the view by shares of what it shows. It stays within the fitted drawing.
    fn pan_by(&mut self, shares: [f64; 2]) {
        let most = 0.5 - 0.5 / self.zoom;
        for (pan, share) in self.pan.iter_mut().zip(shares) {
            *pan = (*pan + share / self.zoom).clamp(-most, most);
        }
    }
}

/// Steps of a jog, mm; the last one goes on until it is stopped.
pub const STEPS_MM: [Option<f64>; 5] = [Some(0.01), Some(0.1), Some(1.0), Some(10.0), None];

/// The rates that a key gives when it is pressed again and again, in percent.
const RATES: [Travel; 4] = [100, 50, 25, 10];

/// Lines that all messages may come to, and more.
const MAX_SCROLL: usize = 2_000;

/// How long a notice is shown, ms.
const NOTICE_MS: u64 = 4_000;

/// Arrows that come faster than this are one that is held down, ms.
const REPEATED_MS: u64 = 150;

/// The steps of the rapid override, in percent.
const RAPID_OVERRIDES: [f64; 4] = [100.0, 50.0, 25.0, 0.0];
/// The highest override that a key asks for, and the lowest, in percent.
const OVERRIDES: [f64; 2] = [0.0, 200.0];

/// What the operator is doing.
#[derive(Clone, Debug, Default)]
pub struct KeyState {
    /// What lies over the screen.
    pub open: OpenDialog,
    /// Has the operator put the alarm's box aside?
    pub alarm_aside: bool,
    /// From where the path is seen.
    pub view: View,
    /// How it is framed.
    pub frame: Frame,
    /// Index of the jog step.
    pub step: usize,
    /// Index of the axis that is chosen.
    pub axis: usize,
    /// Is a dry run asked for?
    pub dry: bool,
    notice: Option<(String, u64)>,
    /// Direction and index of the rate that was asked for last.
    asked: Option<(Mode, usize)>,
    turned: Option<(bool, u64, i32)>,
    /// The override that was asked for last, in percent, and when: it may not be in the picture yet.
    overridden: Option<(f64, u64)>,
}

impl KeyState {
    /// With a jog step of 1 mm.
    #[must_use]
    pub fn new() -> Self {
        Self { step: 2, ..Self::default() }
    }

    /// What the operator should know of the last key, if it is not old.
    #[must_use]
    pub fn notice(&self, now_ms: u64) -> Option<&str> {
        self.notice.as_ref().filter(|(_, until)| now_ms < *until).map(|(text, _)| text.as_str())
    }

    /// Shows a notice.
    pub fn send(&mut self, text: impl Into<String>, now_ms: u64) {
        self.notice = Some((text.into(), now_ms + NOTICE_MS));
    }

    /// The mouse wheel was turned by a notch: only in handwheel mode it is one.
    #[must_use]
    pub fn mouse_wheel(&mut self, forward: bool, model: &ScreenModel) -> Option<UiCommand> {
        let is_wheel = Situation::of(model) == Situation::Wheel && self.open == OpenDialog::Nothing;
        is_wheel.then_some(UiCommand::Turn(if forward { 4 } else { -4 }))
    }

    /// What lies over the screen, if it still has a meaning: a question about a job ends with it, and one about the machine when a job begins.
    #[must_use]
    pub fn open(&self, model: &ScreenModel) -> &OpenDialog {
        let is_job = model.stage == ScreenStage::Job;
        match &self.open {
            OpenDialog::Prompt(PendingQuestion::Program, ..) if is_job && !model.is_at_program_end() => {
                &OpenDialog::Nothing
            }
            OpenDialog::Prompt(PendingQuestion::Stop | PendingQuestion::BackBy | PendingQuestion::ToolLength, ..)
                if !is_job =>
            {
                &OpenDialog::Nothing
            }
            OpenDialog::Prompt(PendingQuestion::Mdi | PendingQuestion::WorkZero, ..) if is_job => &OpenDialog::Nothing,
            open => open,
        }
    }

    /// A key was pressed.
    #[must_use]
    pub fn key(&mut self, key: Key, now_ms: u64, model: &ScreenModel) -> Option<UiCommand> {
        match model.alarm {
            None => self.alarm_aside = false,
            // An alarm stands before whatever was open.
            Some(_) if !self.alarm_aside => self.open = OpenDialog::Nothing,
            Some(_) => {}
        }
        self.open = self.open(model).clone();
        if self.open != OpenDialog::Nothing {
            return self.key_in_box(key, now_ms, model);
        }
        if key == Key::Esc {
            self.alarm_aside = true;
            let is_refusal = model.alarm.as_ref().is_some_and(|alarm| alarm.is_refusal);
            return is_refusal.then_some(UiCommand::CloseRefusal);
        }
        let Some(row) = keys::row_of(key, Situation::of(model)) else {
            if let Some((row, when)) = keys::elsewhere(key) {
                self.send(format!("{} ({}) works {}", row.shown, row.short, when.words()), now_ms);
            } else if key != Key::Enter && key != Key::Backspace {
                self.send("that key does nothing; ? shows all keys", now_ms);
            }
            return None;
        };
        self.act(row.act, key, now_ms, model)
    }

    fn act(&mut self, act: KeyAction, key: Key, now_ms: u64, model: &ScreenModel) -> Option<UiCommand> {
        // A program that has come to its end is released by whatever comes next.
        let is_job = model.stage == ScreenStage::Job && !model.is_at_program_end();
        let deed = match act {
            KeyAction::CycleStart if !is_job => return Some(UiCommand::Start),
            KeyAction::SetUp => return Some(UiCommand::SetUp),
            KeyAction::CycleStart => OperatorCommand::CycleStart,
            KeyAction::Hold => OperatorCommand::Hold,
            KeyAction::Reverse => OperatorCommand::Reverse(self.stepped(Mode::Reverse, model)),
            KeyAction::Forward => OperatorCommand::Forward(self.stepped(Mode::Forward, model)),
            KeyAction::ReverseRapid => OperatorCommand::Reverse(8 * ONE),
            KeyAction::ForwardRapid => OperatorCommand::Forward(8 * ONE),
            KeyAction::Wheel => OperatorCommand::Wheel { counts_per_s: 0.0, seconds: 0.0 },
            KeyAction::Turn => return Some(UiCommand::Turn(self.turn(key, now_ms))),
            KeyAction::Leave => OperatorCommand::Leave { ask: false },
            KeyAction::LeaveAsk => OperatorCommand::Leave { ask: true },
            KeyAction::Agree if model.question.is_some() => return Some(UiCommand::Answer(true)),
            KeyAction::Decline if model.question.is_some() => return Some(UiCommand::Answer(false)),
            KeyAction::Decline => {
                self.send("nothing is asked", now_ms);
                return None;
            }
            KeyAction::Agree if model.differ.is_empty() => {
                self.send("there is nothing to confirm", now_ms);
                return None;
            }
            KeyAction::Agree => OperatorCommand::Confirm,
            KeyAction::BackBlock => OperatorCommand::BackToBlock,
            KeyAction::BackJet => OperatorCommand::BackToPierce,
            KeyAction::Faster => OperatorCommand::Override(self.overridden(model, 10.0, now_ms)),
            KeyAction::Slower => OperatorCommand::Override(self.overridden(model, -10.0, now_ms)),
            KeyAction::Whole => {
                self.overridden = Some((100.0, now_ms));
                OperatorCommand::Override(ONE)
            }
            KeyAction::RapidOverride => {
                let next = RAPID_OVERRIDES.iter().find(|&&percent| percent < model.rapid_override * 100.0 - 0.5);
                OperatorCommand::RapidOverride((next.unwrap_or(&100.0).round() as Travel * ONE + 50) / 100)
            }
            KeyAction::Single => OperatorCommand::Single,
            KeyAction::Pause => OperatorCommand::Pause,
            KeyAction::CutterOff => return Some(UiCommand::CutterOff),
            KeyAction::CutterOn => OperatorCommand::CutterOn,
            KeyAction::Recover => OperatorCommand::Recover,
            KeyAction::OptionalStop => {
                return Some(UiCommand::OptionalStop(!model.optional_stop));
            }
            KeyAction::Spindle if model.output(channel::SPINDLE) == 0 => OperatorCommand::SpindleStart,
            KeyAction::Spindle => OperatorCommand::SpindleStop,
            KeyAction::Online => OperatorCommand::Online,
            KeyAction::Jog | KeyAction::JogDown | KeyAction::JogUp => return self.jog(key, now_ms, model),
            KeyAction::ClearAlarm if model.alarm.is_none() => {
                self.send("there is no alarm", now_ms);
                return None;
            }
            KeyAction::ClearAlarm if model.alarm.as_ref().is_some_and(|alarm| alarm.is_refusal) => {
                return Some(UiCommand::CloseRefusal);
            }
            KeyAction::ClearAlarm => return Some(UiCommand::Task(ManualTask::ClearAlarm)),
            KeyAction::Home => return Some(UiCommand::Task(ManualTask::Home(None))),
            KeyAction::DryRun => {
                self.dry = !self.dry;
                return Some(UiCommand::DryRun(self.dry));
            }
            KeyAction::Quit if !is_job => return Some(UiCommand::Quit),
            _ => {
                self.look(act, key, model);
                return None;
            }
        };
        Some(UiCommand::Deed(deed))
    }

    /// Acts that say nothing: boxes, and what is shown.
    fn look(&mut self, act: KeyAction, key: Key, model: &ScreenModel) {
        let ask = |ask, text: &str| OpenDialog::Prompt(ask, text.into(), None);
        self.open = match act {
            KeyAction::BackBy => ask(PendingQuestion::BackBy, "20"),
            KeyAction::Output => ask(PendingQuestion::Output, ""),
            KeyAction::Mdi => ask(PendingQuestion::Mdi, ""),
            KeyAction::WorkZero => ask(PendingQuestion::WorkZero, "all"),
            KeyAction::ToolLength => ask(PendingQuestion::ToolLength, ""),
            KeyAction::OpenProgram => ask(PendingQuestion::Program, ""),
            KeyAction::Quit => ask(PendingQuestion::Stop, ""),
            KeyAction::Help => OpenDialog::Help(0),
            KeyAction::Tools => OpenDialog::Tools,
            KeyAction::Messages => OpenDialog::Messages(0),
            _ => OpenDialog::Nothing,
        };
        match act {
            KeyAction::View => {
                // What was panned to is somewhere else from another side.
                self.frame = Frame { fit: self.frame.fit, ..Frame::default() };
                self.view = match self.view {
                    View::Xy => View::Xz,
                    View::Xz => View::Yz,
                    View::Yz => View::Iso,
                    View::Iso => View::Xy,
                };
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
            KeyAction::Step => self.step = (self.step + 1) % STEPS_MM.len(),
            KeyAction::NextAxis => self.axis = (self.axis + 1) % model.facts.axes.len().max(1),
            _ => {}
        }
    }

    /// The rate of a key that is pressed again and again.
    fn stepped(&mut self, mode: Mode, model: &ScreenModel) -> Travel {
        let index = match self.asked {
            Some((last, index)) if last == mode && model.mode == mode => (index + 1) % RATES.len(),
            _ => 0,
        };
        self.asked = Some((mode, index));
        RATES[index] * ONE / 100
    }

    /// The override asked for, in steps of 10 %: keys that follow each other quickly build on each other.
    fn overridden(&mut self, model: &ScreenModel, by: f64, now_ms: u64) -> Travel {
        let [least, most] = OVERRIDES;
        let shown = model.override_rate * 100.0;
        let from = match self.overridden {
            Some((asked, at)) if now_ms.saturating_sub(at) < REPEATED_MS => asked,
            _ => shown,
        };
        let percent = ((from / 10.0).round() * 10.0 + by).clamp(least, most);
        self.overridden = Some((percent, now_ms));
        (percent.round() as Travel * ONE + 50) / 100
    }

    /// Counts of a key that turns the wheel: one that is held down turns it faster.
    fn turn(&mut self, key: Key, now_ms: u64) -> i32 {
        let (forward, counts) = match key {
            Key::PageUp => (true, 10),
            Key::PageDown => (false, 10),
            Key::Right | Key::Up => (true, 1),
            _ => (false, 1),
        };
        let repeated = match self.turned {
            Some((last, at, n)) if last == forward && now_ms.saturating_sub(at) < REPEATED_MS => (n + 1).min(5),
            _ => 1,
        };
        self.turned = Some((forward, now_ms, repeated));
        let counts = if counts == 1 { repeated } else { counts };
        if forward { counts } else { -counts }
    }

    fn jog(&mut self, key: Key, now_ms: u64, model: &ScreenModel) -> Option<UiCommand> {
        let letters: Vec<char> = model.facts.axes.iter().map(|axis| axis.letter).collect();
        // A lathe has no Y: there ↑ ↓ are X, and ← → are Z.
        let is_lathe = !letters.contains(&'y');
        let (letter, up) = match key {
            Key::Left | Key::Right => (if is_lathe { 'z' } else { 'x' }, key == Key::Right),
            Key::Up | Key::Down => (if is_lathe { 'x' } else { 'y' }, key == Key::Up),
            Key::PageUp | Key::PageDown => ('z', key == Key::PageUp),
            _ => (*letters.get(self.axis)?, key == Key::Char(']')),
        };
        if !letters.contains(&letter) {
            self.send(format!("this machine has no axis {}", letter.to_ascii_uppercase()), now_ms);
            return None;
        }
        let step = STEPS_MM.get(self.step).copied().flatten();
        let is_paused = model.stage == ScreenStage::Job;
        Some(match step {
            // A paused program's jogs are steps: each of them is remembered.
            _ if is_paused => {
                let mm = step.unwrap_or(10.0);
                UiCommand::Deed(OperatorCommand::Jog { axis: letter, mm: if up { mm } else { -mm } })
            }
            Some(mm) => UiCommand::Task(ManualTask::Jog { axis: letter, mm: if up { mm } else { -mm } }),
            None => UiCommand::Task(ManualTask::JogOn { axis: letter, up }),
        })
    }

    /// A key while something lies over the screen.
    fn key_in_box(&mut self, key: Key, now_ms: u64, model: &ScreenModel) -> Option<UiCommand> {
        // At the end of the program nothing moves, and names of files have spaces.
        let is_job = model.stage == ScreenStage::Job && !model.is_at_program_end();
        if key == Key::Char(' ') && (is_job || !matches!(self.open, OpenDialog::Prompt(..))) {
            self.open = OpenDialog::Nothing;
            return (!matches!(model.stage, ScreenStage::Ended(_))).then_some(UiCommand::Deed(OperatorCommand::Hold));
        }
        let is_typed = matches!(&self.open, OpenDialog::Prompt(ask, ..) if *ask != PendingQuestion::Stop);
        if matches!(key, Key::Char('x' | 'X')) && !is_typed {
            self.open = OpenDialog::Nothing;
            return Some(UiCommand::CutterOff);
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
            (PendingQuestion::Stop, Key::Char('y') | Key::Interrupt) => Ok(UiCommand::Deed(OperatorCommand::Stop)),
            (PendingQuestion::Stop, _) | (_, Key::Esc | Key::Interrupt) => {
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
                // What stands there is a suggestion: the first key replaces it.
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
            Ok(said) => {
                self.open = OpenDialog::Nothing;
                self.notice = None;
                Some(said)
            }
            Err(why) => {
                *wrong = Some(why);
                self.send("not understood", now_ms);
                None
            }
        }
    }
}

/// What a prompt's answer says, or what is wrong with it.
fn answer(ask: PendingQuestion, text: &str, model: &ScreenModel) -> Result<UiCommand, String> {
    match ask {
        PendingQuestion::BackBy => match text.parse::<f64>() {
            Ok(mm) if mm.is_finite() && mm > 0.0 => Ok(UiCommand::Deed(OperatorCommand::BackBy(mm))),
            _ => Err("a length in mm above 0, such as 20".into()),
        },
        PendingQuestion::Output => output(text, model),
        PendingQuestion::Mdi if text.is_empty() => Err("a block such as G0 X10".into()),
        PendingQuestion::Mdi => Ok(UiCommand::Task(ManualTask::Mdi(text.into()))),
        PendingQuestion::WorkZero => {
            let lower = text.to_ascii_lowercase();
            let axis = model.facts.axes.iter().find(|axis| lower == axis.letter.to_string());
            match (lower.as_str(), axis) {
                ("all", _) => Ok(UiCommand::Task(ManualTask::WorkZero(None))),
                (_, Some(axis)) => Ok(UiCommand::Task(ManualTask::WorkZero(Some(axis.letter)))),
                _ => Err("all, or the letter of an axis".into()),
            }
        }
        // With a sign it is by how much the new tool is longer.
        PendingQuestion::ToolLength => match text.parse::<f64>() {
            Ok(mm) if mm.abs() <= 10_000.0 && text.starts_with(['+', '-']) => Ok(tool_length(EnteredLength::By(mm))),
            Ok(mm) if (0.0..=10_000.0).contains(&mm) => Ok(tool_length(EnteredLength::To(mm))),
            _ => Err("a length in mm such as 84.2, or +0.35 where the new tool is that much longer".into()),
        },
        PendingQuestion::Stop => Ok(UiCommand::Deed(OperatorCommand::Stop)),
        PendingQuestion::Program if text.is_empty() => Err("the path of a program file".into()),
        PendingQuestion::Program => Ok(UiCommand::Load(files::expanded(text))),
    }
}

fn tool_length(length: EnteredLength) -> UiCommand {
    UiCommand::Deed(OperatorCommand::ToolLength(length))
}

/// `3+` switches output 3 on and `3-` off; a name stands for its number. Without a sign an output is switched over, unless it is a cutter's.
fn output(text: &str, model: &ScreenModel) -> Result<UiCommand, String> {
    let name = text.trim_end_matches(['+', '-']);
    let Some(number) = model.facts.output_named(name) else {
        return Err("a number from 0 to 63, or a name, and + or -: 3+, 3-".into());
    };
    let on = match &text[name.len()..] {
        "" if model.facts.is_of_cutter(number) => return Err("say which: + is on, - is off".into()),
        "" => model.output(number) == 0,
        "+" => true,
        "-" => false,
        _ => return Err("+ is on, - is off".into()),
    };
    Ok(match model.stage {
        ScreenStage::Job => UiCommand::Deed(OperatorCommand::Output { number, on }),
        _ => UiCommand::Task(ManualTask::Output(number, i32::from(on))),
    })
}
