//! Braking to a place: slopes of the commanded rate that are legal anywhere on the machine, and how far they brake (REV, *Braking to a
//! place*).
//!
//! Invariant: the slopes fall as the rate rises, and `S(u) ≥ u⁻ + S(u⁻)` with u⁻ = u less the slope at u, for every rate u up to one. So a
//! commanded place that may go on by u and then brake may also do so after going on by u⁻, and comes to rest exactly where it must.

use super::slope::{highest_acceleration, highest_jerk, ratio, scaled};
use crate::limits::{PulseLimits, RateLimits};
use crate::{ONE, Travel};

/// Stretches of the rate over which the slope is taken as constant, where nothing else is said.
const STRETCHES: usize = 32;
/// The least slope that is taken: a stop from rate one within some 65 536 periods.
const LEAST: Travel = 1 << 16;
/// Braking length gained by rate is counted in sixteenths of a period.
const SIXTEENTHS: Travel = 16;

/// How a machine brakes wherever it is, whatever the records ask: from its limits alone. Slopes are constant over `N` stretches of the rate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Braking<const N: usize = STRETCHES> {
    /// How much the commanded rate may change a period, at rates within each stretch; at most a stretch, unless it is anything.
    slopes: [Travel; N],
    /// How much longer the ramp gets with the rate, in sixteenths of a period.
    rises: [u32; N],
    /// Length S of the ramp at the lower end of each stretch; that of the lowest is below zero, and counts as zero.
    lengths: [Travel; N],
    periods: Travel,
}

impl<const N: usize> Braking<N> {
    /// Length of a stretch.
    const STRETCH: Travel = ONE / N as Travel;

    /// Of a machine as stiff as any: the rate may jump.
    #[must_use]
    pub const fn stiff() -> Self {
        Self { slopes: [ONE; N], rises: [0; N], lengths: [0; N], periods: 1 }
    }

    /// From the machine's limits. `None` where it brakes too slowly to be told in these units.
    #[must_use]
    pub fn new<const A: usize>(limits: &RateLimits<A>) -> Option<Self> {
        let slope = |rate: Travel| limits.axes().iter().map(|axis| least(limits, axis, rate)).min().unwrap_or(ONE);
        let mut braking = Self::stiff();
        if slope(ONE) >= ONE {
            return Some(braking);
        }
        for (k, slot) in braking.slopes.iter_mut().enumerate() {
            let slope = slope((k as Travel + 1) * Self::STRETCH).min(Self::STRETCH);
            if slope < LEAST {
                return None;
            }
            *slot = slope;
        }
        braking.measure();
        Some(braking)
    }

    /// Sets all else by the slopes. The rise is that of the upper end of a stretch at the slope of the stretch above, so that
    /// a step down over the boundary is covered too.
    fn measure(&mut self) {
        let mut length = 0;
        for k in 0..N {
            let (end, slope) = ((k as Travel + 1) * Self::STRETCH, self.slopes[(k + 1).min(N - 1)]);
            self.rises[k] = (SIXTEENTHS * end + slope - 1).div_euclid(slope) as u32;
            let rise = Travel::from(self.rises[k]);
            if k == 0 {
                // Up to one slope the ramp has no length: a single period ends it. From just above the stretch the slope is that of
                // the next one, which is less: what it leaves is to be covered too.
                length = -(self.slopes[1.min(N - 1)] * rise).div_euclid(SIXTEENTHS);
            }
            self.lengths[k] = length;
            length += Self::STRETCH * rise / SIXTEENTHS;
        }
        let (mut rate, mut periods) = (ONE, 0);
        while rate > 0 {
            rate -= self.slope(rate, 16);
            periods += 1;
        }
        self.periods = periods;
    }

    /// By how much the commanded rate may fall a period at `rate` (≥ 0) wherever no record has a cap below `cap` sixteenths (≥ 16).
    #[must_use]
    pub fn slope(&self, rate: Travel, cap: u8) -> Travel {
        self.slope_of_stretch(Self::stretch(rate * 16 / Travel::from(cap.max(16))), cap)
    }

    /// By how much it may rise: the rate that it rises to counts.
    #[must_use]
    pub fn rising_slope(&self, rate: Travel, cap: u8) -> Travel {
        self.slope_of_stretch(Self::stretch(rate * 16 / Travel::from(cap.max(16)) + Self::STRETCH), cap)
    }

    /// The least slope at any rate up to one.
    #[must_use]
    pub fn min_slope(&self) -> Travel {
        self.slope_of_stretch(N - 1, 16)
    }

    /// Length of the ramp from `rate`, 0 … 1, to rest, after the period at that rate, in records.
    #[must_use]
    pub fn length(&self, rate: Travel) -> Travel {
        if rate <= self.slopes[0] {
            return 0;
        }
        let k = Self::stretch(rate);
        self.lengths[k] + (rate - k as Travel * Self::STRETCH) * Travel::from(self.rises[k]) / SIXTEENTHS + 1
    }

    /// The largest rate up to `rate` that may be commanded where `free` is left to the end of the road.
    #[must_use]
    pub fn within(&self, rate: Travel, free: Travel) -> Travel {
        if free <= rate.min(ONE) {
            // the ramp comes on top
        } else if rate > ONE {
            if free >= ONE + self.length(ONE) {
                return rate;
            }
        } else if free >= rate + self.length(rate) {
            return rate;
        }
        self.largest(free).min(rate)
    }

    /// The largest rate u up to one with `u + S(u) ≤ free`.
    fn largest(&self, free: Travel) -> Travel {
        if free <= self.slopes[0] {
            return free.clamp(0, ONE);
        }
        let mut k = N;
        while k > 0 {
            k -= 1;
            let over = free - 1 - self.lengths[k] - k as Travel * Self::STRETCH;
            if over >= 0 {
                let more = over.min(1 << 56) * SIXTEENTHS / (SIXTEENTHS + Travel::from(self.rises[k]));
                // A single period ends what is no more than a slope.
                return (k as Travel * Self::STRETCH + more.min(Self::STRETCH)).clamp(self.slopes[0], free);
            }
        }
        0
    }

    /// Periods in which the slopes bring the rate down from one to rest, or from a cap where no record has a lower one.
    #[must_use]
    pub const fn periods(&self) -> Travel {
        self.periods
    }

    fn stretch(rate: Travel) -> usize {
        // the upper end belongs to a stretch
        ((rate - 1).max(0) / Self::STRETCH).min(N as Travel - 1) as usize
    }

    fn slope_of_stretch(&self, k: usize, cap: u8) -> Travel {
        // the ramp from rate one, in proportion
        self.slopes[k] * Travel::from(cap.max(16)) / 16
    }
}

/// The slope that one axis has at a rate up to one whatever the records ask, as long as they are within what the plan may use.
fn least<const A: usize>(limits: &RateLimits<A>, axis: &PulseLimits, rate: Travel) -> Travel {
    let (second, third) = (highest_acceleration(limits, axis), highest_jerk(limits, axis));
    let by_acceleration = ratio(axis.acceleration.saturating_sub(scaled(second, rate, 2)), axis.velocity);
    let bend = 3 * second + 2 * axis.velocity / u64::from(limits.average()) + 1;
    by_acceleration.min(ratio((2 * axis.jerk).saturating_sub(third), bend))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STRETCH: Travel = Braking::<STRETCHES>::STRETCH;

    fn braking() -> impl Strategy<Value = Braking> {
        let figures = (8u32..40, 0u32..12, 0u32..8, 1u16..=u16::MAX);
        figures.prop_filter_map("too slow", |(velocity, acceleration, jerk, share)| {
            let velocity = 1 << velocity;
            let acceleration = (velocity >> acceleration).max(1 << 8);
            let axis = PulseLimits { velocity, acceleration, jerk: (acceleration >> jerk).max(1 << 8) };
            Braking::<STRETCHES>::new(&RateLimits::new(255, share, [axis])?)
        })
    }

    proptest! {
        /// S(u) ≥ u⁻ + S(u⁻), but for the last bits.
        #[test]
        fn the_length_covers_a_step_down(braking in braking(), rate in prop_oneof![0..=ONE, 0..=STRETCH], k in 0..=32i64) {
            for rate in [rate, k * STRETCH, k * STRETCH + (rate & 0xFFFF)] {
                let rate = rate.min(ONE);
                let less = (rate - braking.slope(rate, 16)).max(0);
                prop_assert!(braking.length(rate) + 2 >= less + braking.length(less), "{rate} {less}");
                let found = braking.largest(rate + braking.length(rate));
                prop_assert!((rate - 3..=rate + 1).contains(&found), "{found} for {rate}");
            }
        }

        /// From rate one the commanded rate falls within the slopes, and the end is hit exactly, in no more periods than said.
        #[test]
        fn an_end_is_hit_exactly(braking in braking(), more in 0..ONE) {
            let (mut rate, mut free, mut periods) = (ONE, ONE + braking.length(ONE) + more, 0);
            while free > 0 {
                let now = braking.within(ONE, free).min(rate + 1);
                prop_assert!(now > 0 && now >= rate - braking.slope(rate, 16) - 3, "{rate} {now} {free}");
                (rate, free, periods) = (now, free - now, periods + 1);
            }
            prop_assert_eq!(free, 0);
            prop_assert!(periods <= 2 * braking.periods() + 60, "{} {}", periods, braking.periods());
        }

        /// The slopes alone bring the rate down from any cap, in proportion.
        #[test]
        fn every_cap_is_braked_from_in_the_same_time(braking in braking(), cap in 16u8..=128) {
            let (mut rate, mut way, mut periods) = (Travel::from(cap) << 28, 0, 0);
            while rate > 0 {
                rate = (rate - braking.slope(rate, cap)).max(0);
                (way, periods) = (way + rate, periods + 1);
            }
            prop_assert!(periods <= braking.periods() + 1);
            prop_assert!(way / 16 <= (braking.length(ONE) >> 8) * Travel::from(cap) + 16 * ONE);
        }
    }
}
