//! What every key does, and when: the one table that keys, key line and help are taken from.
//!
//! Invariant: in one situation a key does one thing.

use retrace_controller::telemetry::HoldReason;
use retrace_core::mode::Mode;

use super::model::{ScreenModel, ScreenStage};

/// A key, as the screen knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Key {
    /// A character.
    Char(char),
    /// An arrow.
    Up,
    /// An arrow.
    Down,
    /// An arrow.
    Left,
    /// An arrow.
    Right,
    /// An arrow with Shift.
    ShiftUp,
    /// An arrow with Shift.
    ShiftDown,
    /// An arrow with Shift.
    ShiftLeft,
    /// An arrow with Shift.
    ShiftRight,
    /// Page up.
    PageUp,
    /// Page down.
    PageDown,
    /// Tabulator.
    Tab,
    /// Return.
    Enter,
    /// Escape.
    Esc,
    /// Rubs out a character.
    Backspace,
    /// Control and C.
    Interrupt,
}

/// What a key does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum KeyAction {
    /// Cycle start; begins the program where none runs.
    CycleStart,
    /// Feed hold.
    Hold,
    /// Reverse run.
    Reverse,
    /// Rapid reverse run.
    ReverseRapid,
    /// Forward run.
    Forward,
    /// Rapid forward run.
    ForwardRapid,
    /// The handwheel.
    Wheel,
    /// Turns the handwheel.
    Turn,
    /// Leaves retracing.
    Leave,
    /// The same, and asks where outputs differ.
    LeaveAsk,
    /// Agrees to the outputs.
    Agree,
    /// Does not agree to what is asked.
    Decline,
    /// Back by a length.
    BackBy,
    /// Back to the beginning of the block.
    BackBlock,
    /// Back to where the jet came on.
    BackJet,
    /// More override.
    Faster,
    /// Less override.
    Slower,
    /// Override 100 %.
    Whole,
    /// Rapid override, the next lower step.
    RapidOverride,
    /// Single block.
    Single,
    /// Pause.
    Pause,
    /// Switches every cutter off.
    CutterOff,
    /// Switches the cutter on by hand.
    CutterOn,
    /// Restores the outputs, the cutter last, and goes on.
    Recover,
    /// M1 stops, or does not.
    OptionalStop,
    /// Stops the spindle, or starts it.
    Spindle,
    /// The length of a tool that was changed.
    ToolLength,
    /// On-line mode.
    Online,
    /// Jogs an axis.
    Jog,
    /// Jogs the chosen axis down.
    JogDown,
    /// Jogs the chosen axis up.
    JogUp,
    /// Chooses the axis.
    NextAxis,
    /// Chooses the jog step.
    Step,
    /// An output by hand.
    Output,
    /// Clears the alarm.
    ClearAlarm,
    /// After a job: sets the machine up again.
    SetUp,
    /// Homes.
    Home,
    /// A block by hand.
    Mdi,
    /// Sets the work zero.
    WorkZero,
    /// Outputs inhibited.
    DryRun,
    /// Opens another program.
    OpenProgram,
    /// The tool table.
    Tools,
    /// Turns the drawing.
    View,
    /// Enlarges the drawing.
    ZoomIn,
    /// Makes it smaller again.
    ZoomOut,
    /// Moves it.
    Pan,
    /// Fits it to the program, or to the table.
    Fit,
    /// All messages.
    Messages,
    /// All keys.
    Help,
    /// Stops the job; leaves the screen.
    Quit,
}

/// In what situation the operator is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Situation {
    /// No job runs.
    Setup = 1,
    /// Normal run, moving or standing.
    Run = 2,
    /// Reverse run, forward run, on the way back, or outputs to be agreed to.
    Retrace = 4,
    /// The handwheel.
    Wheel = 8,
    /// A paused program.
    Paused = 16,
    /// The job has ended.
    Ended = 32,
    /// At the end of the program, which has not been released: reverse run is possible.
    ProgramEnd = 64,
    /// A job is about to be resumed.
    Resuming = 128,
}

impl Situation {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Setup,
        Self::Run,
        Self::Retrace,
        Self::Wheel,
        Self::Paused,
        Self::Ended,
        Self::ProgramEnd,
        Self::Resuming,
    ];

    /// The one that the picture shows.
    #[must_use]
    pub fn of(model: &ScreenModel) -> Self {
        match (&model.stage, model.mode) {
            (ScreenStage::Setup, _) => Self::Setup,
            (ScreenStage::Ended(_), _) => Self::Ended,
            (ScreenStage::Resuming, _) => Self::Resuming,
            (ScreenStage::Job, _) if model.standing == HoldReason::Paused || model.pause.is_some() => Self::Paused,
            (ScreenStage::Job, Mode::Run) if model.is_at_program_end() => Self::ProgramEnd,
            (ScreenStage::Job, Mode::Run) => Self::Run,
            (ScreenStage::Job, Mode::Wheel) => Self::Wheel,
            (ScreenStage::Job, _) => Self::Retrace,
        }
    }

    /// When, in words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Setup => "while no program runs",
            Self::Run => "while the program runs or is held",
            Self::Retrace => "while retracing",
            Self::Wheel => "in handwheel mode",
            Self::Paused => "while the program is paused",
            Self::Ended => "when the job has ended",
            Self::ProgramEnd => "at the end of the program",
            Self::Resuming => "before a job is resumed",
        }
    }
}

/// A row of the table.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Any of these keys.
    pub keys: &'static [Key],
    /// How they are shown.
    pub shown: &'static str,
    /// What they do, in a word.
    pub short: &'static str,
    /// What they do, in a line of the help.
    pub long: &'static str,
    /// In which situations.
    pub when: u8,
    /// What they do.
    pub act: KeyAction,
}

const SETUP: u8 = Situation::Setup as u8;
const RUN: u8 = Situation::Run as u8;
const RETRACE: u8 = Situation::Retrace as u8;
const WHEEL: u8 = Situation::Wheel as u8;
const PAUSED: u8 = Situation::Paused as u8;
const ENDED: u8 = Situation::Ended as u8;
const PROGRAM_END: u8 = Situation::ProgramEnd as u8;
const JOB: u8 = RUN | RETRACE | WHEEL | PAUSED | PROGRAM_END;
const MOVING: u8 = RUN | RETRACE | WHEEL | PROGRAM_END;
const ALWAYS: u8 = SETUP | JOB | ENDED;
const RESUMING: u8 = Situation::Resuming as u8;
/// Whatever the situation.
const EVER: u8 = ALWAYS | RESUMING;
/// No job runs, or the one that does can be released.
const FREE: u8 = SETUP | ENDED | PROGRAM_END;

const ARROWS: &[Key] = &[Key::Left, Key::Right, Key::Up, Key::Down, Key::PageUp, Key::PageDown];

const SHIFT_ARROWS: &[Key] = &[Key::ShiftLeft, Key::ShiftRight, Key::ShiftUp, Key::ShiftDown];

const fn row(
    keys: &'static [Key],
    shown: &'static str,
    short: &'static str,
    long: &'static str,
    when: u8,
    act: KeyAction,
) -> Row {
    Row { keys, shown, short, long, when, act }
}

/// The table.
#[rustfmt::skip]
pub const TABLE: &[Row] = &[
    row(&[Key::Char('c')], "c", "start", "cycle start: begin, or go on after a hold or stop", ALWAYS, KeyAction::CycleStart),
    row(&[Key::Char(' '), Key::Char('h')], "Space", "hold", "feed hold, at any time (h too); stops a jog", SETUP | JOB | RESUMING, KeyAction::Hold),
    row(&[Key::Char('r')], "r", "reverse", "back along the path; again: 50, 25, 10 %, 100 %", MOVING, KeyAction::Reverse),
    row(&[Key::Char('R')], "R", "rapid back", "back in rapid: up to 800 % with the jet off", MOVING, KeyAction::ReverseRapid),
    row(&[Key::Char('f')], "f", "forward", "forward over what was cut; again: 50, 25, 10 %", RETRACE | WHEEL, KeyAction::Forward),
    row(&[Key::Char('F')], "F", "rapid fwd", "forward in rapid, to where it was", RETRACE | WHEEL, KeyAction::ForwardRapid),
    row(&[Key::Char('w')], "w", "wheel", "handwheel: arrows and mouse wheel move the machine", RUN | RETRACE | PROGRAM_END, KeyAction::Wheel),
    row(ARROWS, "← →", "turn", "turn the wheel back, forward; PgUp PgDn ten counts", WHEEL, KeyAction::Turn),
    row(&[Key::Char('l')], "l", "leave", "leave: forward to where it was, then on", RETRACE | WHEEL, KeyAction::Leave),
    row(&[Key::Char('L')], "L", "leave, ask", "the same, but ask before outputs are restored", RETRACE | WHEEL, KeyAction::LeaveAsk),
    row(&[Key::Char('y')], "y", "agree", "agree to what is asked, as to the outputs", RETRACE | WHEEL | RESUMING, KeyAction::Agree),
    row(&[Key::Char('n')], "n", "no", "do not agree to what is asked", RESUMING, KeyAction::Decline),
    row(&[Key::Char('b')], "b", "back mm", "back by so many mm", MOVING, KeyAction::BackBy),
    row(&[Key::Char('B')], "B", "block", "back to the start of this block", MOVING, KeyAction::BackBlock),
    row(&[Key::Char('j')], "j", "jet", "back to where the jet came on", MOVING, KeyAction::BackJet),
    row(&[Key::Char('+'), Key::Char('=')], "+", "faster", "feed override 10 % up; rapids keep theirs", JOB, KeyAction::Faster),
    row(&[Key::Char('-')], "-", "slower", "feed override 10 % down", JOB, KeyAction::Slower),
    row(&[Key::Char('0')], "0", "100 %", "feed override 100 %", JOB, KeyAction::Whole),
    row(&[Key::Char('*')], "*", "rapids", "rapid override: 50, 25, 0 %, 100 %", JOB, KeyAction::RapidOverride),
    row(&[Key::Char('s')], "s", "single", "single block on, off", JOB, KeyAction::Single),
    row(&[Key::Char('p')], "p", "pause", "pause the program, to move away and come back", RUN, KeyAction::Pause),
    row(&[Key::Char('x'), Key::Char('X')], "x", "cutter off", "cutter off, at once, whatever the machine does", EVER, KeyAction::CutterOff),
    row(&[Key::Char('i')], "i", "cutter on", "cutter on, where it may cut by hand", MOVING, KeyAction::CutterOn),
    row(&[Key::Char('k')], "k", "recover", "restore the outputs, the cutter last, and go on", RUN | RETRACE | WHEEL, KeyAction::Recover),
    row(&[Key::Char('S')], "S", "spindle", "stop the spindle; again: start it as it was", PAUSED, KeyAction::Spindle),
    row(&[Key::Char('M')], "M", "M1 stop", "M1 stops, or does not", SETUP | JOB, KeyAction::OptionalStop),
    row(&[Key::Char('z')], "z", "tool length", "new tool length, spindle off: 84.2 mm, or +0.35", PAUSED, KeyAction::ToolLength),
    row(&[Key::Char('n')], "n", "on line", "back to on-line mode", PAUSED, KeyAction::Online),
    row(ARROWS, "arrows", "jog", "← → X, ↑ ↓ Y, PgUp PgDn Z, by the step", SETUP | PAUSED, KeyAction::Jog),
    row(&[Key::Char('[')], "[", "jog -", "jog the chosen axis down", SETUP | PAUSED, KeyAction::JogDown),
    row(&[Key::Char(']')], "]", "jog +", "jog the chosen axis up", SETUP | PAUSED, KeyAction::JogUp),
    row(&[Key::Tab], "Tab", "axis", "choose the axis for [ and ]", SETUP | PAUSED, KeyAction::NextAxis),
    row(&[Key::Char('t')], "t", "step", "jog step: 0.01, 0.1, 1, 10 mm, on until Space", SETUP | PAUSED, KeyAction::Step),
    row(&[Key::Char('u')], "u", "set up", "release the job; set up: home, jog, MDI, work zero", ENDED | PROGRAM_END, KeyAction::SetUp),
    row(&[Key::Char('O')], "O", "open", "open another program; Tab completes its name", FREE, KeyAction::OpenProgram),
    row(&[Key::Char('H')], "H", "home", "home all axes", SETUP, KeyAction::Home),
    row(&[Key::Char('m')], "m", "MDI", "a block by hand", SETUP, KeyAction::Mdi),
    row(&[Key::Char('z')], "z", "zero", "work zero here, of one axis or all", SETUP, KeyAction::WorkZero),
    row(&[Key::Char('d')], "d", "dry run", "dry run: the cutter stays off", SETUP, KeyAction::DryRun),
    row(&[Key::Char('T')], "T", "tools", "the tool table", EVER, KeyAction::Tools),
    row(&[Key::Char('o')], "o", "output", "an output by hand: its number or name, then + or -", SETUP | JOB, KeyAction::Output),
    row(&[Key::Char('a')], "a", "reset", "alarm reset", ALWAYS, KeyAction::ClearAlarm),
    row(&[Key::Char('v')], "v", "view", "the drawing from another side", EVER, KeyAction::View),
    row(&[Key::Char('>'), Key::Char('.')], ">", "zoom in", "enlarge the drawing", EVER, KeyAction::ZoomIn),
    row(&[Key::Char('<'), Key::Char(',')], "<", "zoom out", "make the drawing smaller again", EVER, KeyAction::ZoomOut),
    row(SHIFT_ARROWS, "Shift ←", "pan", "Shift and an arrow: move the enlarged drawing", EVER, KeyAction::Pan),
    row(&[Key::Char('e')], "e", "fit", "fit the drawing to the table; again: to the program", EVER, KeyAction::Fit),
    row(&[Key::Char('g')], "g", "log", "all messages", EVER, KeyAction::Messages),
    row(&[Key::Char('?')], "?", "keys", "all keys", EVER, KeyAction::Help),
    row(&[Key::Char('q'), Key::Interrupt], "q", "quit", "stop the job, asked first; quit", EVER, KeyAction::Quit),
];

/// What a key does in a situation; the row that has it.
#[must_use]
pub fn row_of(key: Key, situation: Situation) -> Option<&'static Row> {
    TABLE.iter().find(|row| row.keys.contains(&key) && row.when & situation as u8 != 0)
}

/// Where a key that does nothing here does something: its row, and when.
#[must_use]
pub fn elsewhere(key: Key) -> Option<(&'static Row, Situation)> {
    let row = TABLE.iter().find(|row| row.keys.contains(&key))?;
    Situation::ALL.into_iter().find(|&s| row.when & s as u8 != 0).map(|situation| (row, situation))
}

/// The row of an act.
#[must_use]
pub fn row_for(act: KeyAction) -> Option<&'static Row> {
    TABLE.iter().find(|row| row.act == act)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_does_two_things_in_one_situation_and_every_act_has_one_row() {
        for situation in Situation::ALL {
            let mut seen = std::collections::HashSet::new();
            for row in TABLE.iter().filter(|row| row.when & situation as u8 != 0) {
                for key in row.keys {
                    assert!(seen.insert(key), "{key:?} twice {}", situation.words());
                }
            }
        }
        let acts: std::collections::HashSet<_> = TABLE.iter().map(|row| row.act).collect();
        assert_eq!(acts.len(), TABLE.len());
    }

    #[test]
    fn a_hold_is_one_key_away_wherever_something_may_move() {
        for situation in Situation::ALL.into_iter().filter(|&s| s != Situation::Ended) {
            assert_eq!(row_of(Key::Char(' '), situation).map(|row| row.act), Some(KeyAction::Hold));
        }
    }
}
