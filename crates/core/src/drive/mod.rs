//! The drive: how fast the cursor moves along the records that are held, for the rate that is asked (REV, *Rate law*).
//!
//! The commanded rate follows what is asked with a slope that the records about to be crossed leave room for (`survey`, `slope`). It is
//! lowered early enough before the end of the road, with slopes that are legal anywhere (`braking`), and eased into rate one so that the
//! recorded motion comes out to the pulse (`ease`). Whatever these say, the cursor keeps to the road (`cursor`).
//!
//! Invariant: a commanded rate changes by no more than the slope at it, but where the path is at rest; and its ramp fits on the road that is
//! held, or a planned stop lies ahead.

use crate::limits::RateLimits;
use crate::rate::{FilterLengths, RateFilter, RateTarget};
use crate::{ONE, Place, RapidCap, Travel};

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
use directed_window::along;

/// The records held, as the drive sees them: numbers `low … high`, high excluded, for `A` axes.
pub trait RecordWindow<const A: usize> {
    /// First record held.
    fn low(&self) -> u32;
    /// The place behind the last record held.
    fn high(&self) -> u32;
    /// Is the path at rest (a planned stop, or its very start) at the boundary before record `place`? `low ≤ place ≤ high`.
    fn rests_at(&self, place: u32) -> bool;
    /// How fast record `place`, `low ≤ place < high`, may be retraced.
    fn cap(&self, place: u32) -> RapidCap;
    /// The increments of record `place`, `low ≤ place < high`, in pulses.
    fn increments(&self, place: u32) -> [i16; A];
    /// Is record `place`, `low ≤ place < high`, rapid motion?
    fn is_rapid(&self, place: u32) -> bool;
}

/// The cursor's motion on a machine: how fast it may change, and how early it brakes, for what is asked.
#[derive(Clone, Debug)]
pub struct Drive<const A: usize, const M: usize> {
    cursor: Cursor<M>,
    limits: RateLimits<A>,
    braking: Braking,
}

impl<const A: usize, const M: usize> Drive<A, M> {
    /// At rest. `None` where the limits' average is longer than `M`, or the machine brakes too slowly.
    #[must_use]
    pub fn new(limits: RateLimits<A>) -> Option<Self> {
        let law = RateFilter::new(FilterLengths::new(1, limits.average())?)?;
        Some(Self { cursor: Cursor::with_law(law), limits, braking: Braking::new(&limits)? })
    }

    /// At rest, for a card that was not told of its machine yet. `None` where `M` is zero.
    #[must_use]
    pub const fn idle() -> Option<Self> {
        // no `?` in a constant
        let Some(smoothing) = FilterLengths::new(1, 1) else { return None };
        let Some(law) = RateFilter::new(smoothing) else { return None };
        Some(Self { cursor: Cursor::with_law(law), limits: RateLimits::unknown(), braking: Braking::stiff() })
    }

    /// Does the cursor stand, with nothing left to run?
    #[must_use]
    pub const fn at_rest(&self) -> bool {
        self.cursor.law().at_rest()
    }

    /// Distance from the cursor to the commanded place; signed.
    #[must_use]
    pub const fn lead(&self) -> Travel {
        self.cursor.law().lead()
    }

    /// How far the cursor may still run if it is stopped now, wherever it is: the lead, and the ramp of the commanded rate; signed.
    #[must_use]
    pub fn stopping(&self) -> Travel {
        let rate = self.cursor.law().target();
        let ramp = if rate.abs() <= ONE {
            self.braking.length(rate.abs())
        } else {
            // a rate above one falls as the ramp from one does, in proportion; in 1 024ths, rounded up
            (self.braking.length(ONE) >> 10) * ((rate.abs() >> 22) + 1) + ONE
        };
        self.lead() + along(rate, ramp)
    }

    /// One control period from `at` (on the road) toward the rate `target`, in records a period, signed, at most 8 either
    /// way. A change of direction goes through rest.
    pub fn step(&mut self, at: Place, target: Travel, road: &impl RecordWindow<A>) -> CursorStep {
        let target = target.clamp(-8 * ONE, 8 * ONE);
        let sign = if self.at_rest() { target.signum() } else { self.cursor.law().direction() };
        if sign == 0 {
            return self.cursor.stand(at);
        }
        let way = DirectedWindow { at, sign, road };
        let asked = if target.signum() == sign { target.abs() } else { 0 };
        let asked = self.within_caps(asked, &way);
        let mut launched_slower = false;
        if self.at_rest() && way.rests() {
            launched_slower = self.cursor.launch(self.launching(asked, way.room()), asked, &way) < asked;
        }
        let wished = self.toward(asked, &way);
        let braked = self.braking.within(wished, way.room() - self.lead().abs());
        let step = self.cursor.advance(wished, braked, &way);
        CursorStep { short: step.short || launched_slower, ..step }
    }

    /// The rate that may be asked for at `at`, where feed and rapid motion are to run at different rates: the faster one, as far as it can
    /// be lowered to the slower one before the first record that it does not apply to. What is not held yet is such a record, and so is
    /// all motion backward. Rates that differ count as at most 1.
    #[must_use]
    pub fn within_overrides(&self, at: Place, target: RateTarget, road: &impl RecordWindow<A>) -> Travel {
        let (fast, slow) = (target.faster(), target.slower());
        if fast == slow || fast <= 0 {
            return slow;
        }
        // the ramp from a rate above one has no length here
        let (fast, slow) = (fast.min(ONE), slow.min(ONE));
        let rapid_is_fast = target.rapid > target.feed;
        let average = Travel::from(self.limits.average());
        // From the slower rate being commanded until the cursor runs at it; the last step of the ramp is not a whole one.
        let settling = (slow >> 1) * (average + 1) + 3 * ONE;
        // From a planned stop the rate jumps, and its lead with it.
        let stopping = Travel::from(self.cursor.law().smoothing().stopping_records());
        let lead = if self.at_rest() { fast * stopping } else { self.lead().max(0) };
        let spent = lead + settling - self.braking.length(slow);
        let needed = fast + self.braking.length(fast) + spent;
        let held = road.high().wrapping_sub(at.record);
        let mut clear = 0;
        for k in 0..held {
            if clear >= needed || road.is_rapid(at.record.wrapping_add(k)) != rapid_is_fast {
                break;
            }
            clear = at.to(Place::start_of(at.record.wrapping_add(k + 1)));
        }
        if clear == 0 { slow } else { self.braking.within(fast, clear - spent).clamp(slow, fast) }
    }

    /// The largest rate up to `asked` that can be braked from again if it is jumped to where `room` is left.
    fn launching(&self, asked: Travel, room: Travel) -> Travel {
        let lead = Travel::from(self.cursor.law().smoothing().stopping_records());
        let fits = |rate: Travel| self.braking.within(rate, room - rate * lead) >= rate;
        if fits(asked) {
            return asked;
        }
        let (mut low, mut high) = (0, asked);
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if fits(middle) { low = middle } else { high = middle }
        }
        low
    }

    /// The next commanded rate on the way from the last one to `asked`, as fast as the records allow.
    fn toward(&self, asked: Travel, way: &DirectedWindow<'_, A, impl RecordWindow<A>>) -> Travel {
        let rate = self.cursor.law().target().abs();
        let least = self.braking.min_slope();
        let eased = ONE - unity_blend::eased_from(least);
        if asked == ONE && eased <= rate && rate <= ONE {
            let commanded = way.at.moved(self.lead()).fraction;
            let passed = if way.sign > 0 { commanded } else { commanded.wrapping_neg() };
            if rate == ONE && passed == 0 {
                return ONE;
            }
            return ONE - unity_blend::next(ONE - rate, Travel::from(passed), least);
        }
        if asked == rate {
            return asked;
        }
        let survey = IncrementBounds::of(&self.limits, way, self.reach(asked.max(ONE)));
        if asked < rate {
            let slope = slope::falling(&self.limits, &survey, rate, self.cursor.law().highest());
            let slope = slope.max(self.braking.slope(rate, survey.min_cap));
            (rate - slope).max(asked)
        } else {
            let slope = slope::rising(&self.limits, &survey, rate);
            let slope = slope.max(self.braking.rising_slope(rate, survey.min_cap));
            // rate one itself is eased into
            (rate + slope).min(if asked == ONE { eased } else { asked })
        }
    }

    /// How far the cursor comes, at most, before a change of the commanded rate has left its average, no rate above `rate` being asked.
    fn reach(&self, rate: Travel) -> Travel {
        let average = Travel::from(self.limits.average());
        self.lead().abs() + (average + 1) / 2 * rate.max(self.cursor.law().highest())
    }

    /// Rapid retrace: the largest rate up to `asked` that no record forbids which may be crossed before that rate has fallen and left
    /// the average. What is not held yet may be as slow as planned.
    fn within_caps(&self, asked: Travel, way: &DirectedWindow<'_, A, impl RecordWindow<A>>) -> Travel {
        if asked <= ONE {
            return asked;
        }
        // The survey sees two records further than the cursor comes.
        let memory = self.braking.periods() + Travel::from(self.limits.average()) + 3;
        let (lead, room) = (self.lead().abs(), way.room());
        let held = (room >> 32) as u32 + 1;
        let mut rate = asked;
        for k in 0.. {
            if (Travel::from(k) - 1) << 32 > lead + memory * rate {
                return rate;
            }
            let Some(cap) = (k < held).then(|| way.cap(k)).flatten() else {
                return rate.min(((room - lead) / memory).max(ONE));
            };
            rate = rate.min(Travel::from(cap.get()) << 28);
        }
        rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::PulseLimits;
    use proptest::prelude::*;

    #[derive(Debug, Clone)]
    struct Strip {
        low: u32,
        high: u32,
        rests: Vec<u32>,
        slow: Vec<u32>,
    }

    impl RecordWindow<1> for Strip {
        fn low(&self) -> u32 {
            self.low
        }
        fn high(&self) -> u32 {
            self.high
        }
        fn rests_at(&self, place: u32) -> bool {
            self.rests.contains(&place)
        }
        fn cap(&self, place: u32) -> RapidCap {
            if self.slow.contains(&place) { RapidCap::PLANNED } else { RapidCap::MAX }
        }
        fn increments(&self, place: u32) -> [i16; 1] {
            [if self.slow.contains(&place) { 100 } else { 12 }]
        }
        fn is_rapid(&self, place: u32) -> bool {
            !self.slow.contains(&place)
        }
    }

    /// A drive whose commanded rate may jump, the cursor being its average.
    fn drive(average: u16) -> Drive<1, 64> {
        let stiff = PulseLimits { velocity: 1 << 32, acceleration: 1 << 40, jerk: 1 << 40 };
        Drive::new(RateLimits::new(average, 1 << 15, [stiff]).expect("valid")).expect("fits")
    }

    /// One with limits: |q'| up to 100 pulses, and slopes from a 4 000th to a 30th of a rate a period.
    fn soft(average: u16, share: u16) -> Drive<1, 64> {
        let axis = PulseLimits { velocity: 100 << 32, acceleration: 3 << 32, jerk: 1 << 32 };
        Drive::new(RateLimits::new(average, share, [axis]).expect("valid")).expect("fits")
    }

    fn strip(low: u32, high: u32, rests: &[u32]) -> Strip {
        Strip { low, high, rests: rests.to_vec(), slow: Vec::new() }
    }

    #[test]
    fn planned_stops_cost_no_period() {
        let road = strip(0, 100, &[0, 10, 11, 50, 100]);
        let (mut drive, mut at) = (drive(13), Place::start_of(0));
        for k in 1..=100 {
            at = drive.step(at, ONE, &road).to;
            assert_eq!(at, Place::start_of(k));
        }
        assert!(drive.at_rest());
        for k in (0..100).rev() {
            at = drive.step(at, -ONE, &road).to;
            assert_eq!(at, Place::start_of(k));
        }
        assert!(drive.at_rest());
    }

    #[test]
    fn an_end_that_is_no_planned_stop_is_reached_exactly_and_called_short() {
        let road = strip(0, 100, &[0]);
        let (mut drive, mut at, mut short) = (drive(13), Place::start_of(0), false);
        for _ in 0..200 {
            let step = drive.step(at, ONE, &road);
            (at, short) = (step.to, short | step.short);
        }
        assert_eq!((at, short, drive.at_rest()), (Place::start_of(100), true, true));
    }

    #[test]
    fn from_a_planned_stop_the_rate_jumps_as_far_as_the_road_allows() {
        let first = |high: u32, rests: &[u32], target: Travel| {
            let mut drive = drive(13);
            let step = drive.step(Place::start_of(0), target, &strip(0, high, rests));
            assert_eq!(drive.at_rest(), step.to == Place::start_of(0));
            (Place::start_of(0).to(step.to), step.short)
        };
        // the lead at rate one is six records, and the commanded place goes on by one
        assert_eq!(first(100, &[0], ONE), (ONE, false));
        assert_eq!(first(7, &[0], ONE), (ONE, false));
        assert_eq!(first(5, &[0], ONE), (5 * ONE / 7, true));
        assert_eq!(first(5, &[0, 5], ONE), (ONE, false));
        assert_eq!(first(100, &[0], ONE / 3), (ONE / 3, false));
        assert_eq!(first(0, &[0], ONE), (0, true));
        // anywhere else it follows the law
        let law = first(100, &[], ONE).0;
        assert_eq!(law, ONE / 13);
    }

    #[test]
    fn standing_behind_a_planned_stop_but_not_on_it_the_rate_follows_the_law() {
        let road = strip(0, 100, &[0]);
        let mut drive = drive(13);
        let mut at = drive.step(Place::start_of(0), ONE / 9, &road).to;
        while !drive.at_rest() {
            at = drive.step(at, 0, &road).to;
        }
        assert!(at.record == 0 && at.fraction != 0);
        let to = drive.step(at, ONE, &road).to;
        // first to the next boundary, at the law's pace
        assert_eq!(at.to(to), (ONE - Travel::from(at.fraction)) / 13);
    }

    proptest! {
        /// Feed and rapid motion in turn, records that arrive late, any overrides: neither kind is ever run faster than its override, both
        /// are run at it, and no more than one of them slows the other.
        #[test]
        fn each_kind_of_motion_keeps_its_own_override(
            average in 2u16..30, share in 500u16..30_000,
            (feed, rapid) in (1..=ONE, 1..=ONE), lengths in prop::collection::vec(1u32..400, 2..6), ahead in 8u32..600,
        ) {
            let mut bounds = vec![0u32];
            lengths.iter().for_each(|length| bounds.push(bounds[bounds.len() - 1] + length));
            let end = bounds[bounds.len() - 1];
            let mut road = strip(0, 0, &[0, end]);
            road.slow = bounds.windows(2).step_by(2).flat_map(|bounds| bounds[0]..bounds[1]).collect();
            let slow = road.slow.iter().copied().collect::<std::collections::HashSet<u32>>();
            let (mut drive, mut at) = (soft(average & !1 | 1, share), Place::start_of(0));
            let target = RateTarget { feed, rapid };
            let least = feed.min(rapid);
            for _ in 0..(u64::from(end) * ONE as u64 / least as u64).min(20_000) {
                road.high = road.high.max(at.record + ahead).min(end);
                let asked = drive.within_overrides(at, target, &road);
                prop_assert!((least..=feed.max(rapid)).contains(&asked));
                let to = drive.step(at, asked, &road).to;
                for record in at.record..to.boundary_ahead() {
                    let most = if slow.contains(&record) { feed } else { rapid };
                    prop_assert!(at.to(to) <= most + 1, "record {record}: {} above {most}", at.to(to));
                }
                at = to;
            }
        }
    }

    proptest! {
        /// Whatever a host asks for: no overflow, and nothing beyond what was asked.
        #[test]
        fn any_two_rates_are_taken(feed in any::<i64>(), rapid in prop_oneof![any::<i64>(), Just(0), Just(ONE)], at in 0u32..100) {
            let (road, drive) = (strip(0, 100, &[0, 100]), soft(13, 1 << 15));
            let target = RateTarget { feed, rapid };
            let rate = drive.within_overrides(Place::start_of(at), target, &road);
            prop_assert!(rate == 0 || rate.signum() == feed.signum() && rate.signum() == rapid.signum() || feed == 0 || rapid == 0);
            prop_assert!(rate.unsigned_abs() <= target.faster().unsigned_abs());
        }
    }

    #[test]
    fn rapid_motion_runs_at_its_override_up_to_where_it_has_to_slow_down() {
        let mut road = strip(0, 6000, &[0, 6000]);
        road.slow = (0..1000).chain(4000..6000).collect();
        let (mut drive, mut at, mut fastest, mut rates) = (soft(13, 1 << 15), Place::start_of(0), 0, Vec::new());
        let target = RateTarget { feed: ONE / 5, rapid: ONE };
        while at != Place::start_of(6000) {
            let to = drive.step(at, drive.within_overrides(at, target, &road), &road).to;
            fastest = fastest.max(at.to(to));
            if at.to(to) == ONE {
                rates.push(at.record);
            }
            at = to;
        }
        assert_eq!(fastest, ONE);
        // it takes the machine some 115 records to slow down
        let ramps = (1000..1300).contains(&rates[0]) && (3700..4000).contains(&rates[rates.len() - 1]);
        assert!(ramps, "{} … {}", rates[0], rates[rates.len() - 1]);
    }

    #[test]
    fn rapid_retrace_keeps_every_cap_and_gets_faster_where_it_may() {
        for sign in [1, -1] {
            let mut road = strip(0, 3000, &[0, 3000]);
            road.slow = (1000..1010).collect();
            let (from, end) = if sign > 0 { (0, 3000) } else { (3000, 0) };
            let (mut drive, mut at, mut periods) = (drive(13), Place::start_of(from), 0);
            while at != Place::start_of(end) {
                let to = drive.step(at, sign * 20 * ONE, &road).to;
                within_caps(at, to, &road);
                (at, periods) = (to, periods + 1);
            }
            assert!((3000 / 8..3000 / 5).contains(&periods), "{periods}");
        }
    }

    /// The window slides as the cursor goes: what comes into it last may be slow, and is not known before.
    #[test]
    fn rapid_retrace_is_only_as_fast_as_the_window_is_long() {
        for sign in [1, -1] {
            for ahead in [20, 40, 60, 90] {
                let mut road = strip(10_000, 10_000, &[10_000]);
                road.slow = (8_500..8_520).chain(11_500..11_520).collect();
                let (mut drive, mut at, mut fastest) = (drive(13), Place::start_of(10_000), 0);
                for _ in 0..2200 {
                    road.high = road.high.max(at.record + ahead).min(12_000);
                    road.low = road.low.min(at.record - ahead).max(8_000);
                    let to = drive.step(at, sign * 8 * ONE, &road).to;
                    within_caps(at, to, &road);
                    fastest = fastest.max(at.to(to).abs());
                    at = to;
                }
                assert_eq!(at.record, if sign > 0 { 12_000 } else { 8_000 });
                // what is asked now works for thirteen periods and four; a steady rate has a lead of six besides
                let (most, least) = (Travel::from(ahead) * ONE / 17, Travel::from(ahead) * ONE / 23);
                assert!(fastest <= most.max(ONE) && fastest >= least.max(ONE) - ONE / 2, "{ahead}: {fastest}");
            }
        }
    }

    /// No record that the cursor passes is passed faster than its cap.
    fn within_caps(at: Place, to: Place, road: &Strip) {
        let rate = at.to(to).abs();
        let (low, high) = if at.to(to) > 0 { (at, to) } else { (to, at) };
        let mut n = low.record;
        while n != high.boundary_ahead() {
            assert!(rate <= i64::from(road.cap(n).get()) << 28 || rate <= ONE, "record {n} at rate {rate}");
            n = n.wrapping_add(1);
        }
    }

    /// What a host may do between two periods.
    #[derive(Debug, Clone)]
    enum Deed {
        Extend(u32, bool, bool),
        ExtendBack(u32, bool, bool),
        Run(i64, u32),
    }

    fn deeds() -> impl Strategy<Value = Vec<Deed>> {
        let rate = prop_oneof![Just(ONE), Just(-ONE), Just(0), Just(ONE / 3), -8 * ONE..8 * ONE];
        let deed = prop_oneof![
            (0u32..40, any::<bool>(), any::<bool>()).prop_map(|(n, r, slow)| Deed::Extend(n, r, slow)),
            (0u32..40, any::<bool>(), any::<bool>()).prop_map(|(n, r, slow)| Deed::ExtendBack(n, r, slow)),
            (rate, 1u32..40).prop_map(|(r, n)| Deed::Run(r, n)),
        ];
        prop::collection::vec(deed, 1..80)
    }

    proptest! {
        /// Whatever is asked when, and however the road grows: the cursor never leaves the road, never moves against the sign of
        /// what is asked unless it is braking, passes no record faster than its cap, and with a target held comes to rest exactly on
        /// the end of the road. At rate ±1 it goes from record boundary to record boundary.
        #[test]
        fn never_leaves_the_road_and_rests_on_its_end(
            half in 0u16..8, share in prop_oneof![Just(None), (1u16..60_000).prop_map(Some)], start in any::<u32>(), deeds in deeds(), forward in any::<bool>(),
        ) {
            let mut drive = share.map_or_else(|| drive(2 * half + 1), |share| soft(2 * half + 3, share));
            let mut road = strip(start, start, &[start]);
            let mut at = Place::start_of(start);
            // after a rapid stretch a mean of one may be the mean of more and less
            let rapid = deeds.iter().any(|d| matches!(d, Deed::Run(rate, _) if rate.abs() > ONE));
            let mut last = 0;
            let run = |drive: &mut Drive<1, 64>, at: &mut Place, last: &mut Travel, road: &Strip, target: Travel, n: u32| {
                for _ in 0..n {
                    let step = drive.step(*at, target, road);
                    assert!(Place::start_of(road.low).to(step.to) >= 0, "below the road");
                    assert!(step.to.to(Place::start_of(road.high)) >= 0, "beyond the road");
                    assert!(at.to(step.to).abs() <= 8 * ONE);
                    within_caps(*at, step.to, road);
                    let rate = at.to(step.to);
                    let steady = rate.abs() == ONE && rate == *last;
                    // but for what is lost below the last bit of a rate while it settles
                    let off = step.to.fraction.min(step.to.fraction.wrapping_neg());
                    assert!(rapid || !steady || off < 1 << 12, "a split record at rate one");
                    *last = rate;
                    *at = step.to;
                }
            };
            for deed in deeds {
                match deed {
                    Deed::Extend(n, rest, slow) => {
                        if slow && n > 0 { road.slow.push(road.high); }
                        road.high = road.high.wrapping_add(n);
                        if rest && n > 0 { road.rests.push(road.high); }
                    }
                    Deed::ExtendBack(n, rest, slow) => {
                        road.low = road.low.wrapping_sub(n);
                        if slow && n > 0 { road.slow.push(road.low); }
                        if rest && n > 0 { road.rests.push(road.low); }
                    }
                    Deed::Run(rate, n) => run(&mut drive, &mut at, &mut last, &road, rate, n),
                }
            }
            let (target, end) = if forward { (ONE, road.high) } else { (-ONE, road.low) };
            let length = road.high.wrapping_sub(road.low);
            run(&mut drive, &mut at, &mut last, &road, target, 20 * length + 4000);
            prop_assert_eq!(at, Place::start_of(end));
            prop_assert!(drive.at_rest());
        }
    }
}
