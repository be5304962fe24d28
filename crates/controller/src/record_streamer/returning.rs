//! The return to a place that was executed, from which the program is executed again.
//!
//! Invariant: what the streamer knows after a return is what it knew when the cursor was at that place for the first
//! time, but for the records, which stay planned.

use retrace_core::gate::Gates;
use retrace_core::{Place, RecordIndex};

use super::RecordStreamer;
use crate::plan_item::ExclusiveKind;

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
        if let ExclusiveKind::FeedOverride { .. } = done.kind {
            self.override_switches.pop();
        }
        self.exclusives.push_front(done);
        self.next_number = self.next_number.wrapping_sub(1);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use retrace_core::ring::{Cell, Ring};
    use retrace_core::{Record, size};
    use retrace_link::{MAX_CHANGES, OutputChange, channel};

    use super::*;
    use crate::plan_item::{ExclusiveInstruction, PathItem, PlanEnd, PlanSummary};
    use retrace_journal::DurablePlace;

    fn ring() -> Ring<Box<[Cell<Record<1>>]>> {
        let cells = (0..size::ring_cells(100, 100).expect("fits")).map(|_| Cell::default()).collect();
        Ring::new(cells, 100, 100, RecordIndex::new(0)).expect("fits")
    }

    /// A program that ends behind a probing move: its end arrives before its last records are durable. They are still
    /// to come, until they are, or the plan turns out to be shorter.
    #[test]
    fn what_is_not_durable_yet_is_still_to_come_where_the_plan_has_ended() {
        let at = RecordIndex::new;
        let mut ring = ring();
        let (mut producer, consumer) = ring.split();
        let (items, received) = sync_channel(8);
        let durable = DurablePlace::starting_at(at(0));
        let mut streamer = RecordStreamer::new(consumer, received, at(0), [0; channel::COUNT], 0);
        streamer.durable_place = Some(durable.clone());
        (0..50).for_each(|_| producer.push(Record::default()).expect("room"));
        streamer.poll_planner();
        assert!(!streamer.has_ended_at(at(50)), "it has not ended");
        let ending = PlanEnd::Completed;
        let summary = PlanSummary { ending, blocks: 3, canonical: 3, commanded_mm: vec![0.0] };
        items.send(PathItem::End(summary)).expect("room");
        streamer.poll_planner();
        assert!(streamer.summary().is_some() && !streamer.is_sure_until(at(50)));
        assert!(!streamer.has_ended_at(at(50)), "its last records become durable yet");
        assert!(streamer.has_ended_at(at(51)), "nothing comes behind its end");
        durable.advance(at(50));
        assert!(streamer.has_ended_at(at(50)), "all is there");
    }

    #[test]
    fn a_switch_of_the_overrides_behind_the_place_is_to_come_again() {
        let at = RecordIndex::new;
        let mut ring = ring();
        let (mut producer, consumer) = ring.split();
        let (items, received) = sync_channel(8);
        let switch = |place, applies| ExclusiveInstruction {
            place: at(place),
            line: 1,
            kind: ExclusiveKind::FeedOverride { applies },
            code: "M49",
            changes: [OutputChange::default(); MAX_CHANGES],
            count: 0,
            periods: 0,
            until: None,
            layer: None,
            restart_layer: None,
            restart_pierce: 0,
            kerf_um: None,
            is_barrier: false,
            question: None,
            spindle: None,
        };
        for switch in [switch(20, false), switch(40, true)] {
            items.send(PathItem::Exclusive(switch)).expect("room");
        }
        (0..50).for_each(|_| producer.push(Record::default()).expect("room"));
        let mut streamer = RecordStreamer::new(consumer, received, at(0), [0; channel::COUNT], 0);
        streamer.poll_planner();
        streamer.seek_place(at(45));
        assert!((1..=2).all(|number| streamer.mark_executed(number).is_some()));
        let applies = |of: &RecordStreamer<'_, 1>, place| {
            of.override_switches.applies_at(Place { record: at(place), fraction: 1 })
        };
        assert_eq!([19, 20, 39, 40].map(|place| applies(&streamer, place)), [true, false, false, true]);
        for (place, next, switched) in [(30, 40, [true, false, false]), (10, 20, [true, true, true])] {
            streamer.return_to(Place::start_of(at(place)));
            assert_eq!(streamer.next_exclusive(), Some(at(next)));
            assert_eq!([19, 20, 40].map(|place| applies(&streamer, place)), switched, "back at {place}");
        }
    }
}
