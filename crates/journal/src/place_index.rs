//! The index from places to the program, written ahead of what the card may execute (DNC, *Beyond the source*).
//!
//! Planning is a function of the program, the machine file, the machine's initial position, and the overrides above 100
//! % with the places from which they count. So a place is found again by planning again, and the result is compared
//! with the marks: wherever the card has stopped, a mark at or beyond that place is durable.
//!
//! Invariant: an entry about a place is passed on before the records at or beyond that place are released to the motion
//! path. Marks are in the order of their places.

use retrace_core::{Rate, RecordIndex};
use serde::{Deserialize, Serialize};

use crate::durable_place::DurablePlace;

/// State of the program where the records up to a place were planned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlaceMark {
    /// Place, as a record boundary.
    pub place: RecordIndex,
    /// Number of blocks that the decoder has executed up to the one of the record before the place: the block's
    /// instance.
    pub block: u64,
    /// Program line of that record.
    pub line: u32,
    /// Counts of the machine's axes at the place; 0 for missing axes.
    pub counts: [i64; 9],
}

/// A mark that differs from the earlier run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MarkDifference {
    /// The mark of the earlier run.
    pub was: PlaceMark,
    /// The mark as it is planned now.
    pub is: PlaceMark,
}

/// An entered length that applies from behind a block on, until the program changes its tool offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LengthChange {
    /// Number of the decoder's block, from 1, behind which it applies; 0 is the program's beginning.
    pub block: u64,
    /// Distance by which the path is moved along the tool axis, pulses.
    pub pulses: i64,
}

/// An answer of the machine to the program (PRB-14). Planning again uses the answers in their order, and asks nobody.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "of", rename_all = "snake_case")]
pub enum ProgramAnswer {
    /// Of a probing move.
    Probe(ProbeAnswer),
    /// Of a wait for an input (M66).
    Input(InputAnswer),
    /// Of a rigid tap: it is complete, and the tool where it was before.
    Tap(TapAnswer),
}

impl ProgramAnswer {
    /// Block and place that asked.
    #[must_use]
    pub const fn asked_at(&self) -> (u64, u32) {
        match self {
            Self::Probe(answer) => (answer.block, answer.place),
            Self::Input(answer) => (answer.block, answer.place),
            Self::Tap(answer) => (answer.block, answer.place),
        }
    }

    /// The same answer, to this block and place.
    #[must_use]
    pub fn to_question_at(mut self, at: (u64, u32)) -> Self {
        match &mut self {
            Self::Probe(answer) => (answer.block, answer.place) = at,
            Self::Input(answer) => (answer.block, answer.place) = at,
            Self::Tap(answer) => (answer.block, answer.place) = at,
        }
        self
    }
}

/// Answer of a wait for an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputAnswer {
    /// Number of the decoder's block, from 1.
    pub block: u64,
    /// Place of the wait.
    pub place: u32,
    /// The level of the input, 1 or 0; −1 where the time was over. Of an analog input the reading, in units of 2⁻¹⁶ of
    /// its range.
    pub value: i32,
}

/// A rigid tap that begins at a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TapBegin {
    /// The place.
    pub place: u32,
    /// Line of the program.
    pub line: u32,
}

/// Answer of a rigid tap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TapAnswer {
    /// Number of the decoder's block, from 1.
    pub block: u64,
    /// Place of the tap.
    pub place: u32,
    /// Records from its beginning to where it turned.
    pub turned: u32,
}

/// Answer of a probing move.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProbeAnswer {
    /// Number of the decoder's block, from 1.
    pub block: u64,
    /// Place at which it begins.
    pub place: u32,
    /// Whether the probe has responded.
    pub touched: bool,
    /// Counts of the machine's axes at the touch; without one, where the machine came to rest.
    pub touch: Vec<i64>,
    /// Counts where the machine came to rest.
    pub rest: Vec<i64>,
    /// The control periods in which the machine moved: their number, and the distance in each, in units of 2⁻³² records
    /// of the move.
    pub runs: Vec<[u64; 2]>,
}

/// An entry of the index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum IndexEntry {
    /// A mark.
    Mark(PlaceMark),
    /// From the record at `place` on, the plan uses this override, [`Rate::ONE`] or more.
    Override {
        /// First record planned with it.
        place: RecordIndex,
        /// The factor, in units of 2⁻³².
        planned: Rate,
    },
    /// The streamed program was cut off or rejected behind this block: the path rests there. Written before the records
    /// of that stop are released to the motion path; a plan of the whole program rests there again.
    Rest {
        /// Number of the last planned block, from 1; 0 where there was none.
        block: u64,
    },
    /// A tool length was entered.
    Length(LengthChange),
    /// A rigid tap begins. Written before the motion path knows of it.
    Tap(TapBegin),
    /// The machine has answered. Written before the records behind the answer.
    Answer(Box<ProgramAnswer>),
}

/// Receives index entries in the planning thread. It may wait.
pub trait IndexWriter: Send {
    /// Writes an entry.
    fn write(&mut self, note: IndexEntry);

    /// Whether everything that was written is durable. Always true for an index that is never read again.
    fn is_durable(&mut self) -> bool {
        true
    }
}

/// No index: for a job that needs none.
impl IndexWriter for () {
    fn write(&mut self, _: IndexEntry) {}
}

/// The index of a job, and its durable place. The default writes no index.
pub struct JournalConfig {
    /// Receives the entries in the planning thread. They begin at the job's first place, also where the job is resumed.
    pub index: Box<dyn IndexWriter>,
    /// Durable place of the index. `None`: the card may receive whatever is planned.
    pub durable: Option<DurablePlace>,
}

impl Default for JournalConfig {
    fn default() -> Self {
        Self { index: Box::new(()), durable: None }
    }
}

impl std::fmt::Debug for JournalConfig {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Keeping").field("durable", &self.durable).finish_non_exhaustive()
    }
}
