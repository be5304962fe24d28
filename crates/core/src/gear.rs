//! Gearing: the place on the path as a function of the spindle's angle (SPN-11, SPN-13 … SPN-15).
//!
//! A geared stretch is an ordinary part of the recorded path. Only its time is angle: a period emits the pulses between
//! the place of the angle at its beginning and that of the angle at its end. So the same angle is the same place, at
//! any speed of the spindle and in both directions, and an error of the angle that was foreseen is made good in the
//! next period. Where the angle asks for more than the axes can do, the cursor lags and keeps its anchor.
//!
//! Invariant: the anchor does not change while the cursor is inside the stretch, and the cursor never leaves it.

use crate::{Distance, Rate};

/// Units of an angle in one count of the encoder.
pub const UNITS_PER_COUNT: i64 = 1 << 8;

/// Maximum counts of the encoder in a turn of the spindle.
pub const MAX_COUNTS_PER_TURN: u32 = 1 << 17;

/// A change of the encoder's counter by this many counts between two samples, or more, is an error.
pub const COUNTER_STEP_LIMIT: u16 = 1 << 14;

/// Returns the count that a counter of 16 bits shows which wraps: the one nearest to `count`, the count before. `None`
/// if that is [`COUNTER_STEP_LIMIT`] counts away or more, so that the direction is in doubt.
///
/// # Examples
///
/// ```
/// use retrace_core::gear::extended_count;
///
/// assert_eq!(extended_count(65_535, 3), Some(65_539));
/// assert_eq!(extended_count(65_536, 65_535), Some(65_535));
/// assert_eq!(extended_count(0, 1 << 15), None);
/// ```
#[must_use]
pub const fn extended_count(count: i64, counter: u16) -> Option<i64> {
    let step = counter.wrapping_sub(count as u16) as i16;
    if step.unsigned_abs() < COUNTER_STEP_LIMIT { Some(count.wrapping_add(step as i64)) } else { None }
}

/// Records that the cursor passes in a turn of the spindle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct GearRatio {
    /// Units of angle in a turn.
    turn: i64,
    records_per_turn: i64,
}

impl GearRatio {
    /// Returns the ratio; `None` if one of the numbers is 0, or there are more than [`MAX_COUNTS_PER_TURN`].
    #[must_use]
    pub const fn new(counts_per_turn: u32, records_per_turn: u16) -> Option<Self> {
        if counts_per_turn == 0 || counts_per_turn > MAX_COUNTS_PER_TURN || records_per_turn == 0 {
            return None;
        }
        let turn = counts_per_turn as i64 * UNITS_PER_COUNT;
        Some(Self { turn, records_per_turn: records_per_turn as i64 })
    }

    /// Returns the units of angle in a turn.
    #[must_use]
    pub const fn turn(self) -> i64 {
        self.turn
    }

    /// Returns the distance that the cursor has passed when the spindle has turned by `angle`: whole turns, and the
    /// share of the turn rounded down to 2⁻³² records. It grows with the angle, and is limited to ±2³⁰ records.
    ///
    /// # Examples
    ///
    /// ```
    /// use retrace_core::gear::{GearRatio, UNITS_PER_COUNT};
    /// use retrace_core::Distance;
    ///
    /// let ratio = GearRatio::new(400, 48).unwrap();
    /// assert_eq!(ratio.distance(100 * UNITS_PER_COUNT), Distance::records(12), "a quarter of a turn");
    /// assert_eq!(ratio.distance(-ratio.turn()), Distance::records(-48));
    /// ```
    #[must_use]
    pub const fn distance(self, angle: i64) -> Distance {
        let Self { turn, records_per_turn } = self;
        let most = (1 << 30) / records_per_turn;
        let turns = angle.div_euclid(turn);
        if turns >= most {
            return Distance::records(most * records_per_turn);
        }
        if turns < -most {
            return Distance::records(-most * records_per_turn);
        }
        // below 2²⁵ · 2¹⁶, then below 2²⁵ · 2³²
        let share = angle.rem_euclid(turn) * records_per_turn;
        let (records, rest) = (share / turn, share % turn);
        Distance::from_units(((turns * records_per_turn + records) << 32) + (rest << 32) / turn)
    }

    /// Returns the smallest angle whose distance is at least this one, which is from 0 to 2³⁰ records.
    #[must_use]
    pub const fn angle_of(self, distance: Distance) -> i64 {
        let records = distance.units() >> 32;
        let (turns, rest) = (records / self.records_per_turn, records % self.records_per_turn);
        // An estimate from below, then up to what reaches the distance: a unit of angle is at most 2³²·2¹⁶ units.
        let mut angle = turns * self.turn + rest * self.turn / self.records_per_turn;
        let missing = distance.units() - self.distance(angle).units();
        if missing > 0 {
            angle += ((missing >> 16) * self.turn / self.records_per_turn) >> 16;
            while self.distance(angle).units() < distance.units() {
                angle += 1;
            }
        }
        angle
    }
}

/// Limits of the cursor's motion in a geared stretch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct GearLimits {
    /// Maximum rate.
    pub rate: Rate,
    /// Distance from either end within which the records change their speed.
    pub near_end: Distance,
    /// Maximum lag.
    pub tolerance: Distance,
}

/// Gearing of one stretch. Angles count up in the direction in which the stretch is passed forward.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Gear {
    ratio: GearRatio,
    length: Distance,
    limits: GearLimits,
    /// Angle at which the cursor is where the stretch begins.
    anchor: i64,
    /// Distance of the cursor from where the stretch begins.
    at: Distance,
    /// Distance that the cursor moved in the last period.
    moved: Distance,
    /// Distance that belongs to the angle at the end of the last period, not limited to the stretch.
    due: Distance,
    /// Control periods until the limit of change applies: the stretch is left from rest.
    starting: u8,
}

/// Control periods without a limit of change at the beginning: the one that contains the anchor, and the first whole
/// one. The records there are at rest.
const STARTING_PERIODS: u8 = 2;

/// Result of a control period of a geared stretch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GearStep {
    /// Distance that the cursor moves.
    pub moved: Distance,
    /// Distance from the cursor to the place of the angle.
    pub lag: Distance,
    /// Whether the lag is beyond the tolerance.
    pub is_lost: bool,
}

impl Gear {
    /// Engages the gear at rest at the beginning of a stretch of `length` records, or at its end if `at_end`. The
    /// stretch begins at the angle `start` of a turn. Returns `None` unless that angle, or that of the end, lies in the
    /// period in which the angle goes `from … to`: behind `from` in the direction of the motion, and not behind `to`.
    /// `from` and `to` are within 2⁶⁰.
    #[must_use]
    pub fn engage(
        ratio: GearRatio,
        (length, at_end): (u32, bool),
        limits: GearLimits,
        start: i64,
        [from, to]: [i64; 2],
    ) -> Option<Self> {
        let length = Distance::records(i64::from(length));
        let at = if at_end { length } else { Distance::ZERO };
        let phase = start + if at_end { ratio.angle_of(length) } else { 0 };
        // The first angle with this phase behind `from` in the direction of the motion.
        let ahead = if at_end { (from - phase).rem_euclid(ratio.turn) } else { (phase - from).rem_euclid(ratio.turn) };
        let ahead = if ahead == 0 { ratio.turn } else { ahead };
        let passed = if at_end { from - to } else { to - from };
        if ahead > passed {
            return None;
        }
        let engaged = if at_end { from - ahead } else { from + ahead };
        let anchor = engaged - (phase - start);
        Some(Self { ratio, length, limits, anchor, at, moved: Distance::ZERO, due: at, starting: STARTING_PERIODS })
    }

    /// Angle at which the cursor is where the stretch begins.
    #[must_use]
    pub const fn anchor(&self) -> i64 {
        self.anchor
    }

    /// Distance of the cursor from where the stretch begins.
    #[must_use]
    pub const fn at(&self) -> Distance {
        self.at
    }

    /// Distance from the cursor to the place of this angle, not limited to the stretch.
    #[must_use]
    pub fn lag_at(&self, angle: i64) -> Distance {
        self.ratio.distance(angle.saturating_sub(self.anchor)) - self.at
    }

    /// Whether the cursor is near an end of the stretch.
    #[must_use]
    pub fn is_near_end(&self) -> bool {
        self.at < self.limits.near_end || self.length - self.at < self.limits.near_end
    }

    /// Whether the cursor is at rest at the end of the stretch, and the angle is beyond it.
    #[must_use]
    pub fn has_passed_end(&self) -> bool {
        self.at == self.length && self.due >= self.length
    }

    /// Whether the cursor is at rest at the beginning of the stretch, and the angle is before it.
    #[must_use]
    pub fn has_passed_beginning(&self) -> bool {
        self.at == Distance::ZERO && self.due < Distance::ZERO
    }

    /// Runs one control period, at whose end the angle is `angle`. `held`: the records of the stretch that the card
    /// holds, by their distance from its beginning in records; the cursor is between them. `change`: maximum change of
    /// the rate in this period.
    pub fn run_period(&mut self, angle: i64, held: [u32; 2], change: Rate) -> GearStep {
        let due = self.ratio.distance(angle.saturating_sub(self.anchor));
        let spindle = due - self.due;
        self.due = due;
        let demand = self.within(due) - self.at;
        let [low, high] = held.map(|records| self.within(Distance::records(i64::from(records))));
        let moved = if self.starting > 0 {
            self.starting -= 1;
            demand.clamp(-self.limits.rate.over(1), self.limits.rate.over(1))
        } else {
            self.limited(demand, spindle, [low, high], change.over(1))
        };
        let to = self.within(self.at + moved).min(high.max(self.at)).max(low.min(self.at));
        self.moved = to - self.at;
        self.at = to;
        self.stepped()
    }

    /// Brakes on the path, whatever the angle, with this change of the rate per period.
    pub fn brake(&mut self, change: Rate) -> GearStep {
        let change = change.over(1);
        let moved = self.moved.abs() - change;
        let moved = if moved <= Distance::ZERO { Distance::ZERO } else { moved };
        let to = self.within(self.at + if self.moved < Distance::ZERO { -moved } else { moved });
        self.moved = to - self.at;
        self.at = to;
        GearStep { is_lost: false, ..self.stepped() }
    }

    fn stepped(&self) -> GearStep {
        let lag = self.within(self.due) - self.at;
        GearStep { moved: self.moved, lag, is_lost: lag.abs() > self.limits.tolerance }
    }

    fn within(&self, distance: Distance) -> Distance {
        distance.clamp(Distance::ZERO, self.length)
    }

    /// Returns the distance to move within the limits, where the place of the angle is `demand` away, the spindle
    /// turned by `spindle` in the period, and the records are held from `low` to `high`.
    fn limited(&self, demand: Distance, spindle: Distance, [low, high]: [Distance; 2], change: Distance) -> Distance {
        let most = self.limits.rate.over(1);
        let within_change = |distance: Distance| distance.clamp(self.moved - change, self.moved + change);
        // What is caught up at once must be given up again in the next period.
        let wanted = if within_change(demand) == demand && (demand - spindle).abs() <= change {
            demand
        } else {
            // The lag is caught up by an eighth of it per period, and no faster than can be given up again.
            let catch_up = (demand - spindle) / 8;
            spindle + catch_up.clamp(change * -8, change * 8)
        };
        let moved = within_change(wanted).clamp(-most, most);
        let [is_beginning, is_end] = [low == Distance::ZERO, high == self.length];
        if !is_end && moved > Distance::ZERO && !stops_within(moved, change, high - self.at - moved) {
            return (self.moved - change).clamp(Distance::ZERO, most);
        }
        if !is_beginning && moved < Distance::ZERO && !stops_within(-moved, change, self.at + moved - low) {
            return (self.moved + change).clamp(-most, Distance::ZERO);
        }
        moved
    }
}

/// Whether a cursor that moves `moved` per period can come to rest within `room`, with a change of `change` per period.
fn stops_within(moved: Distance, change: Distance, room: Distance) -> bool {
    // Sixteen bits fewer, so that the products fit: at most eight records per period.
    let [moved, change, room] = [(moved.units() >> 16) + 1, change.units() >> 16, room.units() >> 16];
    moved * moved <= 2 * change * room
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TURN: i64 = 400 * UNITS_PER_COUNT;

    fn ratio() -> GearRatio {
        GearRatio::new(400, 48).expect("valid")
    }

    const CHANGE: Rate = Rate::from_units(Rate::ONE.units() / 50);

    fn limits() -> GearLimits {
        GearLimits { rate: Rate::ONE * 21 / 20, near_end: Distance::records(80), tolerance: Distance::RECORD }
    }

    fn engaged(length: u32) -> Gear {
        Gear::engage(ratio(), (length, false), limits(), 0, [-10, 2000]).expect("the anchor is in the period")
    }

    proptest! {
        /// The distance of an angle is the exact quotient, rounded down.
        #[test]
        fn the_distance_is_the_exact_quotient(
            counts in 1..=MAX_COUNTS_PER_TURN, records in 1u16.., angle in -(1i64 << 38)..(1 << 38),
        ) {
            let ratio = GearRatio::new(counts, records).expect("valid");
            let exact = (i128::from(angle) * i128::from(records)) << 32;
            let exact = exact.div_euclid(i128::from(ratio.turn()));
            let most = i128::from((1i64 << 30) / i64::from(records) * i64::from(records)) << 32;
            prop_assert_eq!(i128::from(ratio.distance(angle).units()), exact.clamp(-most, most));
        }

        /// The angle of a distance reaches it, and the angle before does not.
        #[test]
        fn the_angle_of_a_distance_reaches_it(
            counts in 1..=MAX_COUNTS_PER_TURN, records in 1u16.., length in 0..1u32 << 20,
        ) {
            let ratio = GearRatio::new(counts, records).expect("valid");
            let distance = Distance::records(i64::from(length));
            let angle = ratio.angle_of(distance);
            prop_assert!(ratio.distance(angle) >= distance && ratio.distance(angle - 1) < distance);
        }

        /// The first period behind the anchor emits its angle, and no more; nothing is engaged elsewhere.
        #[test]
        fn the_gear_is_engaged_in_the_period_of_its_anchor(
            start in 0..TURN, from in -(1i64 << 40)..1 << 40, passed in 0i64..2000, at_end: bool,
        ) {
            let to = if at_end { from - passed } else { from + passed };
            let length = 480;
            let gear = Gear::engage(ratio(), (length, at_end), limits(), start, [from, to]);
            let phase = start + if at_end { ratio().angle_of(Distance::records(480)) } else { 0 };
            let after = |by: i64| if at_end { from - by } else { from + by };
            let passes = (1..=passed).any(|by| (after(by) - phase).rem_euclid(TURN) == 0);
            prop_assert_eq!(gear.is_some(), passes);
            if let Some(mut gear) = gear {
                prop_assert_eq!((gear.anchor() - start).rem_euclid(TURN), 0);
                let before = gear.at();
                let step = gear.run_period(to, [0, length], CHANGE);
                prop_assert!(step.moved.abs() <= ratio().distance(passed) + Distance::from_units(1), "{step:?}");
                prop_assert_eq!(gear.at(), before + step.moved);
                prop_assert_eq!(step.lag, Distance::ZERO);
            }
        }

        /// Within the limits the cursor is at the place of the angle; a walk of angles that returns has moved by zero.
        #[test]
        fn the_place_follows_the_angle(steps in prop::collection::vec(-2000i64..2100, 1..80)) {
            let mut gear = Gear {
                limits: GearLimits { rate: Rate::MAX, ..limits() },
                ..engaged(2000)
            };
            let mut angle = gear.anchor();
            gear.run_period(angle, [0, 2000], Rate::MAX);
            let start = gear.at();
            let mut sum = Distance::ZERO;
            for &step in &steps {
                angle = (angle + step).max(gear.anchor());
                sum += gear.run_period(angle, [0, 2000], Rate::MAX).moved;
                prop_assert_eq!(gear.at(), gear.within(ratio().distance(angle - gear.anchor())));
            }
            while angle > gear.anchor() {
                angle = (angle - 2000).max(gear.anchor());
                sum += gear.run_period(angle, [0, 2000], Rate::MAX).moved;
            }
            prop_assert_eq!((gear.at(), sum), (start, Distance::ZERO));
        }

        /// Whatever the angle does: the limits are kept, the cursor stays on the records that are held, a lag beyond
        /// the tolerance is reported in its period, and the anchor stays.
        #[test]
        fn limits_are_kept_and_a_lag_is_told(
            angles in prop::collection::vec((-4000i64..6000, 0u32..20), 1..200), length in 1u32..3000,
        ) {
            let mut gear = engaged(length);
            let (anchor, mut angle, mut held, mut last) = (gear.anchor(), gear.anchor(), length / 2, Distance::ZERO);
            for (n, (by, more)) in angles.into_iter().enumerate() {
                angle += by;
                held = (held + more).min(length);
                let change = CHANGE.over(1);
                let step = gear.run_period(angle, [0, held], CHANGE);
                prop_assert!(step.moved.abs() <= limits().rate.over(1));
                let ends = gear.at() == Distance::ZERO || gear.at() == gear.length;
                let stops_at_held = gear.at() == Distance::records(i64::from(held));
                if n >= 2 && !ends && !stops_at_held {
                    prop_assert!((step.moved - last).abs() <= change, "{n}: {last:?} {step:?}");
                }
                prop_assert!(gear.at() >= Distance::ZERO && gear.at() <= Distance::records(i64::from(held)));
                let wanted = gear.within(ratio().distance(angle - anchor));
                prop_assert_eq!(step.lag, wanted - gear.at());
                prop_assert_eq!(step.is_lost, step.lag.abs() > Distance::RECORD);
                prop_assert_eq!(gear.anchor(), anchor);
                last = step.moved;
            }
        }
    }

    #[test]
    fn a_lag_is_caught_up_without_overshoot() {
        let mut gear = engaged(100_000);
        let mut angle = gear.anchor();
        let mut lags = Vec::new();
        for n in 0..400 {
            // 0.8 records per period, but for a jump by a tenth of a turn
            angle += TURN / 60 + if n == 100 { TURN / 50 } else { 0 };
            lags.push(gear.run_period(angle, [0, 100_000], CHANGE).lag);
        }
        assert!(lags[..100].iter().all(|&lag| lag == Distance::ZERO));
        assert!(lags[101] > Distance::RECORD / 2, "{:?}", lags[101]);
        assert!(lags.iter().all(|&lag| lag >= Distance::ZERO), "no overshoot");
        assert_eq!(lags[399], Distance::ZERO);
        assert!(lags[150..].iter().all(|&lag| lag == Distance::ZERO), "{:?}", &lags[140..160]);
    }

    #[test]
    fn braking_ends_at_rest_inside() {
        let mut gear = engaged(2000);
        for n in 1..200 {
            gear.run_period(gear.anchor() + n * TURN / 60, [0, 2000], CHANGE);
        }
        let mut last = gear.moved;
        while gear.moved != Distance::ZERO {
            let step = gear.brake(CHANGE);
            assert!(last - step.moved <= CHANGE.over(1) && step.moved <= last && !step.is_lost);
            last = step.moved;
        }
        assert!(gear.at() < Distance::records(200));
    }
}
