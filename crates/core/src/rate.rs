//! The rate law: how the rate follows its target (REV-12; REV, *Rate law*).
//!
//! A *commanded place* moves along the path at the target rate and stops where it must. The cursor is its moving
//! average, applied twice. All required properties of the law follow from this one idea:
//!
//! - The cursor comes to rest exactly at the resting place of the commanded place, since the mean of equal numbers is
//!   that number. It never passes it, since a mean never exceeds the largest of the averaged numbers.
//! - The rate never overshoots its target and reaches it after at most [`FilterLengths::periods`] control periods.
//! - The remaining distance is known at all times: it is the [`RateFilter::lead`] of the commanded place over the
//!   cursor.
//! - The two lengths alone bound how fast the rate changes, for any sequence of targets. For targets in 0 … 1 the
//!   change |r′| at a rate r is at most what a plain step from 0 to 1 shows at that rate (the trapezoid of two averages
//!   is log-concave), and |r″| ≤ 2/(n₁·n₂) per period². The drive averages over 1 and n periods and lets the target
//!   change with a slope, from which it derives what the axes' limits require ([`crate::drive`]).
//!
//! Invariant: all targets in the memory have one sign; the remainder is in 0 … n₁·n₂; with the memory at zero, lead and
//! remainder are zero.

use crate::{Distance, Rate};

/// Target rates along the path: one for records of feed motion, one for records of rapid motion
/// ([`crate::Flags::RAPID`]).
///
/// Two rates of different signs request no motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct RateTarget {
    /// Maximum rate along feed motion.
    pub feed: Rate,
    /// Maximum rate along rapid motion.
    pub rapid: Rate,
}

impl RateTarget {
    /// At rest.
    pub const ZERO: Self = Self::both(Rate::ZERO);

    /// Returns a target with the same rate for feed and rapid motion.
    #[must_use]
    pub const fn both(rate: Rate) -> Self {
        Self { feed: rate, rapid: rate }
    }

    /// Returns the faster of the two rates; 0 if their signs differ.
    #[must_use]
    pub const fn faster(self) -> Rate {
        self.ordered().0
    }

    /// Returns the slower of the two rates; 0 if their signs differ.
    #[must_use]
    pub const fn slower(self) -> Rate {
        self.ordered().1
    }

    /// Returns the faster and the slower rate.
    const fn ordered(self) -> (Rate, Rate) {
        let Self { feed, rapid } = self;
        if feed.signum() * rapid.signum() < 0 {
            (Rate::ZERO, Rate::ZERO)
        } else if feed.units().unsigned_abs() >= rapid.units().unsigned_abs() {
            (feed, rapid)
        } else {
            (rapid, feed)
        }
    }
}

/// Lengths of the two moving averages, in control periods.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilterLengths {
    first: u16,
    second: u16,
}

impl FilterLengths {
    /// Maximum length of an average, in periods: sums of rates up to 8 then fit 64 bits.
    pub const MAX_PERIODS: u16 = 4096;

    /// Returns the lengths `first` and `second`, in periods.
    ///
    /// Returns `None` if one is zero or above [`FilterLengths::MAX_PERIODS`], or if their sum is odd (a steady rate
    /// then has a lead of half a unit, which would not be exact).
    #[must_use]
    pub const fn new(first: u16, second: u16) -> Option<Self> {
        let lengths = 1 <= first && first <= Self::MAX_PERIODS && 1 <= second && second <= Self::MAX_PERIODS;
        let valid = lengths && (first + second).is_multiple_of(2);
        if valid { Some(Self { first, second }) } else { None }
    }

    /// Returns the length of the first average, in periods.
    #[must_use]
    pub const fn first(self) -> u16 {
        self.first
    }

    /// Returns the length of the second average, in periods.
    #[must_use]
    pub const fn second(self) -> u16 {
        self.second
    }

    /// Returns the periods after which a new target is reached, and the cursor is at rest after the commanded place has
    /// come to rest.
    #[must_use]
    pub const fn periods(self) -> u16 {
        self.first + self.second - 1
    }

    /// Returns the lead of the commanded place over the cursor at a steady rate of one, in records: the stopping
    /// distance.
    #[must_use]
    pub const fn stopping_records(self) -> u16 {
        (self.first + self.second - 2) / 2
    }
}

/// Moving sum of the last `length` values, in units of 2⁻³² records per period: of rates, or of such sums.
#[derive(Clone, Debug)]
struct MovingAverage<const M: usize> {
    values: [i64; M],
    length: u16,
    at: u16,
    sum: i64,
}

impl<const M: usize> MovingAverage<M> {
    const fn new(length: u16) -> Self {
        Self { values: [0; M], length, at: 0, sum: 0 }
    }

    #[inline]
    fn push(&mut self, value: i64) -> i64 {
        let oldest = &mut self.values[self.at as usize];
        self.sum += value - *oldest;
        *oldest = value;
        self.at = if self.at + 1 == self.length { 0 } else { self.at + 1 };
        self.sum
    }

    const fn newest(&self) -> i64 {
        let at = if self.at == 0 { self.length } else { self.at };
        self.values[at as usize - 1]
    }

    fn fill(&mut self, value: i64) {
        self.values[..self.length as usize].fill(value);
        self.sum = value * i64::from(self.length);
    }
}

/// What the commanded place is ahead of the cursor by: the part of a filter's state that is not its memory.
///
/// Invariant: n₁·n₂ times the lead is what the memory has not let the cursor run yet, and the remainder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilterBalance {
    /// Distance from the cursor to the commanded place.
    pub lead: Distance,
    /// Part below the last bit of the distance moved, in 0 … n₁·n₂ − 1, in units of 2⁻³²/(n₁·n₂) records.
    pub remainder: i64,
}

impl FilterBalance {
    /// At rest, with nothing remembered.
    pub const ZERO: Self = Self { lead: Distance::ZERO, remainder: 0 };

    /// Returns the balance after a control period, and the distance that the cursor moves in it.
    ///
    /// `sum` is the sum over both averages, `target` included, in units of 2⁻³² records per period; `weights` is n₁·n₂.
    /// |`sum`| is at most n₁·n₂·[`Rate::MAX`].
    #[inline]
    #[must_use]
    pub const fn after_period(self, target: Rate, sum: i64, weights: i64) -> (Self, Distance) {
        let moved = Distance::from_units((sum + self.remainder).div_euclid(weights));
        (self.after_moving(moved, target, sum, weights), moved)
    }

    /// Returns the balance after a control period in which the cursor moves by `moved`: the whole units in the sum and
    /// the remainder ([`FilterBalance::after_period`]).
    #[inline]
    #[must_use]
    pub const fn after_moving(self, moved: Distance, target: Rate, sum: i64, weights: i64) -> Self {
        let lead = Distance::from_units(self.lead.units() + target.units() - moved.units());
        Self { lead, remainder: sum + self.remainder - moved.units() * weights }
    }
}

/// State of the rate law: the memory of both averages, for lengths up to `M`.
///
/// # Examples
///
/// ```
/// use retrace_core::rate::{FilterLengths, RateFilter};
/// use retrace_core::{Distance, Rate};
///
/// let mut filter = RateFilter::<8>::new(FilterLengths::new(1, 5).unwrap()).unwrap();
/// let speeding_up: Vec<Distance> = (0..5).map(|_| filter.step(Rate::ONE)).collect();
/// assert!(speeding_up.is_sorted());
/// assert_eq!(speeding_up[4], Distance::RECORD);
/// // from here on it stops exactly where the commanded place has stopped
/// let (lead, mut run) = (filter.lead(), Distance::ZERO);
/// while !filter.at_rest() {
///     run += filter.step(Rate::ZERO);
/// }
/// assert_eq!(run, lead);
/// ```
#[derive(Clone, Debug)]
pub struct RateFilter<const M: usize> {
    lengths: FilterLengths,
    targets: MovingAverage<M>,
    sums: MovingAverage<M>,
    balance: FilterBalance,
}

impl<const M: usize> RateFilter<M> {
    /// Creates a filter at rest. Returns `None` if a length exceeds the memory.
    #[must_use]
    pub const fn new(smoothing: FilterLengths) -> Option<Self> {
        if smoothing.first as usize > M || smoothing.second as usize > M {
            return None;
        }
        let (targets, sums) = (MovingAverage::new(smoothing.first), MovingAverage::new(smoothing.second));
        Some(Self { lengths: smoothing, targets, sums, balance: FilterBalance::ZERO })
    }

    /// Returns the lengths of the averages.
    #[must_use]
    pub const fn lengths(&self) -> FilterLengths {
        self.lengths
    }

    /// Returns the signed distance from the cursor to the commanded place: how far the cursor still moves if the target
    /// is zero from now on.
    #[must_use]
    pub const fn lead(&self) -> Distance {
        self.balance.lead
    }

    /// Whether the cursor is at rest, with no distance remaining.
    #[must_use]
    pub const fn at_rest(&self) -> bool {
        self.sums.sum == 0
    }

    /// Returns the direction of the remaining motion: 1 forward, −1 backward, 0 at rest.
    #[must_use]
    pub const fn direction(&self) -> i64 {
        self.sums.sum.signum()
    }

    /// Returns the last target.
    #[must_use]
    pub const fn target(&self) -> Rate {
        Rate::from_units(self.targets.newest())
    }

    /// Returns the maximum |target| in the memory, as far as means over the first length show it; exact with a first
    /// length of one.
    #[must_use]
    pub fn max_target(&self) -> Rate {
        let sums = &self.sums.values[..self.sums.length as usize];
        let highest = sums.iter().map(|sum| sum.abs()).max().unwrap_or(0);
        Rate::from_units(highest / i64::from(self.lengths.first))
    }

    /// Advances by one control period and returns the distance that the cursor moves.
    ///
    /// The commanded place moves at `target` (|target| ≤ [`Rate::MAX`], with the sign of the remaining motion).
    #[inline]
    pub fn step(&mut self, target: Rate) -> Distance {
        let sum = self.targets.push(target.units());
        let sum = self.sums.push(sum);
        let weights = i64::from(self.lengths.first) * i64::from(self.lengths.second);
        let (balance, moved) = self.balance.after_period(target, sum, weights);
        self.balance = balance;
        moved
    }

    /// Sets the state that a constant target `rate` leads to. The rate jumps, so this is allowed only where the path
    /// itself is at rest.
    pub fn set_steady(&mut self, rate: Rate) {
        self.targets.fill(rate.units());
        self.sums.fill(self.targets.sum);
        let lead = rate.over(i64::from(self.lengths.stopping_records()));
        self.balance = FilterBalance { lead, remainder: 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Rate one in the units of the tests.
    const ONE: i64 = Rate::ONE.units();

    fn filter(first: u16, second: u16) -> RateFilter<32> {
        RateFilter::new(FilterLengths::new(first, second).expect("valid")).expect("fits")
    }

    /// Lengths with an even sum.
    fn lengths() -> impl Strategy<Value = (u16, u16)> {
        (1u16..=32, 0u16..=15).prop_map(|(a, b)| (a, if a % 2 == 0 { 2 * b + 2 } else { 2 * b + 1 }))
    }

    #[test]
    fn lengths_that_are_not_exact_are_refused() {
        assert_eq!(FilterLengths::new(3, 4), None);
        assert_eq!(FilterLengths::new(0, 4), None);
        assert_eq!(FilterLengths::new(4098, 4), None);
        assert!(RateFilter::<8>::new(FilterLengths::new(10, 2).expect("valid")).is_none());
    }

    /// What an average delays: a target is reached when the last of both lengths has seen it, and the lead is half of
    /// that.
    #[test]
    fn lengths_are_those_of_their_averages() {
        for (a, b) in [(1, 1), (1, 51), (3, 5), (8, 2)] {
            let lengths = FilterLengths::new(a, b).expect("valid");
            assert_eq!((lengths.first(), lengths.second()), (a, b));
            assert_eq!((lengths.periods(), 2 * lengths.stopping_records()), (a + b - 1, a + b - 2));
        }
    }

    #[test]
    fn a_steady_rate_is_steady_and_stops_within_its_lead() {
        for (a, b) in [(1, 1), (3, 5), (8, 8), (32, 2)] {
            for rate in [ONE, -ONE, ONE / 3, 7, -7, 8 * ONE].map(Rate::from_units) {
                let mut filter = filter(a, b);
                filter.set_steady(rate);
                for _ in 0..100 {
                    assert_eq!(filter.step(rate), rate.over(1));
                    assert_eq!(filter.lead(), rate.over(i64::from(filter.lengths().stopping_records())));
                }
                let (lead, mut run) = (filter.lead(), Distance::ZERO);
                for _ in 0..filter.lengths().periods() {
                    run += filter.step(Rate::ZERO);
                }
                assert_eq!(run, lead);
                assert!(filter.at_rest() && filter.lead() == Distance::ZERO && filter.balance.remainder == 0);
            }
        }
    }

    proptest! {
        /// For targets of one sign: the rate stays between the minimum and the maximum in the memory; the commanded
        /// distance equals the distance moved plus the lead; the lead never has the other sign; at rest everything is
        /// zero again.
        #[test]
        fn never_overshoots_and_loses_nothing(
            (a, b) in lengths(), backward in any::<bool>(), steady in 0..ONE,
            targets in prop::collection::vec(prop_oneof![0..=ONE, Just(0), Just(ONE), Just(8 * ONE)], 1..200),
        ) {
            let sign = if backward { -1 } else { 1 };
            let mut filter = filter(a, b);
            filter.set_steady(Rate::from_units(sign * steady));
            let (mut commanded, mut run) = (filter.lead(), Distance::ZERO);
            let n = filter.lengths().periods() as usize;
            for k in 0..targets.len() {
                let target = Rate::from_units(sign * targets[k]);
                let moved = filter.step(target);
                commanded += target.over(1);
                run += moved;
                prop_assert_eq!(filter.lead(), commanded - run);
                prop_assert!(sign * filter.lead().units() >= 0);
                let seen = &targets[(k + 1).saturating_sub(n)..=k];
                let start = if k + 1 < n { Some(steady) } else { None };
                let low = seen.iter().copied().chain(start).min().expect("not empty");
                let high = seen.iter().copied().chain(start).max().expect("not empty");
                prop_assert!((low - 1..=high + 1).contains(&(sign * moved.units())), "{low} {moved:?} {high}");
            }
            for _ in 0..n { run += filter.step(Rate::ZERO); }
            prop_assert_eq!(run, commanded);
            prop_assert!(filter.at_rest() && filter.lead() == Distance::ZERO && filter.balance.remainder == 0);
        }

        /// The rate changes by at most 1/max(n₁, n₂) of a full step per period, and that change by at most 2/(n₁·n₂).
        #[test]
        fn the_lengths_bound_the_change_of_the_rate(
            (a, b) in lengths(), targets in prop::collection::vec(0..=ONE, 1..200),
        ) {
            let mut filter = filter(a, b);
            let (mut rate, mut change) = (0, 0);
            for target in targets {
                let now = filter.step(Rate::from_units(target)).units();
                let changed = now - rate;
                prop_assert!(changed.abs() <= ONE / i64::from(a.max(b)) + 1);
                prop_assert!((changed - change).abs() <= 2 * ONE / (i64::from(a) * i64::from(b)) + 2);
                (rate, change) = (now, changed);
            }
        }
    }
}
