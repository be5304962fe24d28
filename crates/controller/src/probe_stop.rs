//! How far the machine goes on behind a touch, and the highest feed of a probing move (PRB-9).
//!
//! Invariant: what is calculated is what the card does: its own drive brakes along the planned move, wherever in it the
//! probe responds.

use retrace_config::MachineConfig;
use retrace_core::drive::{Drive, RecordWindow};
use retrace_core::{Place, RapidCap, Rate, Record, RecordIndex};
use retrace_gcode::Probing;

use crate::probe_move::ProbeMove;

/// Longest average of a drive, in periods; more than any card's memory.
const AVERAGE: usize = 1024;
/// Periods from the one of the touch to the first in which the rate falls, without a filter.
const RESPONSE_PERIODS: u32 = 2;
/// Share of the overtravel that is used: between the places that are tried it may be a little more.
const USED: f64 = 0.98;

/// A probing move along a straight line, as the card brakes in it.
#[derive(Debug)]
pub(crate) struct ProbeStop<'a, const A: usize> {
    machine: &'a MachineConfig,
    /// Way of the move, mm.
    way: [f64; A],
}

impl<'a, const A: usize> ProbeStop<'a, A> {
    pub(crate) fn new(machine: &'a MachineConfig, from: &[f64; A], to: &[f64; A]) -> Self {
        Self { machine, way: std::array::from_fn(|axis| to[axis] - from[axis]) }
    }

    /// The highest feed in whole mm/min that stops within the overtravel, where this one in mm/s does not.
    pub(crate) fn highest_feed_instead_of(&self, feed_mm_s: f64) -> Option<f64> {
        if self.fits(feed_mm_s) {
            return None;
        }
        let (mut fitting, mut too_fast) = (0.0, (60.0 * feed_mm_s).ceil());
        while too_fast - fitting > 1.0 {
            let middle = f64::midpoint(fitting, too_fast).floor();
            if self.fits(middle / 60.0) { fitting = middle } else { too_fast = middle }
        }
        Some(fitting)
    }

    /// A share of the way, in counts of the axes; 0 for missing axes.
    pub(crate) fn counts(&self, share: f64) -> [i64; 9] {
        let mut counts = [0; 9];
        for ((counts, mm), axis) in counts.iter_mut().zip(self.way).zip(&self.machine.axes) {
            *counts = (share * mm * axis.pulses_per_mm).round() as i64;
        }
        counts
    }

    fn fits(&self, feed_mm_s: f64) -> bool {
        let overtravel = self.machine.probe.overtravel_mm;
        // What the machine needs wherever it is, is quickly known.
        self.most_mm(feed_mm_s) <= overtravel || self.longest_stop_mm(feed_mm_s) <= USED * overtravel
    }

    /// Periods from the one of the touch to the first in which the rate falls.
    fn response_periods(&self) -> u32 {
        RESPONSE_PERIODS + u32::from(self.machine.probe.filter_periods)
    }

    /// What the machine never needs more than to come to rest, on any path.
    fn most_mm(&self, feed_mm_s: f64) -> f64 {
        let records = self.response_periods() + self.machine.probe.limits.stopping.look_ahead_records;
        f64::from(records) * feed_mm_s * self.machine.period_s()
    }

    /// The longest way from a touch to rest, of many places in the move. A long move is shortened, so that it still has
    /// space to stop several times.
    fn longest_stop_mm(&self, feed_mm_s: f64) -> f64 {
        let length = self.way.iter().map(|mm| mm * mm).sum::<f64>().sqrt();
        let to = self.counts(f64::min(1.0, 6.0 * self.most_mm(feed_mm_s) / length));
        let probing = Probing { away: false, must_trip: true };
        let planned = ProbeMove { from: [0; 9], to, feed_nm_per_s: (feed_mm_s * 1e6) as u64, probing };
        let drive = self.machine.probing_rate_limits().and_then(Drive::<A, AVERAGE>::new);
        let (Ok(mut planner), Some(mut drive)) = (planned.plan::<A>(self.machine), drive) else { return f64::INFINITY };
        let motion = PlannedMotion(std::iter::from_fn(|| planner.next_record()).collect());
        let stride = (usize::from(drive.limits().average()) / 8).max(1);
        let mut place = Place::start_of(motion.low());
        let mut longest = 0.0;
        for responded in 0..motion.0.len() as u32 {
            if (responded as usize).is_multiple_of(stride) {
                let rest = motion.rest(&drive, place, self.response_periods());
                longest = f64::max(longest, self.mm(&motion.0[responded as usize..rest as usize]));
            }
            place = drive.step(place, Rate::ONE, &motion).to;
        }
        longest
    }

    /// Length of these records, mm.
    fn mm(&self, records: &[Record<A>]) -> f64 {
        let axes = self.machine.axes.iter().enumerate().take(A);
        let mm = axes.map(|(axis, of)| {
            records.iter().map(|record| f64::from(record.increments[axis])).sum::<f64>() / of.pulses_per_mm
        });
        mm.map(|mm| mm * mm).sum::<f64>().sqrt()
    }
}

/// A planned move from rest to rest.
struct PlannedMotion<const A: usize>(Vec<Record<A>>);

impl<const A: usize> PlannedMotion<A> {
    /// The record at whose beginning, or in which, the machine rests that goes on for so many periods and brakes then.
    fn rest(&self, drive: &Drive<A, AVERAGE>, mut place: Place, response: u32) -> u32 {
        let mut drive = drive.clone();
        for _ in 0..response {
            place = drive.step(place, Rate::ONE, self).to;
        }
        while !drive.at_rest() {
            place = drive.step(place, Rate::ZERO, self).to;
        }
        place.boundary_ahead().number()
    }
}

impl<const A: usize> RecordWindow<A> for PlannedMotion<A> {
    fn low(&self) -> RecordIndex {
        RecordIndex::new(0)
    }

    fn high(&self) -> RecordIndex {
        RecordIndex::new(self.0.len() as u32)
    }

    fn rests_at(&self, place: RecordIndex) -> bool {
        [self.low(), self.high()].contains(&place)
    }

    fn cap(&self, _: RecordIndex) -> RapidCap {
        RapidCap::PLANNED
    }

    fn increments(&self, place: RecordIndex) -> [i16; A] {
        self.0[place.number() as usize].increments
    }

    fn is_rapid(&self, _: RecordIndex) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// Wherever the probe responds in the move, it stops within what is calculated.
        #[test]
        fn no_place_of_the_move_needs_more_to_stop(
            period_ms in prop::sample::select(vec![0.5, 1.0, 2.0, 5.0]),
            acceleration in 100.0..4000.0f64,
            jerk in 2_000.0..100_000.0f64,
            feed in 1.0..100.0f64,
            length in 0.1..1.0f64,
            responds in prop::collection::vec(0.0..1.0f64, 12),
            own in prop::option::of((0.3..1.0f64, 0.3..100.0f64)),
        ) {
            let axes = ["x", "y", "z"].map(|name| format!(
                "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\n\
                 max_acceleration_mm_per_s2 = {acceleration}\nmax_jerk_mm_per_s3 = {jerk}\ntravel_mm = [-500, 500]\n"
            ));
            let probe = own.map_or_else(String::new, |(share, times)| format!(
                "[probe]\nacceleration_mm_per_s2 = {}\njerk_mm_per_s3 = {}\n", share * acceleration, times * jerk
            ));
            let text = format!("control_period_ms = {period_ms}\n{}{probe}", axes.concat());
            let Ok(machine) = MachineConfig::parse(&text, "m") else { return Ok(()) };
            let to = [20.0, 30.0, -60.0].map(|mm| (mm * length * 1000.0f64).round() / 1000.0);
            let stop = ProbeStop::<3>::new(&machine, &[0.0; 3], &to);
            let longest = stop.longest_stop_mm(feed);
            let counts = std::array::from_fn(|axis| to.get(axis).map_or(0, |mm| (mm * 1000.0).round() as i64));
            let probing = Probing { away: false, must_trip: true };
            let way = ProbeMove { from: [0; 9], to: counts, feed_nm_per_s: (feed * 1e6) as u64, probing };
            let mut planner = way.plan::<3>(&machine).expect("valid");
            let planned = PlannedMotion(std::iter::from_fn(|| planner.next_record()).collect());
            let drive = machine.probing_rate_limits().and_then(Drive::<3, AVERAGE>::new).expect("valid");
            for share in responds {
                let responded = (share * planned.0.len() as f64) as u32;
                let rest = planned.rest(&drive, Place::start_of(planned.low()), responded + RESPONSE_PERIODS);
                let mm = stop.mm(&planned.0[responded as usize..rest as usize]);
                prop_assert!(USED * mm <= longest, "{mm} of {longest} mm, {share} of {}", planned.0.len());
                prop_assert!(mm <= stop.most_mm(feed) + 0.001, "{mm} mm");
            }
        }
    }

    /// From 10 mm/s, wherever it is touched: the response, and then the braking. The move is long enough for it.
    #[test]
    fn a_higher_jerk_of_a_probing_move_shortens_the_stop() {
        let longest = |probe: &str| {
            let machine = MachineConfig::parse(&format!("[probe]\n{probe}"), "m").expect("valid");
            ProbeStop::<3>::new(&machine, &[0.0; 3], &[0.0, 0.0, -50.0]).longest_stop_mm(10.0)
        };
        let (usual, steep) = (longest(""), longest("jerk_mm_per_s3 = 1e9\n"));
        assert!((0.4..0.6).contains(&usual), "{usual}");
        assert!((0.05..0.12).contains(&steep), "{steep}");
        assert!(longest("acceleration_mm_per_s2 = 50\n") > usual + 0.3);
    }

    #[test]
    fn the_highest_feed_fits_and_a_tenth_more_does_not() {
        let machine = MachineConfig::parse("[probe]\novertravel_mm = 0.3\n", "m").expect("valid");
        let stop = ProbeStop::<3>::new(&machine, &[0.0; 3], &[3.0, 0.0, -4.0]);
        let highest = stop.highest_feed_instead_of(100.0).expect("100 mm/s do not stop within 0.3 mm");
        assert_eq!(stop.highest_feed_instead_of(highest / 60.0), None);
        assert!(stop.highest_feed_instead_of(1.1 * highest / 60.0).is_some());
        // At even speed, with no response to wait for, 10 mm/s would.
        assert!((300.0..600.0).contains(&highest), "{highest}");
        let nowhere = ProbeStop::<3>::new(&machine, &[0.0; 3], &[0.0; 3]);
        assert!(nowhere.highest_feed_instead_of(1.0).is_none());
    }
}
