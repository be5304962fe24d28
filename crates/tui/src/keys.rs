//! Key table: what every key does, and in which situations. Key handling, key line and help are generated from it.
//!
//! Invariant: in one situation a key has one function.

use retrace_core::mode::Mode;
use retrace_journal::HoldReason;

use crate::model::{ScreenModel, ScreenStage};

/// A key as the screen receives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Key {
    /// A character.
    Char(char),
    /// Arrow up.
    Up,
    /// Arrow down.
    Down,
    /// Arrow left.
    Left,
    /// Arrow right.
    Right,
    /// Shift and arrow up.
    ShiftUp,
    /// Shift and arrow down.
    ShiftDown,
    /// Shift and arrow left.
    ShiftLeft,
    /// Shift and arrow right.
    ShiftRight,
    /// Page up.
    PageUp,
    /// Page down.
    PageDown,
    /// Tab.
    Tab,
    /// Return.
    Enter,
    /// Escape.
    Esc,
    /// Backspace.
    Backspace,
    /// Ctrl-C.
    Interrupt,
}

/// Function of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum KeyAction {
    /// Cycle start; starts the program where none runs.
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
    /// Returns to the furthest place and resumes the program.
    Leave,
    /// Returns to the furthest place, and asks for confirmation where outputs differ.
    LeaveAsk,
    /// Confirms the outputs, or answers yes.
    Agree,
    /// Answers no.
    Decline,
    /// Back by a distance.
    BackBy,
    /// Back to the start of the block.
    BackBlock,
    /// Back to the last pierce.
    BackJet,
    /// Back to the end of an interrupted cut.
    BackToCutEnd,
    /// Executes the program again from here.
    CutFromHere,
    /// Shifts the start of the cut beside the path.
    Shift,
    /// Override up.
    Faster,
    /// Override down.
    Slower,
    /// Override 100 %.
    Whole,
    /// Rapid override, next step down.
    RapidOverride,
    /// Override of the spindle speed up.
    SpindleFaster,
    /// Override of the spindle speed down.
    SpindleSlower,
    /// Single block.
    Single,
    /// Pause.
    Pause,
    /// To the park position, for a change of consumables; in a pause back from there.
    Park,
    /// The pointer over the place of the tool.
    Pointer,
    /// Back from the park position.
    ChangeDone,
    /// Switches every cutter off.
    CutterOff,
    /// Switches the cutter on manually.
    CutterOn,
    /// Switches the cutter on for a test pulse.
    TestPulse,
    /// Senses the sheet with the cutter off.
    SenseTest,
    /// Counts the wear of the consumables from here on.
    ConsumablesChanged,
    /// Traces the rectangle around what the program cuts.
    Frame,
    /// Traces the outline of what the program cuts.
    Outline,
    /// Takes a point on the edge of the sheet; behind the second one, sets the work coordinates by them.
    SheetEdge,
    /// Restores the outputs, the cutter last, and resumes.
    Recover,
    /// Passes the rest of the contour with the cutter off.
    SkipContour,
    /// Optional stop (M1) on or off.
    OptionalStop,
    /// Stops or starts the spindle.
    Spindle,
    /// Lets the axes follow the spindle while it is turned by hand, or no longer.
    FollowSpindle,
    /// Height control one step higher.
    HeightUp,
    /// Height control one step lower.
    HeightDown,
    /// Height control to the voltage of the material.
    HeightReset,
    /// Height control on or off.
    HeightControl,
    /// Enters the length of a new tool.
    ToolLength,
    /// On-line mode.
    Online,
    /// Jogs an axis.
    Jog,
    /// Jogs the selected axis in the negative direction.
    JogDown,
    /// Jogs the selected axis in the positive direction.
    JogUp,
    /// Selects the next axis.
    NextAxis,
    /// Selects the next jog step.
    Step,
    /// Switches an output manually.
    Output,
    /// Clears the alarm.
    ClearAlarm,
    /// Back to setup after a job.
    SetUp,
    /// Homes all axes.
    Home,
    /// MDI block.
    Mdi,
    /// Probing cycle.
    Probe,
    /// Sets the work zero.
    WorkZero,
    /// Dry run: outputs inhibited.
    DryRun,
    /// Opens another program.
    OpenProgram,
    /// Shows the jobs of the shop.
    ShopJobs,
    /// Shows the tool table.
    Tools,
    /// Shows the contours.
    Contours,
    /// Next view of the drawing.
    View,
    /// Enlarges the drawing.
    ZoomIn,
    /// Reduces the drawing.
    ZoomOut,
    /// Pans the drawing.
    Pan,
    /// Fits the drawing to the program, or to the table.
    Fit,
    /// Shows all messages.
    Messages,
    /// Shows all keys.
    Help,
    /// Stops the job; leaves the screen.
    Quit,
}

impl KeyAction {
    /// Whether it jogs an axis.
    pub(crate) const fn jogs(self) -> bool {
        matches!(self, Self::Jog | Self::JogDown | Self::JogUp)
    }
}

/// Situation of the operator; selects the keys that apply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Situation {
    /// No job runs.
    Setup = 1,
    /// Normal run, moving or at rest.
    Run = 2,
    /// Reverse run, forward run, the return to the furthest place, or outputs to be confirmed.
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
    /// All situations.
    pub(crate) const ALL: [Self; 8] = [
        Self::Setup,
        Self::Run,
        Self::Retrace,
        Self::Wheel,
        Self::Paused,
        Self::Ended,
        Self::ProgramEnd,
        Self::Resuming,
    ];

    /// Situation that the model shows.
    #[must_use]
    pub(crate) fn of(model: &ScreenModel) -> Self {
        match (&model.stage, model.mode) {
            (ScreenStage::Setup, _) => Self::Setup,
            (ScreenStage::Ended(_), _) => Self::Ended,
            (ScreenStage::Resuming, _) => Self::Resuming,
            (ScreenStage::Job, _) if model.hold_reason == HoldReason::Paused || model.pause.is_some() => Self::Paused,
            (ScreenStage::Job, Mode::Run) if model.is_at_program_end() => Self::ProgramEnd,
            (ScreenStage::Job, Mode::Run) => Self::Run,
            // A handwheel that is held moves nothing until it is taken again.
            (ScreenStage::Job, Mode::Wheel) if model.hold_reason != HoldReason::Hold => Self::Wheel,
            (ScreenStage::Job, _) => Self::Retrace,
        }
    }

    /// Situation in words, for the key list.
    #[must_use]
    pub(crate) const fn text(self) -> &'static str {
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

/// Row of the key table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    /// Keys, any of which works.
    pub keys: &'static [Key],
    /// Label of the keys.
    pub shown: &'static str,
    /// Function in a word.
    pub short: &'static str,
    /// Function in one line of the help.
    pub long: &'static str,
    /// Situations, as a bit mask.
    pub situations: u8,
    /// Function.
    pub action: KeyAction,
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
/// Every situation.
const EVER: u8 = ALWAYS | RESUMING;
/// No job runs, or the job can be released.
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
    Row { keys, shown, short, long, situations: when, action: act }
}

/// Key table.
#[rustfmt::skip]
pub(crate) const TABLE: &[Row] = &[
    row(&[Key::Char('c')], "c", "start", "cycle start: start, or continue after a hold or stop", ALWAYS,
        KeyAction::CycleStart),
    row(&[Key::Char(' '), Key::Char('h')], "Space", "hold", "feed hold, at any time (h too); stops a jog",
        SETUP | JOB | RESUMING, KeyAction::Hold),
    row(&[Key::Char('r')], "r", "reverse", "reverse run; again: 50, 25, 10 %, 100 %", MOVING, KeyAction::Reverse),
    row(&[Key::Char('R')], "R", "rapid back", "rapid reverse run: up to 800 % with the cutter off", MOVING,
        KeyAction::ReverseRapid),
    row(&[Key::Char('f')], "f", "forward", "forward run over retraced path; again: 50, 25, 10 %", RETRACE | WHEEL,
        KeyAction::Forward),
    row(&[Key::Char('F')], "F", "rapid fwd", "rapid forward run, to the furthest place", RETRACE | WHEEL,
        KeyAction::ForwardRapid),
    row(&[Key::Char('w')], "w", "wheel", "handwheel: arrows and mouse wheel move the machine",
        RUN | RETRACE | PROGRAM_END, KeyAction::Wheel),
    row(ARROWS, "← →", "turn", "turn the wheel; PgUp PgDn: ten counts", WHEEL, KeyAction::Turn),
    row(&[Key::Char('l')], "l", "leave", "forward to the furthest place, then resume", RETRACE | WHEEL,
        KeyAction::Leave),
    row(&[Key::Char('L')], "L", "leave, ask", "as l, but ask before outputs are restored", RETRACE | WHEEL,
        KeyAction::LeaveAsk),
    row(&[Key::Char('y')], "y", "confirm", "confirm the outputs, or answer yes", RETRACE | WHEEL | RESUMING,
        KeyAction::Agree),
    row(&[Key::Char('n')], "n", "no", "answer no", RETRACE | WHEEL | RESUMING, KeyAction::Decline),
    row(&[Key::Char('b')], "b", "back mm", "back by a distance in mm, or to a contour: c3", MOVING, KeyAction::BackBy),
    row(&[Key::Char('B')], "B", "block", "back to the start of this block", MOVING, KeyAction::BackBlock),
    row(&[Key::Char('j')], "j", "pierce", "back to the last pierce, where the cutter came on", MOVING,
        KeyAction::BackJet),
    row(&[Key::Char('J')], "J", "cut end", "back to shortly before the end of an interrupted cut", MOVING,
        KeyAction::BackToCutEnd),
    row(&[Key::Char('K')], "K", "cut here", "FIRE and cut from here: execute the program again", RETRACE | WHEEL,
        KeyAction::CutFromHere),
    row(&[Key::Char('D')], "D", "shift", "shift the start of the cut: 1.5,-0.8 mm, nw, 0", RUN | RETRACE | WHEEL,
        KeyAction::Shift),
    row(&[Key::Char('+'), Key::Char('=')], "+", "faster", "feed override 10 % up; rapids have their own", JOB,
        KeyAction::Faster),
    row(&[Key::Char('-')], "-", "slower", "feed override 10 % down", JOB, KeyAction::Slower),
    row(&[Key::Char('0')], "0", "100 %", "feed override 100 %", JOB, KeyAction::Whole),
    row(&[Key::Char(')')], ")", "S up", "spindle speed override 10 % up", JOB, KeyAction::SpindleFaster),
    row(&[Key::Char('(')], "(", "S down", "spindle speed override 10 % down", JOB, KeyAction::SpindleSlower),
    row(&[Key::Char('*')], "*", "rapids", "rapid override: 50, 25, 0 %, 100 %", JOB, KeyAction::RapidOverride),
    row(&[Key::Char('s')], "s", "single", "single block on, off", JOB, KeyAction::Single),
    row(&[Key::Char('p')], "p", "pause", "pause: move away from the path and return", RUN, KeyAction::Pause),
    row(&[Key::Char('P')], "P", "park", "pause, and go to the park position for a change", RUN | RETRACE | WHEEL,
        KeyAction::Park),
    row(&[Key::Char('I')], "I", "pointer", "pause, and move the pointer over the place of the tool",
        RUN | RETRACE | WHEEL | PAUSED, KeyAction::Pointer),
    row(&[Key::Char('P')], "P", "change done", "the change is done: return to the path", PAUSED,
        KeyAction::ChangeDone),
    row(&[Key::Char('x'), Key::Char('X')], "x", "cutter off", "cutter off at once, in any situation", EVER,
        KeyAction::CutterOff),
    row(&[Key::Char('i')], "i", "cutter on", "cutter on, where manual cutting is permitted", MOVING,
        KeyAction::CutterOn),
    row(&[Key::Char('!')], "!", "test pulse", "test pulse of the cutter at rest, after a question",
        SETUP | MOVING | PAUSED, KeyAction::TestPulse),
    row(&[Key::Char('V')], "V", "sense test", "sense the sheet, with the cutter off, after a question",
        SETUP | MOVING, KeyAction::SenseTest),
    row(&[Key::Char('W')], "W", "wear", "wear of the consumables; new ones are counted from 0",
        SETUP | JOB, KeyAction::ConsumablesChanged),
    row(&[Key::Char('N')], "N", "skip", "skip the rest of the contour: pass it with the cutter off",
        RUN | RETRACE | WHEEL, KeyAction::SkipContour),
    row(&[Key::Char('k')], "k", "recover", "back to shortly before the end of the cut, FIRE, cut on", 
        RUN | RETRACE | WHEEL,
        KeyAction::Recover),
    row(&[Key::Char('S')], "S", "spindle", "stop the spindle; again: restart it", PAUSED, KeyAction::Spindle),
    row(&[Key::Char('G')], "G", "by hand", "in a held thread: axes follow the spindle turned by hand", RUN | RETRACE,
        KeyAction::FollowSpindle),
    row(&[Key::Char(']')], "]", "higher", "height control: the torch one step higher", RUN | RETRACE,
        KeyAction::HeightUp),
    row(&[Key::Char('[')], "[", "lower", "height control: the torch one step lower", RUN | RETRACE,
        KeyAction::HeightDown),
    row(&[Key::Char(';')], ";", "height 0", "height control: back to the voltage of the material", RUN | RETRACE,
        KeyAction::HeightReset),
    row(&[Key::Char('|')], "|", "height", "height control on, off; while off, the height is held", RUN | RETRACE,
        KeyAction::HeightControl),
    row(&[Key::Char('M')], "M", "M1 stop", "optional stop (M1) on, off", SETUP | JOB, KeyAction::OptionalStop),
    row(&[Key::Char('z')], "z", "tool length", "new tool length, spindle off: 84.2 mm, +0.35, at 0", PAUSED,
        KeyAction::ToolLength),
    row(&[Key::Char('n')], "n", "on line", "return to on-line mode", PAUSED, KeyAction::Online),
    row(ARROWS, "arrows", "jog", "← → X, ↑ ↓ Y, PgUp PgDn Z, by the jog step", SETUP | PAUSED, KeyAction::Jog),
    row(&[Key::Char('[')], "[", "jog -", "jog the selected axis, negative", SETUP | PAUSED, KeyAction::JogDown),
    row(&[Key::Char(']')], "]", "jog +", "jog the selected axis, positive", SETUP | PAUSED, KeyAction::JogUp),
    row(&[Key::Tab], "Tab", "axis", "select the axis for [ and ]", SETUP | PAUSED, KeyAction::NextAxis),
    row(&[Key::Char('t')], "t", "step", "jog step: 0.01 to 10 mm; held to run, or slowly", SETUP | PAUSED,
        KeyAction::Step),
    row(&[Key::Char('u')], "u", "set up", "release the job and set up: home, jog, MDI, zero", ENDED | PROGRAM_END,
        KeyAction::SetUp),
    row(&[Key::Char('O')], "O", "open", "open another program; Tab completes its name", FREE, KeyAction::OpenProgram),
    row(&[Key::Char('H')], "H", "home", "home all axes", SETUP, KeyAction::Home),
    row(&[Key::Char('m')], "m", "MDI", "execute one MDI block", SETUP, KeyAction::Mdi),
    row(&[Key::Char('P')], "P", "probe", "probe a surface, an edge, a corner, a bore, a tool", SETUP, KeyAction::Probe),
    row(&[Key::Char('z')], "z", "zero", "set the work zero here, one axis or all; straight: no turn", SETUP,
        KeyAction::WorkZero),
    row(&[Key::Char('E')], "E", "sheet", "edge of the sheet: two points set zero and turn; each is asked", SETUP,
        KeyAction::SheetEdge),
    row(&[Key::Char('F')], "F", "frame", "go round what is cut, cutters off: its rectangle along X and Y", SETUP,
        KeyAction::Frame),
    row(&[Key::Char('U')], "U", "tight frame", "go round what is cut, cutters off: its outline, as it is turned", SETUP,
        KeyAction::Outline),
    row(&[Key::Char('d')], "d", "dry run", "dry run: the cutter stays off", SETUP, KeyAction::DryRun),
    row(&[Key::Char('C')], "C", "contours", "the contours: what is cut of each; Enter goes there", EVER,
        KeyAction::Contours),
    row(&[Key::Char('Q')], "Q", "jobs", "the jobs of the shop in their order; c starts a piece", EVER,
        KeyAction::ShopJobs),
    row(&[Key::Char('T')], "T", "tools", "the tool table", EVER, KeyAction::Tools),
    row(&[Key::Char('o')], "o", "output", "switch an output: number or name, then + or -", SETUP | JOB,
        KeyAction::Output),
    row(&[Key::Char('a')], "a", "reset", "alarm reset", ALWAYS, KeyAction::ClearAlarm),
    row(&[Key::Char('v')], "v", "view", "next view of the drawing", EVER, KeyAction::View),
    row(&[Key::Char('>'), Key::Char('.')], ">", "zoom in", "enlarge the drawing", EVER, KeyAction::ZoomIn),
    row(&[Key::Char('<'), Key::Char(',')], "<", "zoom out", "reduce the drawing", EVER, KeyAction::ZoomOut),
    row(SHIFT_ARROWS, "Shift ←", "pan", "Shift and an arrow: pan the enlarged drawing", EVER, KeyAction::Pan),
    row(&[Key::Char('e')], "e", "fit", "fit the drawing to the table; again: to the program", EVER, KeyAction::Fit),
    row(&[Key::Char('g')], "g", "log", "all messages", EVER, KeyAction::Messages),
    row(&[Key::Char('?')], "?", "keys", "all keys", EVER, KeyAction::Help),
    row(&[Key::Char('q'), Key::Interrupt], "q", "quit", "stop the job, after a question; without a job: quit", EVER,
        KeyAction::Quit),
];

/// Row of a key in a situation, if the key has a function there.
#[must_use]
pub(crate) fn row_of(key: Key, situation: Situation) -> Option<&'static Row> {
    TABLE.iter().find(|row| row.keys.contains(&key) && row.situations & situation as u8 != 0)
}

/// Row of a key that has no function here, and a situation in which it has one.
#[must_use]
pub(crate) fn row_elsewhere(key: Key) -> Option<(&'static Row, Situation)> {
    let row = TABLE.iter().find(|row| row.keys.contains(&key))?;
    Situation::ALL.into_iter().find(|&s| row.situations & s as u8 != 0).map(|situation| (row, situation))
}

/// Row of a function.
#[must_use]
pub(crate) fn row_for(act: KeyAction) -> Option<&'static Row> {
    TABLE.iter().find(|row| row.action == act)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_does_two_things_in_one_situation_and_every_act_has_one_row() {
        for situation in Situation::ALL {
            let mut seen = std::collections::HashSet::new();
            for row in TABLE.iter().filter(|row| row.situations & situation as u8 != 0) {
                for key in row.keys {
                    assert!(seen.insert(key), "{key:?} twice {}", situation.text());
                }
            }
        }
        let acts: std::collections::HashSet<_> = TABLE.iter().map(|row| row.action).collect();
        assert_eq!(acts.len(), TABLE.len());
    }

    #[test]
    fn a_hold_is_one_key_away_wherever_something_may_move() {
        for situation in Situation::ALL.into_iter().filter(|&s| s != Situation::Ended) {
            assert_eq!(row_of(Key::Char(' '), situation).map(|row| row.action), Some(KeyAction::Hold));
        }
    }

    #[test]
    fn a_held_handwheel_is_taken_again_by_its_key() {
        let machine = retrace_config::MachineConfig::built_in().expect("valid");
        let mut model = ScreenModel::new(std::sync::Arc::new(crate::ProgramFacts::of(&machine, "a.ngc", "")));
        (model.stage, model.mode) = (ScreenStage::Job, Mode::Wheel);
        for (hold_reason, taken, turned) in
            [(HoldReason::None, None, Some(KeyAction::Turn)), (HoldReason::Hold, Some(KeyAction::Wheel), None)]
        {
            model.hold_reason = hold_reason;
            let action = |key| row_of(key, Situation::of(&model)).map(|row| row.action);
            assert_eq!([action(Key::Char('w')), action(Key::Left)], [taken, turned], "{hold_reason:?}");
        }
    }
}
