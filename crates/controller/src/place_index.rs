//! The index from places to the program, written ahead of what the card may execute (DNC, *Beyond the source*).
//!
//! Planning is a function of the program, the machine file, the place where the machine stood, and the overrides above 100 % with the places
//! from which they count. So a place is found again by planning again, and a mark is what that is held against: wherever the card has
//! stopped, a mark at or beyond it is durable.
//!
//! Invariant: a note about a place is handed over before the records at or beyond that place are free for the motion path; marks come
//! in the order of their places.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use retrace_core::Travel;
use retrace_core::place::is_before;

use crate::tool_length::LengthChange;

/// What the program had come to where the records up to a place were planned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlaceMark {
    /// The place, as a record boundary.
    pub place: u32,
    /// Blocks that were executed by the decoder up to the one that the record before the place belongs to: the block's instance.
    pub block: u64,
    /// Program line of that record.
    pub line: u32,
    /// Counts of the machine's axes at the place, in pulses; 0 where there is no such axis.
    pub counts: [i64; 9],
}

/// A mark that is not as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MarkDifference {
    /// As it was.
    pub was: PlaceMark,
    /// As it is planned now.
    pub is: PlaceMark,
}

/// A note for the index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IndexEntry {
    /// A mark.
    Mark(PlaceMark),
    /// From the record at `place` on the plan uses this override, [`retrace_core::ONE`] or more.
    Override {
        /// The first record planned so.
        place: u32,
        /// The factor, in units of 2⁻³².
        planned: Travel,
    },
    /// The program that arrives was cut off or refused behind this block: the path rests there. Noted before the records of that stop are
    /// free for the motion path; a plan of the whole program rests there again.
    Rest {
        /// Number of the last block that was planned, from 1; 0 where there was none.
        block: u64,
    },
    /// A tool length was entered.
    Length(LengthChange),
}

/// Takes notes, in the planning thread. It may wait.
pub trait IndexWriter: Send {
    /// Takes a note.
    fn note(&mut self, note: IndexEntry);

    /// Is everything durable that was noted? Of an index that is never read again it always is.
    fn is_durable(&mut self) -> bool {
        true
    }
}

/// Nobody keeps an index: a job that needs none.
impl IndexWriter for () {
    fn note(&mut self, _: IndexEntry) {}
}

/// Who keeps a job's index, and how far it is durable. The default keeps none.
pub struct JournalConfig {
    /// Takes the notes, in the planning thread. They come from the job's first place on, also where the job is taken up in its middle.
    pub index: Box<dyn IndexWriter>,
    /// How far the index is durable; `None`: the card may be given whatever is planned.
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

/// How far the index is durable: the motion path gives the card no record at or beyond this place.
#[derive(Clone, Debug)]
pub struct DurablePlace(Arc<AtomicU32>);

impl DurablePlace {
    /// Durable up to `place`, where the path begins.
    #[must_use]
    pub fn from(place: u32) -> Self {
        Self(Arc::new(AtomicU32::new(place)))
    }

    /// The place up to which it is: no record at or beyond it may be given to the card.
    #[must_use]
    pub fn place(&self) -> u32 {
        self.0.load(Ordering::Acquire)
    }

    /// It is durable up to `place` now. A place that lies before changes nothing; one thread alone says this.
    pub fn advance(&self, place: u32) {
        if is_before(self.place(), place) {
            self.0.store(place, Ordering::Release);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_only_grows_also_over_the_wrap() {
        let durable = DurablePlace::from(u32::MAX - 1);
        let ahead = durable.clone();
        for (said, is) in [(u32::MAX, u32::MAX), (3, 3), (u32::MAX, 3), (2, 3), (4, 4)] {
            ahead.advance(said);
            assert_eq!(durable.place(), is);
        }
    }
}
