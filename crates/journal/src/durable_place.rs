//! The durable place, which the writer thread advances and the motion path reads.
//!
//! Invariant: the place only grows. `verification/loom` compiles this file again over the model checker's atomics.

use retrace_core::RecordIndex;

use crate::sync::{Arc, AtomicU32, Ordering};

/// Place up to which the index is durable: the motion path gives the card no record at or beyond it.
#[derive(Clone, Debug)]
pub struct DurablePlace(Arc<AtomicU32>);

impl DurablePlace {
    /// Durable up to `place`, where the path begins.
    #[must_use]
    pub fn starting_at(place: RecordIndex) -> Self {
        Self(Arc::new(AtomicU32::new(place.number())))
    }

    /// The durable place: no record at or beyond it may be given to the card.
    #[must_use]
    pub fn place(&self) -> RecordIndex {
        RecordIndex::new(self.0.load(Ordering::Acquire))
    }

    /// Advances the durable place. An earlier place changes nothing. Called from one thread only.
    pub fn advance(&self, place: RecordIndex) {
        if self.place().is_before(place) {
            self.0.store(place.number(), Ordering::Release);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_only_grows_also_over_the_wrap() {
        let durable = DurablePlace::starting_at(RecordIndex::new(u32::MAX - 1));
        let ahead = durable.clone();
        for (result, is) in [(u32::MAX, u32::MAX), (3, 3), (u32::MAX, 3), (2, 3), (4, 4)] {
            ahead.advance(RecordIndex::new(result));
            assert_eq!(durable.place(), RecordIndex::new(is));
        }
    }
}
