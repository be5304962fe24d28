//! Commands of the operator, and why one is rejected.
//!
//! Invariant: a command is shown by the words that it is given by.

use std::fmt;

use retrace_core::mode::ModeError;
use retrace_core::{Rate, interruption};

use crate::lead_arc::LeadArcError;
use crate::tool_length::{EnteredLength, ToolLengthError};

/// Time at which an instruction is due.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ScriptTime {
    /// At a machine time, s.
    Time(f64),
    /// When this program line is being executed.
    Line(u32),
    /// Seconds after the previous instruction.
    AfterSeconds(f64),
    /// Control periods after the previous instruction.
    AfterPeriods(u64),
}

/// How a cutter starts where the program is executed again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CutStart {
    /// A torch with an `ok` input starts in motion inside a cut, everything else pierces.
    Usual,
    /// It pierces.
    Pierce,
    /// It starts in motion, along the kerf that is there.
    Moving,
}

/// Where a cutter starts beside the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shift {
    /// At this distance in X and Y, mm.
    To([f64; 2]),
    /// So many widths of the kerf further in X and Y than before.
    Steps([i8; 2]),
}

/// How a cutter that starts beside the path leads in to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LeadShape {
    /// Along a straight line.
    #[default]
    Line,
    /// Along an arc that meets the path in its direction.
    Arc,
}

/// Side of the path on which a shifted start lies, seen in the direction of motion (CUT-37).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StartSide {
    /// Whether it lies to the left.
    pub is_left: bool,
    /// Whether that is the side of the part; `None` where no cutter compensation was on in the contour.
    pub is_part: Option<bool>,
}

impl StartSide {
    /// The side as one word: `left` or `right`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        if self.is_left { "left" } else { "right" }
    }

    /// What lies there, as one word: `part` or `scrap`, if that is known.
    #[must_use]
    pub fn material_name(self) -> Option<&'static str> {
        self.is_part.map(|is_part| if is_part { "part" } else { "scrap" })
    }
}

/// What the operator does with height control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeightCommand {
    /// One step higher: a higher voltage.
    Up,
    /// One step lower.
    Down,
    /// To the voltage of the material again.
    Reset,
    /// Whether the height is controlled; otherwise it is held.
    Control(bool),
}

/// A command of the operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OperatorCommand {
    /// Feed hold.
    Hold,
    /// Resume after a hold, at a program stop, or in single block.
    Resume,
    /// Reverse run at this rate.
    Reverse(Rate),
    /// Forward run at this rate.
    Forward(Rate),
    /// Feed override. Rapid motion keeps its speed, but rests at 0 as all motion does.
    Override(Rate),
    /// Rapid override, 0 … 1.
    RapidOverride(Rate),
    /// Override of the speed of the spindle, 0.1 … 2.
    SpeedOverride(Rate),
    /// Turns the handwheel at a constant speed for some time.
    Wheel {
        /// Counts per second, signed.
        counts_per_s: f64,
        /// Duration, s.
        seconds: f64,
    },
    /// Leaves reverse run, forward run or the handwheel: the machine runs forward to `reached` and resumes normal run.
    Leave {
        /// Whether to stop at `reached` where outputs differ, until [`OperatorCommand::Confirm`].
        ask: bool,
    },
    /// Confirms the outputs that are to be restored.
    Confirm,
    /// Starts the cutter again where it went out, and resumes the program. Also confirms the outputs that are to be
    /// restored.
    Recover,
    /// Passes the rest of the contour with its cutter off, and continues the program.
    SkipContour,
    /// Passes a contour that is not begun yet with its cutter off once it is reached, or cuts it after all.
    SkipContourAhead {
        /// Its number.
        number: u32,
        /// Whether it is skipped.
        on: bool,
    },
    /// Lists the contours with their states. The observers of the job answer it; the machine does nothing.
    Contours,
    /// The consumables of the cutters are new: their wear is counted from here on. The observers of the job do it.
    ConsumablesChanged,
    /// Switches every cutter off immediately.
    CutterOff,
    /// Switches the cutter on manually.
    CutterOn,
    /// Switches the cutter on for the time of a test pulse, at rest.
    TestPulse,
    /// Senses the sheet at rest, with the cutter off, and returns the tool (CUT-57).
    SenseTest,
    /// Optional stop: whether M1 stops the program.
    OptionalStop(bool),
    /// Switches an output manually.
    Output {
        /// Channel number: 0 … 63, or 64 for the output of M3.
        number: u8,
        /// On or off.
        on: bool,
    },
    /// Toggles single block.
    Single,
    /// Stops the job.
    Stop,
    /// Reverse run at full rate over this length of path in mm, then rest.
    BackBy(f64),
    /// Reverse run to the beginning of the current block; from its beginning, to that of the block before.
    BackToBlock,
    /// Reverse run to the last place at which a cutting output was switched on.
    BackToPierce,
    /// Reverse run to the place from which an interrupted cut is continued.
    BackToCutEnd,
    /// Reverse run to a contour: to the end of its kerf where it is cut in part, otherwise to its pierce.
    BackToContour(u32),
    /// Executes the program again from here, where the path is being retraced. Contours behind that are cut already are
    /// passed with the cutter off.
    CutFromHere(CutStart),
    /// Executes the program again from here, and cuts every contour again.
    CutAll,
    /// Executes the program again from here once the operator agrees to the outputs that differ.
    CutAsk,
    /// Shifts the next start of the cutter beside the path.
    Shift(Shift),
    /// How shifted starts lead in.
    Lead(LeadShape),
    /// *Pause*: interrupts the program at a breakpoint (DNC-1).
    Pause,
    /// Stops the spindle manually (DNC-3).
    SpindleStop,
    /// Starts the spindle manually, with the direction and speed that it had (DNC-4).
    SpindleStart,
    /// Jogs an axis by a distance in mm (degrees).
    Jog {
        /// Axis letter, lower case.
        axis: char,
        /// Distance, signed.
        mm: f64,
    },
    /// Length of a tool that was changed in a pause.
    ToolLength(EnteredLength),
    /// Pauses the program, if it is not paused, and moves the axes to the park position (CUT-34).
    Park,
    /// Pauses the program, if it is not paused, and moves the pointer over the place of the tool (CUT-37).
    Pointer,
    /// Brings the axes back from the park position, or from where the pointer was: the steps of the pause that are
    /// missing, up to *cycle start*.
    ChangeDone,
    /// Changes what height control aims at (CUT-56).
    Height(HeightCommand),
    /// Lets the motion follow the spindle by hand, in a thread or tap that is held (SPN-23).
    FollowSpindle(bool),
    /// Says that the tool is free of the thread in which it rests, or behind which: it is retraced by rate (SPN-22).
    ToolFree,
    /// Returns to on-line mode (DNC-5).
    Online,
    /// *Cycle start* (DNC-6). The same as [`OperatorCommand::Resume`] where nothing is paused.
    CycleStart,
}

impl LeadShape {
    /// Its word: `line` or `arc`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Line => "line",
            Self::Arc => "arc",
        }
    }
}

impl fmt::Display for OperatorCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hold => write!(f, "hold"),
            Self::Resume => write!(f, "resume"),
            Self::Reverse(rate) => write!(f, "reverse {:.0}%", rate_percent(*rate)),
            Self::Forward(rate) => write!(f, "forward {:.0}%", rate_percent(*rate)),
            Self::Override(rate) => write!(f, "override {:.0}%", rate_percent(*rate)),
            Self::RapidOverride(rate) => write!(f, "rapid override {:.0}%", rate_percent(*rate)),
            Self::SpeedOverride(rate) => write!(f, "speed override {:.0}%", rate_percent(*rate)),
            Self::Wheel { counts_per_s, seconds } => write!(f, "wheel {counts_per_s} for {seconds}s"),
            Self::Leave { ask: false } => write!(f, "leave"),
            Self::Leave { ask: true } => write!(f, "leave ask"),
            Self::Confirm => write!(f, "agree"),
            Self::Recover => write!(f, "recover"),
            Self::SkipContour => write!(f, "skip contour"),
            Self::SkipContourAhead { number, on: true } => write!(f, "skip contour {number}"),
            Self::SkipContourAhead { number, on: false } => write!(f, "skip contour {number} off"),
            Self::Contours => write!(f, "contours"),
            Self::ConsumablesChanged => write!(f, "consumables changed"),
            Self::CutterOff => write!(f, "cutter off"),
            Self::CutterOn => write!(f, "cutter on"),
            Self::TestPulse => write!(f, "test pulse"),
            Self::SenseTest => write!(f, "sense test"),
            Self::OptionalStop(on) => write!(f, "optional stop {}", if *on { "on" } else { "off" }),
            Self::Output { number, on } => write!(f, "output {number} {}", if *on { "on" } else { "off" }),
            Self::Single => write!(f, "single"),
            Self::Stop => write!(f, "stop"),
            Self::BackBy(mm) => write!(f, "back {mm} mm"),
            Self::BackToBlock => write!(f, "back to block"),
            Self::BackToPierce => write!(f, "back to pierce"),
            Self::BackToCutEnd => write!(f, "back to cut end"),
            Self::BackToContour(number) => write!(f, "back to contour {number}"),
            Self::CutAll => write!(f, "cut all"),
            Self::CutAsk => write!(f, "cut ask"),
            Self::Shift(Shift::To([x, y])) => write!(f, "shift {x} {y}"),
            Self::Shift(Shift::Steps(steps)) => {
                let found = DIRECTIONS.iter().find(|(_, direction)| direction == steps);
                write!(f, "shift {}", found.map_or("0", |(name, _)| name))
            }
            Self::Lead(shape) => write!(f, "lead {}", shape.name()),
            Self::CutFromHere(CutStart::Usual) => write!(f, "cut"),
            Self::CutFromHere(CutStart::Pierce) => write!(f, "cut pierce"),
            Self::CutFromHere(CutStart::Moving) => write!(f, "cut moving"),
            Self::Pause => write!(f, "pause"),
            Self::Park => write!(f, "park"),
            Self::Pointer => write!(f, "pointer"),
            Self::ChangeDone => write!(f, "change done"),
            Self::SpindleStop => write!(f, "spindle stop"),
            Self::SpindleStart => write!(f, "spindle start"),
            Self::Jog { axis, mm } => write!(f, "jog {axis} {mm}"),
            Self::ToolLength(length) => write!(f, "{length}"),
            Self::Height(HeightCommand::Up) => write!(f, "height up"),
            Self::Height(HeightCommand::Down) => write!(f, "height down"),
            Self::Height(HeightCommand::Reset) => write!(f, "height reset"),
            Self::Height(HeightCommand::Control(on)) => write!(f, "height control {}", if *on { "on" } else { "off" }),
            Self::FollowSpindle(true) => write!(f, "follow spindle"),
            Self::FollowSpindle(false) => write!(f, "follow off"),
            Self::ToolFree => write!(f, "tool free"),
            Self::Online => write!(f, "online"),
            Self::CycleStart => write!(f, "cycle start"),
        }
    }
}

/// Reason why a command of the operator was rejected. A rejected command changes nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommandError {
    /// The command does not apply in the current mode.
    Mode(ModeError),
    /// The override is above this maximum, which is in force now.
    AboveMaxOverride(Rate),
    /// The queue of override changes is full.
    TooManyOverrides,
    /// The card has no such output.
    NoOutput(u8),
    /// No cutting output was switched on within the retained history.
    NoPierce,
    /// No cut was interrupted.
    NoCutEnd,
    /// Nothing has been executed yet that could be retraced.
    NothingBehind,
    /// The step is not the next one in the sequence of a DNC pause (DNC-1 … DNC-8).
    Interrupted(interruption::InterruptionError),
    /// The axis is at its soft limit already, or the destination is beyond it.
    BeyondLimit(char),
    /// No arc leads in from the shifted start.
    NoLeadArc(LeadArcError),
    /// The machine has no such axis.
    NoAxis(char),
    /// The tool length cannot be entered.
    ToolLength(ToolLengthError),
    /// The command does not apply now; the reason.
    NotNow(&'static str),
}

impl fmt::Display for CommandError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mode(ModeError::NotRetracing) => "`leave` does nothing in normal run: the path is not being retraced",
            Self::Mode(ModeError::NothingToConfirm) => "there is nothing to confirm",
            Self::Mode(ModeError::NotHeld) => "no feed hold is in force",
            Self::Mode(ModeError::RateNotPositive) => "a rate above 0 % is needed",
            Self::TooManyOverrides => "too many override changes are pending; try again in a moment",
            Self::NoPierce => "no cutting output was switched on within the retained history",
            Self::NoCutEnd => "no cut was interrupted",
            Self::NothingBehind => "nothing has been executed yet that could be reversed over",
            Self::Interrupted(refused) => return crate::dnc_events::explain(*refused, f),
            Self::ToolLength(why) => return write!(f, "{why}"),
            Self::NotNow(why) => why,
            Self::NoLeadArc(why) => return write!(f, "{why}"),
            Self::AboveMaxOverride(most) => return write!(f, "the maximum is {:.0} %", rate_percent(*most)),
            Self::BeyondLimit(axis) => {
                return write!(f, "axis {} would go beyond its soft limit", axis.to_ascii_uppercase());
            }
            Self::NoAxis(axis) => return write!(f, "the machine has no axis {}", axis.to_ascii_uppercase()),
            Self::NoOutput(number) => return write!(f, "the card has no output {number}"),
        })
    }
}

impl std::error::Error for CommandError {}

impl From<ModeError> for CommandError {
    fn from(refused: ModeError) -> Self {
        Self::Mode(refused)
    }
}

impl From<interruption::InterruptionError> for CommandError {
    fn from(refused: interruption::InterruptionError) -> Self {
        Self::Interrupted(refused)
    }
}

/// One line of a script.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScriptInstruction {
    /// Line number in the script.
    pub line: u32,
    /// Time at which the instruction is due.
    pub when: ScriptTime,
    /// Command to execute.
    pub command: OperatorCommand,
}

/// Words for the eight directions, with their steps in X and Y.
pub(crate) const DIRECTIONS: [(&str, [i8; 2]); 8] = [
    ("n", [0, 1]),
    ("ne", [1, 1]),
    ("e", [1, 0]),
    ("se", [1, -1]),
    ("s", [0, -1]),
    ("sw", [-1, -1]),
    ("w", [-1, 0]),
    ("nw", [-1, 1]),
];

/// Rate in per cent.
#[must_use]
pub fn rate_percent(rate: Rate) -> f64 {
    f64::from(rate) * 100.0
}
