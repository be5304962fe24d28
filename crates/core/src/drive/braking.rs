//! Braking to a place: slopes of the commanded rate that are legal anywhere on the machine, and their braking distances
//! (REV, *Braking to a place*).
//!
//! Invariant: the slopes fall as the rate rises, and `S(u) ≥ u⁻ + S(u⁻)` with u⁻ = u less the slope at u, for every
//! rate u up to one. So a commanded place that may advance by u and then brake may also do so after it has advanced by
//! u⁻, and comes to rest exactly where it must.

use super::slope::{ratio, scaled};
use crate::limits::{PulseLimits, RateLimits};
use crate::{Distance, Rate};

/// Default number of intervals of the rate over which the slope is taken as constant.
const INTERVALS: usize = 32;
/// Minimum slope that is accepted: a stop from rate one within about 65 536 periods.
const MIN_SLOPE: Rate = Rate::from_units(1 << 16);
/// Unit of the growth of the braking distance with the rate: sixteenths of a period.
const SIXTEENTHS: i64 = 16;

/// Braking of a machine anywhere on the path, for any records, from its limits alone. Slopes are constant over `N`
/// intervals of the rate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Braking<const N: usize = INTERVALS> {
    /// Change of the commanded rate per period, for rates within each interval; at most an interval, unless the braking
    /// is unconfigured.
    slopes: [Rate; N],
    /// Growth of the ramp's length with the rate, in sixteenths of a period.
    rises: [u32; N],
    /// Length S of the ramp at the lower end of each interval; that of the lowest is below zero, and counts as zero.
    lengths: [Distance; N],
    periods: u32,
}

impl<const N: usize> Braking<N> {
    /// Length of an interval of the rate.
    const INTERVAL: Rate = Rate::from_units(Rate::ONE.units() / N as i64);

    /// Returns the braking of a card that has received no settings yet: the rate may jump.
    #[must_use]
    pub const fn unconfigured() -> Self {
        Self { slopes: [Rate::ONE; N], rises: [0; N], lengths: [Distance::ZERO; N], periods: 1 }
    }

    /// Returns the braking for the machine's limits. Returns `None` if it brakes too slowly for these units.
    #[must_use]
    pub fn new<const A: usize>(limits: &RateLimits<A>) -> Option<Self> {
        let slope = |rate: Rate| {
            limits.axes().iter().map(|axis| universal_slope(limits, axis, rate)).min().unwrap_or(Rate::ONE)
        };
        let mut braking = Self::unconfigured();
        if slope(Rate::ONE) >= Rate::ONE {
            return Some(braking);
        }
        for (k, slot) in braking.slopes.iter_mut().enumerate() {
            let slope = slope(Self::INTERVAL * (k as i64 + 1)).min(Self::INTERVAL);
            if slope < MIN_SLOPE {
                return None;
            }
            *slot = slope;
        }
        braking.compute_lengths();
        Some(braking)
    }

    /// Computes all other fields from the slopes. The growth is that of the upper end of an interval at the slope of
    /// the interval above, so that a step down across the boundary is covered too.
    fn compute_lengths(&mut self) {
        let mut length = Distance::ZERO;
        for k in 0..N {
            let end = (Self::INTERVAL * (k as i64 + 1)).units();
            let slope = self.slopes[(k + 1).min(N - 1)].units();
            self.rises[k] = (SIXTEENTHS * end + slope - 1).div_euclid(slope) as u32;
            let rise = i64::from(self.rises[k]);
            if k == 0 {
                // Up to one slope the ramp has no length: a single period ends it. From just above the interval the
                // slope is that of the next one, which is smaller: the remainder must be covered too.
                let next = self.slopes[1.min(N - 1)].over(rise);
                length = -Distance::from_units(next.units().div_euclid(SIXTEENTHS));
            }
            self.lengths[k] = length;
            length += Self::INTERVAL.over(rise) / SIXTEENTHS;
        }
        let (mut rate, mut periods) = (Rate::ONE, 0);
        while rate > Rate::ZERO {
            rate -= self.slope(rate, 16);
            periods += 1;
        }
        self.periods = periods;
    }

    /// Returns the maximum fall of the commanded rate per period at `rate` (≥ 0) where no record has a cap below `cap`
    /// sixteenths (≥ 16).
    #[must_use]
    pub fn slope(&self, rate: Rate, cap: u8) -> Rate {
        self.interval_slope(Self::interval_of(rate * 16 / i64::from(cap.max(16))), cap)
    }

    /// Returns the maximum rise of the commanded rate per period at `rate`; it is taken at the rate that is reached.
    #[must_use]
    pub fn rising_slope(&self, rate: Rate, cap: u8) -> Rate {
        self.interval_slope(Self::interval_of(rate * 16 / i64::from(cap.max(16)) + Self::INTERVAL), cap)
    }

    /// Returns the smallest slope at any rate up to one.
    #[must_use]
    pub fn min_slope(&self) -> Rate {
        self.interval_slope(N - 1, 16)
    }

    /// Returns the length of the ramp from `rate`, 0 … 1, to rest, after the period at that rate.
    #[must_use]
    pub fn length(&self, rate: Rate) -> Distance {
        if rate <= self.slopes[0] {
            return Distance::ZERO;
        }
        let k = Self::interval_of(rate);
        let above = rate - Self::INTERVAL * k as i64;
        self.lengths[k] + above.over(i64::from(self.rises[k])) / SIXTEENTHS + Distance::from_units(1)
    }

    /// Returns the length of path in which the commanded place comes to rest at an end of the window, after the period
    /// at `rate`, 0 … [`Rate::MAX`].
    ///
    /// Up to one that is the ramp. A rate u above one first falls to one by the slopes of the cap u, as the ramp from
    /// one falls to 1/u, scaled. From there the ramp from one must remain, whatever the caps allow: the end of the
    /// window may hide records of any cap.
    #[must_use]
    pub fn stop_length(&self, rate: Rate) -> Distance {
        if rate <= Rate::ONE {
            return self.length(rate);
        }
        let ramp = self.length(Rate::ONE);
        // u in 1 024ths, rounded up
        let scale = (rate.units() >> 22) + 1;
        let one_by_rate = Rate::ONE * 1024 / scale;
        (ramp - self.length(one_by_rate)) * scale / 1024 + ramp
    }

    /// Returns the largest rate up to `rate` that may be commanded with a distance of `free` to the end of the window.
    #[must_use]
    pub fn max_rate_within(&self, rate: Rate, free: Distance) -> Rate {
        if free <= rate.min(Rate::ONE).over(1) {
            // no room for the ramp in addition
        } else if rate > Rate::ONE {
            if free >= Rate::ONE.over(1) + self.length(Rate::ONE) {
                return rate;
            }
        } else if free >= rate.over(1) + self.length(rate) {
            return rate;
        }
        self.max_braking_rate(free).min(rate)
    }

    /// Returns the largest rate u up to one with `u + S(u) ≤ free`.
    fn max_braking_rate(&self, free: Distance) -> Rate {
        let one_period = free.per_period();
        if one_period <= self.slopes[0] {
            return one_period.clamp(Rate::ZERO, Rate::ONE);
        }
        let mut k = N;
        while k > 0 {
            k -= 1;
            let start = Self::INTERVAL * k as i64;
            let over = free - Distance::from_units(1) - self.lengths[k] - start.over(1);
            if over >= Distance::ZERO {
                let over = over.units().min(1 << 56);
                let more = Rate::from_units(over * SIXTEENTHS / (SIXTEENTHS + i64::from(self.rises[k])));
                // A single period ends a rate of at most one slope.
                return (start + more.min(Self::INTERVAL)).clamp(self.slopes[0], one_period);
            }
        }
        Rate::ZERO
    }

    /// Returns the number of periods in which the slopes bring the rate down from one to rest, or from a cap where no
    /// record has a lower one.
    #[must_use]
    pub const fn periods(&self) -> u32 {
        self.periods
    }

    fn interval_of(rate: Rate) -> usize {
        // the upper end belongs to an interval
        ((rate.units() - 1).max(0) / Self::INTERVAL.units()).min(N as i64 - 1) as usize
    }

    fn interval_slope(&self, k: usize, cap: u8) -> Rate {
        // the ramp from rate one, scaled
        self.slopes[k] * i64::from(cap.max(16)) / 16
    }
}

/// Returns the slope of one axis at a rate up to one that holds for any records within what the plan may use.
fn universal_slope<const A: usize>(limits: &RateLimits<A>, axis: &PulseLimits, rate: Rate) -> Rate {
    let (second, third) = (limits.plan_acceleration(axis), limits.plan_jerk(axis));
    let by_acceleration = ratio(axis.acceleration.saturating_sub(scaled(second, rate, 2)), axis.velocity);
    let bend = 3 * second + 2 * axis.velocity / u64::from(limits.average()) + 1;
    by_acceleration.min(ratio((2 * axis.jerk).saturating_sub(third), bend))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RapidCap;
    use proptest::prelude::*;

    /// Rate one, and the length of an interval, in the units of the tests.
    const ONE: i64 = Rate::ONE.units();
    const STRETCH: i64 = Braking::<INTERVALS>::INTERVAL.units();

    fn braking() -> impl Strategy<Value = Braking> {
        let figures = (8u32..40, 0u32..12, 0u32..8, 1u16..=u16::MAX);
        figures.prop_filter_map("too slow", |(velocity, acceleration, jerk, share)| {
            let velocity = 1 << velocity;
            let acceleration = (velocity >> acceleration).max(1 << 8);
            let axis = PulseLimits { velocity, acceleration, jerk: (acceleration >> jerk).max(1 << 8) };
            Braking::<INTERVALS>::new(&RateLimits::new(255, share, [axis])?)
        })
    }

    /// A machine that could stop faster brakes by a whole interval per period: 32 equal steps, and the ramp is what
    /// they run, each counted at the rate that it begins with, except the last one, which a single period ends.
    #[test]
    fn a_stiff_machine_brakes_in_equal_steps() {
        let stiff = PulseLimits { velocity: 100 << 32, acceleration: 40 << 32, jerk: 20 << 32 };
        let limits = RateLimits::new(3, 1 << 14, [stiff]).expect("valid");
        let braking = Braking::<INTERVALS>::new(&limits).expect("fast enough");
        assert_eq!(braking.slopes, [Rate::ONE / 32; INTERVALS]);
        assert_eq!(braking.periods(), 32);
        for k in 2..=32 {
            let steps: i64 = (2..=k).sum();
            let rate = Rate::ONE / 32 * k;
            assert_eq!(braking.length(rate), Distance::RECORD * steps / 32 + Distance::from_units(1), "{k}");
        }
    }

    proptest! {
        /// S(u) ≥ u⁻ + S(u⁻), except for the last bits.
        #[test]
        fn the_length_covers_a_step_down(braking in braking(), rate in prop_oneof![0..=ONE, 0..=STRETCH],
            k in 0..=32i64) {
            for rate in [rate, k * STRETCH, k * STRETCH + (rate & 0xFFFF)] {
                let rate = Rate::from_units(rate.min(ONE));
                let less = (rate - braking.slope(rate, 16)).max(Rate::ZERO);
                let last_bits = Distance::from_units(2);
                prop_assert!(braking.length(rate) + last_bits >= less.over(1) + braking.length(less), "{rate:?} \
                    {less:?}");
                let found = braking.max_braking_rate(rate.over(1) + braking.length(rate)).units() - rate.units();
                prop_assert!((-3..=1).contains(&found), "{found} off {rate:?}");
            }
        }

        /// From rate one the commanded rate falls within the slopes, and the end is hit exactly, within the stated
        /// number of periods.
        #[test]
        fn an_end_is_hit_exactly(braking in braking(), more in 0..ONE) {
            let (mut rate, mut periods) = (Rate::ONE, 0);
            let mut free = Distance::RECORD + braking.length(rate) + Distance::from_units(more);
            while free > Distance::ZERO {
                let now = braking.max_rate_within(Rate::ONE, free).min(rate + Rate::from_units(1));
                let least = rate - braking.slope(rate, 16) - Rate::from_units(3);
                prop_assert!(now > Rate::ZERO && now >= least, "{rate:?} {now:?} {free:?}");
                (rate, free, periods) = (now, free - now.over(1), periods + 1);
            }
            prop_assert_eq!(free, Distance::ZERO);
            prop_assert!(periods <= 2 * braking.periods() + 60, "{} {}", periods, braking.periods());
        }

        /// The slopes alone bring the rate down from any cap in the same time, scaled.
        #[test]
        fn every_cap_is_braked_from_in_the_same_time(braking in braking(), cap in 16u8..=128) {
            let (mut rate, mut distance, mut periods) = (RapidCap::sixteenths(cap).rate(), Distance::ZERO, 0);
            while rate > Rate::ZERO {
                rate = (rate - braking.slope(rate, cap)).max(Rate::ZERO);
                (distance, periods) = (distance + rate.over(1), periods + 1);
            }
            prop_assert!(periods <= braking.periods() + 1);
            let scaled = braking.length(Rate::ONE) / 256 * i64::from(cap);
            prop_assert!(distance / 16 <= scaled + Distance::records(16));
        }
    }
}
