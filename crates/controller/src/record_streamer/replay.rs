//! What an earlier run of the job has executed, before the card is at the breakpoint.
//!
//! Invariant: nothing here depends on the card.

use retrace_core::RecordIndex;

use super::RecordStreamer;
use crate::plan_item::ExclusiveInstruction;

impl<const A: usize> RecordStreamer<'_, A> {
    /// Moves the cursor to a place, without the card.
    pub fn seek_place(&mut self, place: RecordIndex) {
        self.ring.seek(place);
        self.reached = self.ring.reached();
        self.discard_old_actions();
    }

    /// Marks the pending instruction as executed: the card had executed instruction `number` when it was left.
    /// Returns it.
    pub fn mark_executed(&mut self, number: u32) -> Option<ExclusiveInstruction> {
        self.gates.mark_sent();
        self.acknowledge(number)
    }
}
