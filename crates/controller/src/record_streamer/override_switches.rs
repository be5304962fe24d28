//! Places at which the program switches the operator's overrides off and on (M48 … M50).
//!
//! Invariant: a switch is in the list while its instruction counts as executed, and as long as there is space.

use std::collections::VecDeque;

use retrace_core::{Place, RecordIndex};
use retrace_link::{CardStatus, OutputAction, SpindleTask, channel};

use super::RecordStreamer;
use crate::question::Question;

/// Capacity.
const MAX_SWITCHES: usize = 4096;

/// The switches that were executed, in path order: each with the record before which it stands, and whether overrides
/// apply from there on.
#[derive(Debug)]
pub(super) struct OverrideSwitches {
    switches: VecDeque<(RecordIndex, bool)>,
    /// Whether overrides apply before the first one.
    applies_before: bool,
    /// What S is multiplied with where it is sent.
    speed: SpeedShare,
}

/// Share of the speed of the spindle, and the range that it does not leave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SpeedShare {
    /// The share in per cent.
    pub(crate) percent: i64,
    /// Least and greatest speed, in thousandths of a turn per minute.
    pub(crate) range: [i32; 2],
}

impl SpeedShare {
    const WHOLE: Self = Self { percent: 100, range: [0, i32::MAX] };

    /// What a programmed speed becomes. One that is out of the range already is not moved further out.
    pub(crate) fn of(&self, speed: i32) -> i32 {
        let [least, greatest] = self.range;
        let share = i64::from(speed) * self.percent / 100;
        let bounded = share.clamp(least.min(speed).into(), greatest.max(speed).into());
        i32::try_from(bounded).unwrap_or(speed)
    }
}

impl OverrideSwitches {
    pub(super) fn new() -> Self {
        Self { switches: VecDeque::with_capacity(MAX_SWITCHES), applies_before: true, speed: SpeedShare::WHOLE }
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

    /// Sets what S is multiplied with where it is sent.
    pub(crate) fn set_speed_share(&mut self, share: SpeedShare) {
        self.override_switches.speed = share;
    }

    /// An action as it is sent.
    pub(super) fn as_sent(&self, action: &OutputAction) -> OutputAction {
        let share = self.override_switches.speed;
        let is_speed = action.channel == channel::SPEED;
        let of = |value: i32| if is_speed { share.of(value) } else { value };
        OutputAction { before: of(action.before), after: of(action.after), ..*action }
    }

    /// Whether the next instruction that is known makes the motion follow the spindle: a thread or a rigid tap.
    #[must_use]
    pub fn gear_is_next(&self) -> bool {
        self.exclusives.front().is_some_and(|next| {
            matches!(next.spindle, Some(SpindleTask::Gear(_)))
                || matches!(next.question.as_deref(), Some(Question::Tap(_)))
        })
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
    use proptest::prelude::*;

    proptest! {
        /// No override moves S out of the range of the spindle, nor further out of it, and 100 % changes nothing.
        #[test]
        fn an_overridden_speed_stays_in_the_range(
            speed in 0..4_000_000i32, percent in 10..=200i64, least in 0..500_000i32, more in 0..3_000_000i32,
        ) {
            let range = [least, least + more];
            let of = SpeedShare { percent, range }.of(speed);
            let is_in_range = |speed: i32| (range[0]..=range[1]).contains(&speed);
            prop_assert!(is_in_range(of) || !is_in_range(speed), "{}", of);
            prop_assert!((speed - of).signum() == (100 - percent).signum() as i32 || of == speed, "{}", of);
            prop_assert!(of != speed || percent == 100 || speed < 10 || speed <= range[0] || speed >= range[1]);
            prop_assert_eq!(SpeedShare { percent: 100, range }.of(speed), speed);
        }
    }

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
