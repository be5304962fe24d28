//! The return to a place that was executed, from which the program is executed again.
//!
//! Invariant: what the streamer knows after a return is what it knew when the cursor was at that place for the first
//! time, but for the records, which stay planned.

use retrace_core::gate::Gates;
use retrace_core::{Place, RecordIndex};

use super::RecordStreamer;

impl<const A: usize> RecordStreamer<'_, A> {
    /// Oldest place to which [`RecordStreamer::return_to`] can return.
    #[must_use]
    pub fn oldest_return(&self) -> RecordIndex {
        self.done_retained_from.into_iter().fold(self.oldest_recorded(), RecordIndex::later)
    }

    /// Returns to a place: what was executed beyond it counts as not executed any more, and is executed again as the
    /// program has it. `place` is not before [`RecordStreamer::oldest_return`]. Returns the number of the last
    /// instruction that remains executed.
    pub fn return_to(&mut self, place: Place) -> u32 {
        let reached = place.boundary_ahead();
        loop {
            let last_action = self.passed.checked_sub(1).and_then(|at| self.actions.get(at)).map(|(action, _)| *action);
            let action = last_action.filter(|action| !action.place.is_before(reached));
            let done = self.done.back().map(|(done, _)| done.place).filter(|done| place.record.is_before(*done));
            match (action, done) {
                // At one place the instruction is executed first.
                (Some(action), done) if done.is_none_or(|done| !action.place.is_before(done)) => {
                    if let Some(expected) = self.expected.get_mut(usize::from(action.channel)) {
                        *expected = action.before;
                    }
                    self.passed -= 1;
                }
                (_, Some(_)) => self.undo_last_instruction(),
                (_, None) => break,
            }
        }
        let is_beyond = |at: &RecordIndex| place.record.is_before(*at);
        while self.pierces.back().is_some_and(is_beyond) {
            self.pierces.pop_back();
        }
        while self.cut_changes.back().is_some_and(is_beyond) {
            self.cut_changes.pop_back();
        }
        self.reached = reached;
        self.gates = Gates::default();
        if let Some(next) = self.exclusives.front() {
            self.gates.accept(self.next_number, next.place);
        }
        self.next_number.wrapping_sub(1)
    }

    /// Makes the instruction that was executed last the pending one.
    fn undo_last_instruction(&mut self) {
        let Some((done, before)) = self.done.pop_back() else { return };
        for (change, value) in done.changes[..usize::from(done.count)].iter().zip(before) {
            self.expected[usize::from(change.channel)] = value;
        }
        self.exclusives.push_front(done);
        self.next_number = self.next_number.wrapping_sub(1);
    }
}
