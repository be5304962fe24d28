//! Errors of canonical functions that cannot be executed on a machine.
//!
//! Invariant: each has a number in `docs/errors.md`, a cause and a remedy.

use retrace_config::AnalogOutput;
use retrace_motion::MoveError;

use crate::check_finding::CheckFinding;
use crate::plan_writer::PlanWriteError;
use crate::soft_limits::LimitFinding;
use crate::thread_plan::ThreadError;

/// Reason why a canonical function cannot be executed on this machine.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum CanonError {
    /// E4301: an axis is moved that the machine does not have.
    NoSuchAxis(char),
    /// E4302: a canonical function that is not supported yet.
    NotSupported(&'static str),
    /// E4303: an output that the card does not have.
    NoSuchOutput(i32),
    /// E4304: a move would leave the soft limits.
    BeyondLimit(LimitFinding),
    /// E4306: a rapid move while the cutter of this name is on.
    RapidWhileLit(String),
    /// E4307: this code switches the cutter of this name on in passing, although its start takes time.
    LitInPassing(&'static str, String),
    /// E4308: a dwell of more than so many seconds while the cutter of this name is on.
    LitDwell(String, f64),
    /// E4309: the power of a beam changes in passing at a feed above this one.
    PowerTooFast {
        /// Highest feed in mm/min.
        most_mm_min: f64,
    },
    /// E4314: M66 waits while a cutter is on.
    LitWait,
    /// E4313: M66 reads an input that the machine file does not declare.
    NoInput(i32),
    /// E4332: M66 reads an analog input that the machine file does not declare.
    NoAnalogInput(i32),
    /// E4330: M67 or M68 sets an analog output that the machine file does not declare.
    NoAnalogOutput(&'static str, i32),
    /// E4331: M67 or M68 sets an analog output to this amount, out of its range.
    AnalogRange(&'static str, f64, AnalogOutput),
    /// E4310: the machine has no probe.
    NoProbe,
    /// E4311: the machine would not stop within `overtravel_mm` behind the touch.
    ProbeTooFast {
        /// The limit, mm.
        overtravel_mm: f64,
        /// Highest feed in mm/min.
        most_mm_min: f64,
    },
    /// E4315: a feed per turn, for this reason.
    FeedPerTurn(&'static str),
    /// E4320: a thread on a machine without an encoder with an index.
    NoEncoder,
    /// E4321: a thread with the spindle at no speed.
    ThreadWithoutSpeed,
    /// E4322 … E4325: a thread that the machine cannot cut; it begins in this line.
    Thread(ThreadError, u32),
    /// E4316: a probing move at a feed per turn.
    FeedPerTurnInProbing,
    /// E4317: G96 without a highest speed.
    SurfaceSpeed,
    /// E4318: M19 to an angle in degrees other than the drive's, which is the second one.
    OrientAngle(f64, f64),
    /// E4312: the spindle or a cutter is on in a probing move.
    SpindleInProbing,
    /// E2216: an answer in the journal is not one to the program's question.
    AnswerMismatch,
    /// The planner rejected the move.
    Move(MoveError),
    /// The job was cancelled.
    Cancelled,
}

impl CanonError {
    /// Number, cause and remedy.
    fn parts(&self) -> (&'static str, String, &'static str) {
        match self {
            Self::NoSuchAxis(axis) => (
                "E4301",
                format!("axis {axis} is moved, and the machine has no such axis"),
                "add the axis to the machine file, or take its words out of the program",
            ),
            Self::NotSupported(what) => ("E4302", format!("{what} is not supported yet"), "take it out of the program"),
            Self::NoSuchOutput(n) => ("E4303", format!("there is no output {n}"), "an output is a number from 0 to 63"),
            Self::BeyondLimit(beyond) => (LimitFinding::NUMBER, beyond.what(), LimitFinding::REMEDY),
            Self::RapidWhileLit(cutter) => (
                "E4306",
                format!("a rapid move (G0) while the {cutter} is on"),
                "switch it off before the move (M5, M65 …), use G1, or write rapid_lit = true in its [[cutter]] table",
            ),
            Self::LitInPassing(code, cutter) => (
                "E4307",
                format!("{code} switches the {cutter} on without a stop, and its start takes time"),
                "switch it on by M3 or M64, or by a code with class = \"exclusive\"",
            ),
            Self::LitDwell(cutter, most_s) => (
                "E4308",
                format!("a dwell (G4) of more than {most_s} s while the {cutter} is on"),
                "switch it off before the dwell, shorten it, or write a longer dwell_lit_s in its [[cutter]] table",
            ),
            Self::PowerTooFast { most_mm_min } => (
                "E4309",
                format!(
                    "raster engraving: the power changes within a cut at a feed above {most_mm_min:.0} mm/min, beyond \
                     which its place would be more than 0.05 mm off"
                ),
                "a lower F, or a shorter control_period_ms",
            ),
            Self::LitWait => (
                "E4314",
                "M66 waits for an input while a cutter is on, which the card switches off at rest".into(),
                "switch the cutter off before the wait",
            ),
            Self::NoInput(input) => (
                "E4313",
                format!("M66 reads input {input}, which the machine file does not declare"),
                "declare it: [[card.input]] with its number and its use, \"plain\" for one that only programs read",
            ),
            Self::NoAnalogInput(number) => (
                "E4332",
                format!("M66 reads the analog input {number}, which the machine file does not declare"),
                "declare it: [[card.analog_input]] with its number, name, unit and at_full",
            ),
            Self::NoAnalogOutput(code, number) => (
                "E4330",
                format!("{code} sets the analog output {number}, which the machine file does not declare"),
                "declare it: [[card.analog_output]] with its number, name, unit, min and max",
            ),
            Self::AnalogRange(code, amount, of) => (
                "E4331",
                format!(
                    "{code} sets {} to {amount} {unit}; its range is {} to {} {unit}",
                    of.name,
                    of.min,
                    of.max,
                    unit = of.unit
                ),
                "a Q word within the range; or correct min and max of its [[card.analog_output]]",
            ),
            Self::NoProbe => (
                "E4310",
                "a probing move (G38), and the machine file has no probe".into(),
                "declare its input: [[card.input]] with use = \"probe\"",
            ),
            Self::ProbeTooFast { overtravel_mm, most_mm_min } => (
                "E4311",
                format!(
                    "a probing move at a feed from which the machine needs more than {overtravel_mm} mm to stop; at \
                     most {most_mm_min:.0} mm/min stop within them"
                ),
                "a lower F, or a longer overtravel_mm in [probe] if the probe can take it",
            ),
            Self::SpindleInProbing => (
                "E4312",
                "a probing move (G38) while the spindle or a cutter is on".into(),
                "switch it off before (M5); for a spindle that may turn, write spindle = \"may-turn\" in [probe]",
            ),
            Self::FeedPerTurn(why) => (
                "E4315",
                (*why).into(),
                "M3 or M4 before; or G94; or feed_per_turn = \"commanded\" in [spindle], for the feed of the S word",
            ),
            Self::FeedPerTurnInProbing => {
                ("E4316", "a probing move (G38) at a feed per turn (G95)".into(), "G94 and a feed per minute before it")
            }
            Self::NoEncoder => (
                "E4320",
                "a thread (G33, G76), and the machine file has no encoder with an index".into(),
                "counts_per_turn and max_rpm in [spindle], for an encoder on the spindle; index = true if it has one",
            ),
            Self::ThreadWithoutSpeed => (
                "E4321",
                "a thread (G33, G76) with the spindle at no speed".into(),
                "an S word above 0 before it; a thread is planned for the commanded speed",
            ),
            Self::Thread(error @ ThreadError::TooFast { .. }, _) => {
                ("E4322", error.to_string(), "a lower S, or a lower thread_margin_percent in [spindle]")
            }
            Self::Thread(error @ ThreadError::TooShort { .. }, _) => {
                ("E4323", error.to_string(), "begin further away from the work and end behind it, or a lower S")
            }
            Self::Thread(error @ ThreadError::StopsInside, _) => {
                ("E4324", error.to_string(), "G64 P with a tolerance for the corner, before them")
            }
            Self::Thread(error @ ThreadError::TooLong { .. }, _) => {
                ("E4325", error.to_string(), "K is the distance in a turn of the spindle: check it, and S")
            }
            Self::Thread(error @ ThreadError::NotReversible, _) => {
                ("E4326", error.to_string(), "reversible = true in [spindle], if its drive can reverse it")
            }
            Self::Thread(error @ (ThreadError::NoSpeed | ThreadError::Move(_)), _) => {
                ("E4321", error.to_string(), "a higher S; a thread is planned for the commanded speed")
            }
            Self::SurfaceSpeed => (
                "E4317",
                "constant surface speed (G96) without a highest speed: at X 0, the axis of turning, it has no limit"
                    .into(),
                "a D word in the block of G96, the highest speed in turns per minute, or max_rpm in [spindle]",
            ),
            Self::OrientAngle(degrees, own) => (
                "E4318",
                format!("M19 turns the spindle to {degrees}°, and the drive of this machine turns it to {own}° alone"),
                "R with the angle of the drive; if that is another one, correct orient_angle_deg in [spindle]",
            ),
            Self::AnswerMismatch => (
                "E2216",
                "an answer of the machine in the journal is not one to the program's question".into(),
                "the program or its files have changed since; start a new job",
            ),
            Self::Move(error) => (error.number(), error.to_string(), "correct the move"),
            Self::Cancelled => ("", String::new(), ""),
        }
    }

    /// Number, cause and remedy in one line.
    #[must_use]
    pub(crate) fn explain(&self) -> String {
        let (number, what, remedy) = self.parts();
        format!("error[{number}]: {what}; {remedy}")
    }

    /// The error as a finding of program line `line`.
    #[must_use]
    pub(crate) fn finding(&self, line: u32) -> CheckFinding {
        let (number, what, remedy) = self.parts();
        let line = if let Self::Thread(_, begins) = self { *begins } else { line };
        let word = match self {
            Self::NoSuchAxis(axis) => Some(*axis),
            Self::BeyondLimit(beyond) => Some(beyond.axis.to_ascii_uppercase()),
            _ => None,
        };
        CheckFinding { line, word, number, cause: what, remedy: remedy.into(), more_rounds: 0 }
    }
}

impl std::fmt::Display for CanonError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.explain())
    }
}

impl std::error::Error for CanonError {}

impl From<PlanWriteError> for CanonError {
    fn from(refused: PlanWriteError) -> Self {
        match refused {
            PlanWriteError::Move(error) => Self::Move(error),
            PlanWriteError::BeyondLimit(beyond) => Self::BeyondLimit(beyond),
            PlanWriteError::Thread(error, line) => Self::Thread(error, line),
            PlanWriteError::AnswerMismatch => Self::AnswerMismatch,
            PlanWriteError::Cancelled => Self::Cancelled,
        }
    }
}

impl From<crate::plan_writer::Cancelled> for CanonError {
    fn from(_: crate::plan_writer::Cancelled) -> Self {
        Self::Cancelled
    }
}
