//! The drive: how fast the cursor moves along the held records for a requested rate (REV, *Rate law*).
//!
//! The commanded rate follows the requested one with a slope that the records about to be crossed allow (`bounds`,
//! `slope`). It is lowered early enough before the end of the window, with slopes that are legal anywhere
//! (`braking`), and blended into rate one so that the recorded motion is reproduced to the pulse (`unity_blend`).
//! Independently of these, the cursor stays in the window (`cursor`).
//!
//! Invariant: the commanded rate changes by no more than the slope at it, except where the path is at rest. Its ramp
//! fits into the window that is held, or a planned stop is ahead.

use crate::limits::RateLimits;
use crate::rate::{FilterLengths, RateFilter, RateTarget};
use crate::{Distance, Place, RapidCap, Rate, RecordIndex};

mod bounds;
mod braking;
mod cursor;
mod directed_window;
mod slope;
mod unity_blend;

use bounds::IncrementBounds;
pub use braking::Braking;
pub use cursor::{Cursor, CursorStep};
pub use directed_window::DirectedWindow;
use directed_window::signed;

/// The held records as the drive reads them: numbers `low … high`, `high` excluded, for `A` axes.
pub trait RecordWindow<const A: usize> {
    /// Returns the number of the first record held.
    fn low(&self) -> RecordIndex;
    /// Returns the number after the last record held.
    fn high(&self) -> RecordIndex;
    /// Whether the path is at rest (a planned stop, or its very start) at the boundary before record `place`, `low ≤
    /// place ≤ high`.
    fn rests_at(&self, place: RecordIndex) -> bool;
    /// Returns the maximum rate at which record `place`, `low ≤ place < high`, may be retraced.
    fn cap(&self, place: RecordIndex) -> RapidCap;
    /// Returns the increments of record `place`, `low ≤ place < high`, in pulses.
    fn increments(&self, place: RecordIndex) -> [i16; A];
    /// Whether record `place`, `low ≤ place < high`, is rapid motion.
    fn is_rapid(&self, place: RecordIndex) -> bool;
}

/// Drive of the cursor on a machine: how fast the rate may change, and how early it brakes, for a requested rate.
///
/// # Examples
///
/// ```
/// use retrace_core::drive::{Drive, RecordWindow};
/// use retrace_core::limits::{PulseLimits, RateLimits};
/// use retrace_core::{Place, RapidCap, Rate, RecordIndex};
///
/// /// A hundred records of one axis; the path is at rest at their beginning only.
/// struct Window;
/// impl RecordWindow<1> for Window {
///     fn low(&self) -> RecordIndex { RecordIndex::new(0) }
///     fn high(&self) -> RecordIndex { RecordIndex::new(100) }
///     fn rests_at(&self, index: RecordIndex) -> bool { index.number() == 0 }
///     fn cap(&self, _: RecordIndex) -> RapidCap { RapidCap::PLANNED }
///     fn increments(&self, _: RecordIndex) -> [i16; 1] { [12] }
///     fn is_rapid(&self, _: RecordIndex) -> bool { false }
/// }
///
/// let axis = PulseLimits { velocity: 100 << 32, acceleration: 3 << 32, jerk: 1 << 32 };
/// let mut drive = Drive::<1, 16>::new(RateLimits::new(13, 1 << 15, [axis]).unwrap()).unwrap();
/// let mut place = Place::start_of(RecordIndex::new(0));
/// for _ in 0..1000 {
///     place = drive.step(place, Rate::ONE, &Window).to;
/// }
/// // nothing more is held: the cursor has braked and rests exactly at the end
/// assert_eq!((place, drive.at_rest()), (Place::start_of(RecordIndex::new(100)), true));
/// ```
#[derive(Clone, Debug)]
pub struct Drive<const A: usize, const M: usize> {
    cursor: Cursor<M>,
    limits: RateLimits<A>,
    braking: Braking,
}

impl<const A: usize, const M: usize> Drive<A, M> {
    /// Creates a drive at rest. Returns `None` if the limits' average is longer than `M`, or the machine brakes too
    /// slowly.
    #[must_use]
    pub fn new(limits: RateLimits<A>) -> Option<Self> {
        let filter = RateFilter::new(FilterLengths::new(1, limits.average())?)?;
        Some(Self { cursor: Cursor::with_filter(filter), limits, braking: Braking::new(&limits)? })
    }

    /// Creates a drive at rest for a card that has received no settings yet. Returns `None` if `M` is zero.
    #[must_use]
    pub const fn unconfigured() -> Option<Self> {
        // `?` is not allowed in a constant
        let Some(smoothing) = FilterLengths::new(1, 1) else { return None };
        let Some(filter) = RateFilter::new(smoothing) else { return None };
        Some(Self {
            cursor: Cursor::with_filter(filter),
            limits: RateLimits::unconfigured(),
            braking: Braking::unconfigured(),
        })
    }

    /// Returns the limits.
    #[must_use]
    pub const fn limits(&self) -> &RateLimits<A> {
        &self.limits
    }

    /// Whether the cursor is at rest, with no distance remaining.
    #[must_use]
    pub const fn at_rest(&self) -> bool {
        self.cursor.filter().at_rest()
    }

    /// Returns the signed distance from the cursor to the commanded place.
    #[must_use]
    pub const fn lead(&self) -> Distance {
        self.cursor.filter().lead()
    }

    /// Returns the signed distance within which the cursor can still come to rest anywhere on the path, within the
    /// limits: the lead, and the length that the commanded place needs ([`Braking::stop_length`]). The window must not
    /// be shortened to less than this.
    #[must_use]
    pub fn stopping_distance(&self) -> Distance {
        let rate = self.cursor.filter().target();
        self.lead() + signed(rate.signum(), self.braking.stop_length(rate.abs()))
    }

    /// Advances by one control period from `at` (in the window) toward the rate `target`, signed, clamped to
    /// |target| ≤ [`Rate::MAX`]. A change of direction passes through rest.
    pub fn step(&mut self, at: Place, target: Rate, window: &impl RecordWindow<A>) -> CursorStep {
        let target = target.clamp(-Rate::MAX, Rate::MAX);
        let sign = if self.at_rest() { target.signum() } else { self.cursor.filter().direction() };
        if sign == 0 {
            return self.cursor.dwell(at);
        }
        let ahead = DirectedWindow { at, sign, window };
        let requested = if target.signum() == sign { target.abs() } else { Rate::ZERO };
        let requested = self.within_caps(requested, &ahead);
        let mut started_slower = false;
        if self.at_rest() && ahead.at_planned_stop() {
            started_slower =
                self.cursor.start_from_rest(self.max_start_rate(requested, ahead.distance_to_end()), requested, &ahead)
                    < requested;
        }
        let commanded = self.next_rate(requested, &ahead);
        let braking_limited = self.braking.max_rate_within(commanded, ahead.distance_to_end() - self.lead().abs());
        let step = self.cursor.advance(commanded, braking_limited, &ahead);
        CursorStep { starved: step.starved || started_slower, ..step }
    }

    /// Returns the rate that may be requested at `at` if feed and rapid motion have different target rates.
    ///
    /// It is the faster rate, as far as it can be lowered to the slower one before the first record to which it does
    /// not apply. A record that is not held yet is such a record, and so is all motion backward. Rates that differ
    /// count as at most 1.
    #[must_use]
    pub fn within_overrides(&self, at: Place, target: RateTarget, window: &impl RecordWindow<A>) -> Rate {
        let (fast, slow) = (target.faster(), target.slower());
        if fast == slow || fast <= Rate::ZERO {
            return slow;
        }
        // the ramp from a rate above one has no length here
        let (fast, slow) = (fast.min(Rate::ONE), slow.min(Rate::ONE));
        let rapid_is_fast = target.rapid > target.feed;
        let average = i64::from(self.limits.average());
        // From the period at which the slower rate is commanded until the cursor moves at it; the last step of the ramp
        // is not a whole one.
        let settling = (slow / 2).over(average + 1) + Distance::records(3);
        // From a planned stop the rate jumps, and its lead jumps with it.
        let stopping = i64::from(self.cursor.filter().lengths().stopping_records());
        let lead = if self.at_rest() { fast.over(stopping) } else { self.lead().max(Distance::ZERO) };
        let spent = lead + settling - self.braking.length(slow);
        let needed = fast.over(1) + self.braking.length(fast) + spent;
        let held = window.high().since(at.record);
        let mut clear = Distance::ZERO;
        for k in 0..held {
            if clear >= needed || window.is_rapid(at.record + k) != rapid_is_fast {
                break;
            }
            clear = at.distance_to(Place::start_of(at.record + (k + 1)));
        }
        if clear == Distance::ZERO { slow } else { self.braking.max_rate_within(fast, clear - spent).clamp(slow, fast) }
    }

    /// Returns the largest rate up to `requested` that can be braked again after a jump to it, with a distance of
    /// `room` to the end.
    fn max_start_rate(&self, requested: Rate, room: Distance) -> Rate {
        let lead = i64::from(self.cursor.filter().lengths().stopping_records());
        let fits = |rate: Rate| self.braking.max_rate_within(rate, room - rate.over(lead)) >= rate;
        if fits(requested) {
            return requested;
        }
        let (mut low, mut high) = (Rate::ZERO, requested);
        while high - low > Rate::from_units(1) {
            let middle = low + (high - low) / 2;
            if fits(middle) { low = middle } else { high = middle }
        }
        low
    }

    /// Returns the next commanded rate between the last one and `requested`, as fast as the records allow.
    fn next_rate(&self, requested: Rate, ahead: &DirectedWindow<'_, A, impl RecordWindow<A>>) -> Rate {
        let rate = self.cursor.filter().target().abs();
        let min_slope = self.braking.min_slope();
        let blend_start = Rate::ONE - unity_blend::max_deficit(min_slope);
        if requested == Rate::ONE && blend_start <= rate && rate <= Rate::ONE {
            let commanded = ahead.at.moved(self.lead()).fraction;
            let passed = if ahead.sign > 0 { commanded } else { commanded.wrapping_neg() };
            if rate == Rate::ONE && passed == 0 {
                return Rate::ONE;
            }
            let passed = Distance::from_units(i64::from(passed));
            return Rate::ONE - unity_blend::next_deficit(Rate::ONE - rate, passed, min_slope);
        }
        if requested == rate {
            return requested;
        }
        let bounds = IncrementBounds::over(&self.limits, ahead, self.reach(requested.max(Rate::ONE)));
        if requested < rate {
            let slope = slope::max_fall(&self.limits, &bounds, rate, self.cursor.filter().max_target());
            let slope = slope.max(self.braking.slope(rate, bounds.min_cap));
            (rate - slope).max(requested)
        } else {
            let slope = slope::max_rise(&self.limits, &bounds, rate);
            let slope = slope.max(self.braking.rising_slope(rate, bounds.min_cap));
            // rate one itself is reached by blending
            (rate + slope).min(if requested == Rate::ONE { blend_start } else { requested })
        }
    }

    /// Returns the maximum distance that the cursor moves before a change of the commanded rate has left its average,
    /// with no rate above `rate` requested.
    fn reach(&self, rate: Rate) -> Distance {
        let average = i64::from(self.limits.average());
        self.lead().abs() + rate.max(self.cursor.filter().max_target()).over((average + 1) / 2)
    }

    /// Rapid retrace: returns the largest rate up to `requested` that is allowed by every record that may be crossed
    /// before that rate has fallen and left the average. Records that are not held yet count as limited to the planned
    /// rate.
    fn within_caps(&self, requested: Rate, ahead: &DirectedWindow<'_, A, impl RecordWindow<A>>) -> Rate {
        if requested <= Rate::ONE {
            return requested;
        }
        // The bounds cover two records more than the cursor reaches.
        let memory = i64::from(self.braking.periods()) + i64::from(self.limits.average()) + 3;
        let (lead, room) = (self.lead().abs(), ahead.distance_to_end());
        let held = (room.units() >> 32) as u32 + 1;
        let mut rate = requested;
        for k in 0.. {
            if Distance::records(i64::from(k) - 1) > lead + rate.over(memory) {
                return rate;
            }
            let Some(cap) = (k < held).then(|| ahead.cap(k)).flatten() else {
                return rate.min(((room - lead) / memory).per_period().max(Rate::ONE));
            };
            rate = rate.min(cap.rate());
        }
        rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::PulseLimits;
    use proptest::prelude::*;

    const ONE: Rate = Rate::ONE;
    /// Rate one in units of 2⁻³².
    const UNITS: i64 = ONE.units();

    fn rates(units: std::ops::RangeInclusive<i64>) -> impl Strategy<Value = Rate> {
        units.prop_map(Rate::from_units)
    }

    #[derive(Debug, Clone)]
    struct Strip {
        low: u32,
        high: u32,
        rests: Vec<u32>,
        slow: Vec<u32>,
    }

    impl RecordWindow<1> for Strip {
        fn low(&self) -> RecordIndex {
            RecordIndex::new(self.low)
        }
        fn high(&self) -> RecordIndex {
            RecordIndex::new(self.high)
        }
        fn rests_at(&self, place: RecordIndex) -> bool {
            self.rests.contains(&place.number())
        }
        fn cap(&self, place: RecordIndex) -> RapidCap {
            if self.slow.contains(&place.number()) { RapidCap::PLANNED } else { RapidCap::MAX }
        }
        fn increments(&self, place: RecordIndex) -> [i16; 1] {
            [if self.slow.contains(&place.number()) { 100 } else { 12 }]
        }
        fn is_rapid(&self, place: RecordIndex) -> bool {
            !self.slow.contains(&place.number())
        }
    }

    /// Returns a drive whose commanded rate may jump; the cursor is its average.
    fn drive(average: u16) -> Drive<1, 64> {
        let stiff = PulseLimits { velocity: 1 << 32, acceleration: 1 << 40, jerk: 1 << 40 };
        Drive::new(RateLimits::new(average, 1 << 15, [stiff]).expect("valid")).expect("fits")
    }

    /// Returns a drive with limits: |q'| up to 100 pulses, and slopes from a 4 000th to a 30th of a rate per period.
    fn soft(average: u16, share: u16) -> Drive<1, 64> {
        let axis = PulseLimits { velocity: 100 << 32, acceleration: 3 << 32, jerk: 1 << 32 };
        Drive::new(RateLimits::new(average, share, [axis]).expect("valid")).expect("fits")
    }

    fn strip(low: u32, high: u32, rests: &[u32]) -> Strip {
        Strip { low, high, rests: rests.to_vec(), slow: Vec::new() }
    }

    #[test]
    fn planned_stops_cost_no_period() {
        let window = strip(0, 100, &[0, 10, 11, 50, 100]);
        let (mut drive, mut at) = (drive(13), Place::start_of(RecordIndex::new(0)));
        for k in 1..=100 {
            at = drive.step(at, ONE, &window).to;
            assert_eq!(at, Place::start_of(RecordIndex::new(k)));
        }
        assert!(drive.at_rest());
        for k in (0..100).rev() {
            at = drive.step(at, -ONE, &window).to;
            assert_eq!(at, Place::start_of(RecordIndex::new(k)));
        }
        assert!(drive.at_rest());
    }

    #[test]
    fn an_end_that_is_no_planned_stop_is_reached_exactly_and_called_short() {
        let window = strip(0, 100, &[0]);
        let (mut drive, mut at, mut short) = (drive(13), Place::start_of(RecordIndex::new(0)), false);
        for _ in 0..200 {
            let step = drive.step(at, ONE, &window);
            (at, short) = (step.to, short | step.starved);
        }
        assert_eq!((at, short, drive.at_rest()), (Place::start_of(RecordIndex::new(100)), true, true));
    }

    #[test]
    fn from_a_planned_stop_the_rate_jumps_as_far_as_the_road_allows() {
        let first = |high: u32, rests: &[u32], target: Rate| {
            let mut drive = drive(13);
            let step = drive.step(Place::start_of(RecordIndex::new(0)), target, &strip(0, high, rests));
            assert_eq!(drive.at_rest(), step.to == Place::start_of(RecordIndex::new(0)));
            (Place::start_of(RecordIndex::new(0)).distance_to(step.to).per_period(), step.starved)
        };
        // the lead at rate one is six records, and the commanded place advances by one
        assert_eq!(first(100, &[0], ONE), (ONE, false));
        assert_eq!(first(7, &[0], ONE), (ONE, false));
        assert_eq!(first(5, &[0], ONE), (ONE * 5 / 7, true));
        assert_eq!(first(5, &[0, 5], ONE), (ONE, false));
        assert_eq!(first(100, &[0], ONE / 3), (ONE / 3, false));
        assert_eq!(first(0, &[0], ONE), (Rate::ZERO, true));
        // anywhere else it follows the filter
        let filter = first(100, &[], ONE).0;
        assert_eq!(filter, ONE / 13);
    }

    #[test]
    fn standing_behind_a_planned_stop_but_not_on_it_the_rate_follows_the_law() {
        let window = strip(0, 100, &[0]);
        let mut drive = drive(13);
        let mut at = drive.step(Place::start_of(RecordIndex::new(0)), ONE / 9, &window).to;
        while !drive.at_rest() {
            at = drive.step(at, Rate::ZERO, &window).to;
        }
        assert!(at.record == RecordIndex::new(0) && at.fraction != 0);
        let to = drive.step(at, ONE, &window).to;
        // first to the next boundary, at the filter's pace
        let to_boundary = Distance::RECORD - Distance::from_units(at.fraction.into());
        assert_eq!(at.distance_to(to), to_boundary / 13);
    }

    proptest! {
        /// Feed and rapid motion in turn, records that arrive late, any overrides: neither kind ever exceeds its
        /// override, both reach it, and only one of them slows the other.
        #[test]
        fn each_kind_of_motion_keeps_its_own_override(
            average in 2u16..30, share in 500u16..30_000,
            (feed, rapid) in (rates(1..=UNITS), rates(1..=UNITS)), lengths in prop::collection::vec(1u32..400, 2..6),
                ahead in 8u32..600,
        ) {
            let mut bounds = vec![0u32];
            lengths.iter().for_each(|length| bounds.push(bounds[bounds.len() - 1] + length));
            let end = bounds[bounds.len() - 1];
            let mut window = strip(0, 0, &[0, end]);
            window.slow = bounds.windows(2).step_by(2).flat_map(|bounds| bounds[0]..bounds[1]).collect();
            let slow = window.slow.iter().copied().collect::<std::collections::HashSet<u32>>();
            let (mut drive, mut at) = (soft(average & !1 | 1, share), Place::start_of(RecordIndex::new(0)));
            let target = RateTarget { feed, rapid };
            let slower = feed.min(rapid);
            for _ in 0..(u64::from(end) * UNITS as u64 / slower.units() as u64).min(20_000) {
                window.high = window.high.max(at.record.number() + ahead).min(end);
                let requested = drive.within_overrides(at, target, &window);
                prop_assert!((slower..=feed.max(rapid)).contains(&requested));
                let to = drive.step(at, requested, &window).to;
                for record in at.record.number()..to.boundary_ahead().number() {
                    let most = if slow.contains(&record) { feed } else { rapid };
                    let moved = at.distance_to(to).per_period();
                    prop_assert!(moved <= most + Rate::from_units(1), "record {record}: {moved:?} above {most:?}");
                }
                at = to;
            }
        }
    }

    proptest! {
        /// For any host request: no overflow, and no rate beyond the requested one.
        #[test]
        fn any_two_rates_are_taken(feed in any::<i64>(), rapid in prop_oneof![any::<i64>(), Just(0), Just(UNITS)],
            at in 0u32..100) {
            let (window, drive) = (strip(0, 100, &[0, 100]), soft(13, 1 << 15));
            let target = RateTarget { feed: Rate::from_units(feed), rapid: Rate::from_units(rapid) };
            let rate = drive.within_overrides(Place::start_of(RecordIndex::new(at)), target, &window).units();
            prop_assert!(rate == 0 || rate.signum() == feed.signum() && rate.signum() == rapid.signum() || feed == 0
                || rapid == 0);
            prop_assert!(rate.unsigned_abs() <= target.faster().units().unsigned_abs());
        }
    }

    #[test]
    fn rapid_motion_runs_at_its_override_up_to_where_it_has_to_slow_down() {
        let mut window = strip(0, 6000, &[0, 6000]);
        window.slow = (0..1000).chain(4000..6000).collect();
        let (mut drive, mut at, mut fastest, mut rates) =
            (soft(13, 1 << 15), Place::start_of(RecordIndex::new(0)), Distance::ZERO, Vec::new());
        let target = RateTarget { feed: ONE / 5, rapid: ONE };
        while at != Place::start_of(RecordIndex::new(6000)) {
            let to = drive.step(at, drive.within_overrides(at, target, &window), &window).to;
            fastest = fastest.max(at.distance_to(to));
            if at.distance_to(to) == Distance::RECORD {
                rates.push(at.record.number());
            }
            at = to;
        }
        assert_eq!(fastest, Distance::RECORD);
        // the machine needs about 115 records to slow down
        let ramps = (1000..1300).contains(&rates[0]) && (3700..4000).contains(&rates[rates.len() - 1]);
        assert!(ramps, "{} … {}", rates[0], rates[rates.len() - 1]);
    }

    /// A whole period at the slower rate has passed three records before the first record that it applies to, and not
    /// much earlier, whatever that rate is.
    #[test]
    fn the_slower_rate_is_in_force_three_records_before_it_applies() {
        for average in [3, 13, 63] {
            for sixteenths in 1..16 {
                let mut window = strip(0, 3000, &[0, 3000]);
                window.slow = (2000..3000).collect();
                let target = RateTarget { feed: ONE / 16 * sixteenths, rapid: ONE };
                let (mut drive, mut at) = (soft(average, 1 << 15), Place::start_of(RecordIndex::new(0)));
                let mut slowed = None;
                while at.record.number() < 2000 {
                    let to = drive.step(at, drive.within_overrides(at, target, &window), &window).to;
                    let rate = at.distance_to(to).per_period();
                    if rate <= target.feed + Rate::from_units(1) && at.record.number() > 500 {
                        slowed = slowed.or(Some(to));
                    }
                    at = to;
                }
                let spare = slowed.expect("it slows down").distance_to(Place::start_of(RecordIndex::new(2000)));
                let in_time = Distance::records(3) <= spare && spare < Distance::records(4);
                assert!(in_time, "{average} {sixteenths}: {spare:?}");
            }
        }
    }

    #[test]
    fn rapid_retrace_keeps_every_cap_and_gets_faster_where_it_may() {
        for sign in [1, -1] {
            let mut window = strip(0, 3000, &[0, 3000]);
            window.slow = (1000..1010).collect();
            let (from, end) = if sign > 0 { (0, 3000) } else { (3000, 0) };
            let (mut drive, mut at, mut periods) = (drive(13), Place::start_of(RecordIndex::new(from)), 0);
            while at != Place::start_of(RecordIndex::new(end)) {
                let to = drive.step(at, ONE * (20 * sign), &window).to;
                within_caps(at, to, &window);
                (at, periods) = (to, periods + 1);
            }
            assert!((3000 / 8..3000 / 5).contains(&periods), "{periods}");
        }
    }

    /// The window slides with the cursor: its newest records may be slow, and are not known before.
    #[test]
    fn rapid_retrace_is_only_as_fast_as_the_window_is_long() {
        for sign in [1, -1] {
            for ahead in [20, 40, 60, 90] {
                let mut window = strip(10_000, 10_000, &[10_000]);
                window.slow = (8_500..8_520).chain(11_500..11_520).collect();
                let (mut drive, mut at, mut fastest) =
                    (drive(13), Place::start_of(RecordIndex::new(10_000)), Distance::ZERO);
                for _ in 0..2200 {
                    window.high = window.high.max(at.record.number() + ahead).min(12_000);
                    window.low = window.low.min(at.record.number() - ahead).max(8_000);
                    let to = drive.step(at, Rate::MAX * sign, &window).to;
                    within_caps(at, to, &window);
                    fastest = fastest.max(at.distance_to(to).abs());
                    at = to;
                }
                assert_eq!(at.record, RecordIndex::new(if sign > 0 { 12_000 } else { 8_000 }));
                // a request has effect for thirteen periods and four; a steady rate has a lead of six in addition
                let (highest, lowest) = (ONE * i64::from(ahead) / 17, ONE * i64::from(ahead) / 23);
                let fastest = fastest.per_period();
                assert!(fastest <= highest.max(ONE) && fastest >= lowest.max(ONE) - ONE / 2, "{ahead}: {fastest:?}");
            }
        }
    }

    /// Checks that no record is passed faster than its cap.
    fn within_caps(at: Place, to: Place, window: &Strip) {
        let rate = at.distance_to(to).abs().per_period();
        let (low, high) = if at.distance_to(to) > Distance::ZERO { (at, to) } else { (to, at) };
        let mut n = low.record;
        while n != high.boundary_ahead() {
            assert!(rate <= window.cap(n).rate() || rate <= ONE, "record {n:?} at rate {rate:?}");
            n += 1;
        }
    }

    /// Changes that a host may make between two periods.
    #[derive(Debug, Clone)]
    enum HostChange {
        Extend(u32, bool, bool),
        ExtendBack(u32, bool, bool),
        Run(Rate, u32),
    }

    fn host_changes() -> impl Strategy<Value = Vec<HostChange>> {
        let rate =
            prop_oneof![Just(ONE), Just(-ONE), Just(Rate::ZERO), Just(ONE / 3), rates(-8 * UNITS..=8 * UNITS - 1)];
        let change = prop_oneof![
            (0u32..40, any::<bool>(), any::<bool>()).prop_map(|(n, r, slow)| HostChange::Extend(n, r, slow)),
            (0u32..40, any::<bool>(), any::<bool>()).prop_map(|(n, r, slow)| HostChange::ExtendBack(n, r, slow)),
            (rate, 1u32..40).prop_map(|(r, n)| HostChange::Run(r, n)),
        ];
        prop::collection::vec(change, 1..80)
    }

    proptest! {
        /// For any sequence of requests, and any growth of the window: the cursor never leaves the window, never moves
        /// against the sign of the request except while braking, passes no record faster than its cap, and with a
        /// constant target comes to rest exactly on the end of the window. At rate ±1 it moves from record boundary to
        /// record boundary.
        #[test]
        fn never_leaves_the_road_and_rests_on_its_end(
            half in 0u16..8, share in prop_oneof![Just(None), (1u16..60_000).prop_map(Some)], start in any::<u32>(),
                changes in host_changes(), forward in any::<bool>(),
        ) {
            let mut drive = share.map_or_else(|| drive(2 * half + 1), |share| soft(2 * half + 3, share));
            let mut window = strip(start, start, &[start]);
            let mut at = Place::start_of(RecordIndex::new(start));
            // after rapid retrace a mean of one may be the mean of more and less
            let rapid = changes.iter().any(|d| matches!(d, HostChange::Run(rate, _) if rate.abs() > ONE));
            let mut last = Rate::ZERO;
            let run = |drive: &mut Drive<1, 64>, at: &mut Place, last: &mut Rate, window: &Strip, target: Rate,
                n: u32| {
                for _ in 0..n {
                    let step = drive.step(*at, target, window);
                    assert!(Place::start_of(RecordIndex::new(window.low)).distance_to(step.to) >= Distance::ZERO,
                        "below the window");
                    assert!(step.to.distance_to(Place::start_of(RecordIndex::new(window.high))) >= Distance::ZERO,
                        "beyond the window");
                    assert!(at.distance_to(step.to).abs() <= Distance::records(8));
                    within_caps(*at, step.to, window);
                    let rate = at.distance_to(step.to).per_period();
                    let steady = rate.abs() == ONE && rate == *last;
                    // except for what is lost below the last bit of a rate while it settles
                    let off = step.to.fraction.min(step.to.fraction.wrapping_neg());
                    assert!(rapid || !steady || off < 1 << 12, "a split record at rate one");
                    *last = rate;
                    *at = step.to;
                }
            };
            for change in changes {
                match change {
                    HostChange::Extend(n, rest, slow) => {
                        if slow && n > 0 { window.slow.push(window.high); }
                        window.high = window.high.wrapping_add(n);
                        if rest && n > 0 { window.rests.push(window.high); }
                    }
                    HostChange::ExtendBack(n, rest, slow) => {
                        window.low = window.low.wrapping_sub(n);
                        if slow && n > 0 { window.slow.push(window.low); }
                        if rest && n > 0 { window.rests.push(window.low); }
                    }
                    HostChange::Run(rate, n) => run(&mut drive, &mut at, &mut last, &window, rate, n),
                }
            }
            let (target, end) = if forward { (ONE, window.high) } else { (-ONE, window.low) };
            let length = window.high.wrapping_sub(window.low);
            run(&mut drive, &mut at, &mut last, &window, target, 20 * length + 4000);
            prop_assert_eq!(at, Place::start_of(RecordIndex::new(end)));
            prop_assert!(drive.at_rest());
        }
    }
}
