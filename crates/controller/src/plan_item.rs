//! Items that the planning thread sends to the motion path in addition to records: switching, messages, the end.
//!
//! Invariant: an item is sent before the first record at or beyond its place, so that a consumer that has seen the
//! record has seen the item (GMC-3: the front marker stands in the stream at its place).

use crate::question::Question;
use retrace_core::RecordIndex;
use retrace_gcode::ActiveCodes;
use retrace_journal::MarkDifference;
use retrace_link::{InputWait, LayerMove, MAX_CHANGES, OutputAction, OutputChange, SpindleTask};

/// Code of an instruction that belongs to the height of a cutter, and to no code of the program.
pub(crate) const HEIGHT: &str = "height";

/// Kind of an exclusive instruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExclusiveKind {
    /// An M, S or T code that switches outputs.
    #[default]
    Switch,
    /// A dwell (G4).
    Dwell,
    /// A program stop (M0, M60): waits for cycle start.
    ProgramStop,
    /// An optional program stop (M1): waits for cycle start where optional stop is on.
    OptionalStop,
    /// A manual tool change (M6): waits for cycle start.
    ToolChange,
    /// A probing move (G38) or a rigid tap that is not answered yet: the machine moves off the path.
    OffPath,
    /// A wait for an input (M66) that is not answered yet.
    Input,
    /// From here on the operator's overrides apply, or do not (M48 … M50). It switches no output.
    FeedOverride {
        /// Whether they apply.
        applies: bool,
    },
}

/// An exclusive instruction without a number.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExclusiveInstruction {
    /// Record before which it is executed.
    pub place: RecordIndex,
    /// Program line.
    pub line: u32,
    /// Kind of instruction.
    pub kind: ExclusiveKind,
    /// Code as written in the program, for messages: `M3`, `G4` …
    pub code: &'static str,
    /// Outputs to switch; the first `count` of them are valid.
    pub changes: [OutputChange; MAX_CHANGES],
    /// Number of valid `changes`.
    pub count: u8,
    /// Minimum duration in control periods.
    pub periods: u32,
    /// Input that it waits for in addition.
    pub until: Option<InputWait>,
    /// Moves of the layer before and behind the switching.
    pub layer: Option<LayerMove>,
    /// Those of a restart, where they differ.
    pub restart_layer: Option<LayerMove>,
    /// Control periods by which the pierce of a restart is longer: this start pierces in motion.
    pub restart_pierce: u32,
    /// Of a start of a cutter: width in µm of the kerf that it begins; 0 where the height is not controlled in it.
    pub kerf_um: Option<u32>,
    /// Whether it is a retrace barrier (tool change).
    pub is_barrier: bool,
    /// The question, of [`ExclusiveKind::OffPath`] and [`ExclusiveKind::Input`].
    pub question: Option<Box<Question>>,
    /// What it waits for at the spindle.
    pub spindle: Option<SpindleTask>,
}

impl ExclusiveInstruction {
    /// Whether it switches this channel on.
    #[must_use]
    pub fn switches_on(&self, channel: u8) -> bool {
        self.changes[..usize::from(self.count)].iter().any(|change| change.channel == channel && change.value != 0)
    }
}

/// How the program ended.
#[derive(Clone, Debug, PartialEq)]
pub enum PlanEnd {
    /// M2, M30, or the end of the file.
    Completed,
    /// It has an error that was found only now (a streamed program cannot be checked before): rendered.
    BlockError(String),
}

/// Summary of the plan of a program.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanSummary {
    /// How the program ended.
    pub ending: PlanEnd,
    /// Number of blocks executed.
    pub blocks: u64,
    /// Number of canonical functions.
    pub canonical: u64,
    /// End position of each of the machine's axes, mm.
    pub commanded_mm: Vec<f64>,
}

/// An item.
// No box: the motion path, which takes it, must not free memory.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq)]
pub enum PathItem {
    /// An exclusive instruction.
    Exclusive(ExclusiveInstruction),
    /// A synchronous action and its program line. Line 0: an exclusive instruction that was reported has done it
    /// already.
    Action(OutputAction, u32),
    /// A message of the program, to be shown when the motion reaches the place.
    Message {
        /// Record before which it is shown.
        place: RecordIndex,
        /// Program line.
        line: u32,
        /// Text.
        text: String,
    },
    /// The modal state that is in force from a place on.
    Active {
        /// Record before which it takes effect.
        place: RecordIndex,
        /// Modal state.
        active: Box<ActiveCodes>,
    },
    /// A place of the plan differs from the earlier run.
    Differs(Box<MarkDifference>),
    /// All given marks were passed.
    MarksPassed,
    /// End of the plan.
    End(PlanSummary),
}
