//! What the planning thread hands to the motion path beside records: switching, messages, the end.
//!
//! Invariant: an item is sent before the first record at or beyond its place, so that whoever has seen that record has seen the
//! item (GMC-3: the front marker stands in the stream at its place).

use retrace_gcode::ActiveCodes;
use retrace_link::{InputWait, MAX_CHANGES, OutputAction, OutputChange};

use crate::place_index::MarkDifference;

/// What an exclusive instruction is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExclusiveKind {
    /// An M, S or T code that switches outputs.
    #[default]
    Switch,
    /// A dwell (G4).
    Dwell,
    /// A program stop (M0, M60): waits for cycle start.
    ProgramStop,
    /// An optional program stop (M1): waits for cycle start where the switch for optional stops is on.
    OptionalStop,
    /// A tool change by hand (M6): waits for cycle start.
    ToolChange,
}

/// An exclusive instruction, not yet numbered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExclusiveInstruction {
    /// The record before which it stands.
    pub place: u32,
    /// Its program line.
    pub line: u32,
    /// What it is.
    pub kind: ExclusiveKind,
    /// As it is written in the program, for messages: `M3`, `G4` …
    pub code: &'static str,
    /// The outputs it switches, the first `count` of them.
    pub changes: [OutputChange; MAX_CHANGES],
    /// How many of `changes` hold.
    pub count: u8,
    /// Control periods that it takes at least.
    pub periods: u32,
    /// What it waits for besides.
    pub until: Option<InputWait>,
    /// It cannot be passed backward (tool change).
    pub one_way: bool,
}

/// How the program came to its end.
#[derive(Clone, Debug, PartialEq)]
pub enum PlanEnd {
    /// M2, M30, or the end of the file.
    Completed,
    /// It has an error, found only now (a program that was fed and could not be scanned before): rendered.
    Refused(String),
}

/// What the program came to.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanSummary {
    /// How it ended.
    pub ending: PlanEnd,
    /// Blocks executed.
    pub blocks: u64,
    /// Canonical functions.
    pub canonical: u64,
    /// End position of each of the machine's axes, in mm.
    pub commanded_mm: Vec<f64>,
}

/// One item.
#[derive(Clone, Debug, PartialEq)]
pub enum PathItem {
    /// An exclusive instruction.
    Exclusive(ExclusiveInstruction),
    /// A synchronous action and its program line; line 0 where an exclusive instruction that was told of has done it already.
    Action(OutputAction, u32),
    /// A message of the program, to be shown when the motion comes to the place.
    Message {
        /// The record before which it stands.
        place: u32,
        /// Its program line.
        line: u32,
        /// The text.
        text: String,
    },
    /// The modal state that is in force from a place on.
    Active {
        /// The record before which it stands.
        place: u32,
        /// The state.
        active: Box<ActiveCodes>,
    },
    /// A place of the plan is not as it was when the job ran before.
    Differs(Box<MarkDifference>),
    /// All marks that were given were passed.
    MarksPassed,
    /// Nothing follows.
    End(PlanSummary),
}
