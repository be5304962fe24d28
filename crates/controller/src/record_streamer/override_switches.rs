//! Places at which the program switches the operator's overrides off and on (M48 … M50).
//!
//! Invariant: a switch is in the list while its instruction counts as executed, and as long as there is space.

use std::collections::VecDeque;

use retrace_core::{Place, RecordIndex};
use retrace_link::CardStatus;

use super::RecordStreamer;

/// Capacity.
const MAX_SWITCHES: usize = 4096;

/// The switches that were executed, in path order: each with the record before which it stands, and whether overrides
/// apply from there on.
#[derive(Debug)]
pub(super) struct OverrideSwitches {
    switches: VecDeque<(RecordIndex, bool)>,
    /// Whether overrides apply before the first one.
    applies_before: bool,
}

impl OverrideSwitches {
    pub(super) fn new() -> Self {
        Self { switches: VecDeque::with_capacity(MAX_SWITCHES), applies_before: true }
    }

    /// Adds the switch that was executed last. Where there is no space, the oldest one is forgotten.
    pub(super) fn push(&mut self, place: RecordIndex, applies: bool) {
        if self.switches.len() == MAX_SWITCHES
            && let Some((_, applies)) = self.switches.pop_front()
        {
            self.applies_before = applies;
        }
        self.switches.push_back((place, applies));
    }

    /// Removes the switch that was executed last.
    pub(super) fn pop(&mut self) {
        self.switches.pop_back();
    }

    /// Number of switches up to this place.
    fn count_until(&self, place: Place) -> usize {
        self.switches.partition_point(|(switch, _)| !place.record.is_before(*switch))
    }

    pub(super) fn applies_at(&self, place: Place) -> bool {
        match self.count_until(place).checked_sub(1) {
            Some(last) => self.switches[last].1,
            None => self.applies_before,
        }
    }

    /// Place of the next switch behind this one.
    fn next_behind(&self, place: Place) -> Option<RecordIndex> {
        self.switches.get(self.count_until(place)).map(|(switch, _)| *switch)
    }
}

impl<const A: usize> RecordStreamer<'_, A> {
    /// Whether the operator's overrides apply where the cursor is. On a lead-in, as where it joins the path.
    #[must_use]
    pub fn override_applies(&self, status: &CardStatus<A>) -> bool {
        let join = self.lead_in.as_ref().map(|lead_in| Place::start_of(lead_in.join()));
        let is_before = |join: &Place| status.place.record.is_before(join.record);
        self.override_switches.applies_at(join.filter(is_before).unwrap_or(status.place))
    }

    /// Place behind the cursor's at which overrides are switched next, as far as the program was executed.
    #[must_use]
    pub fn next_override_switch(&self, status: &CardStatus<A>) -> Option<RecordIndex> {
        self.override_switches.next_behind(status.place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_switch_counts_from_its_place_on_and_the_oldest_is_forgotten_for_space() {
        let at = |number: u32| Place { record: RecordIndex::new(number), fraction: 7 };
        let mut switches = OverrideSwitches::new();
        assert_eq!((switches.applies_at(at(0)), switches.next_behind(at(0))), (true, None));
        switches.push(RecordIndex::new(10), false);
        switches.push(RecordIndex::new(20), true);
        assert_eq!([9, 10, 19, 20, 30].map(|number| switches.applies_at(at(number))), [true, false, false, true, true]);
        let next = |number| switches.next_behind(at(number)).map(RecordIndex::number);
        assert_eq!([9, 10, 19, 20].map(next), [Some(10), Some(20), Some(20), None]);
        switches.pop();
        assert_eq!((switches.applies_at(at(30)), switches.next_behind(at(10))), (false, None));
        for number in 0..MAX_SWITCHES as u32 {
            switches.push(RecordIndex::new(100 + number), number % 2 == 0);
        }
        assert_eq!((switches.switches.len(), switches.switches.capacity() >= MAX_SWITCHES), (MAX_SWITCHES, true));
        assert_eq!([9, 30, 100].map(|number| switches.applies_at(at(number))), [false, false, true]);
    }
}
