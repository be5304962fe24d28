//! Slopes: how fast the commanded rate may change over records with given bounds of their increments (REV, *Rate law*).
//!
//! Invariant: with slopes from here, `|q″|r² + |q′||r′| ≤ A` and `|q‴||r|³ + 3|q″||r·r′| + |q′||r″| ≤ 2J` hold on every
//! axis, for any sequence of targets. The cursor's r and r′ are means over n periods of the commanded u and u′:
//!
//! - `(A − |q″|u²)/|q′|` is concave in u, so the mean of slopes is at most its value at the mean rate.
//! - r″ = (u′ now − u′ n periods ago)/n, so |r″| ≤ 2f/n for slopes up to f.
//! - The jerk's bound falls as r rises. A falling slope is taken at the highest rate still in the average: where the
//!   rate falls at r, each of the slopes by which it falls was taken at no less than r. A rising slope is taken at the
//!   highest rate that any record ahead allows.

use super::bounds::{AxisBounds, IncrementBounds};
use crate::Rate;
use crate::limits::{PulseLimits, RateLimits};

/// Returns the largest fall of the commanded rate per period from `rate` on; `highest` is the highest rate in the
/// average.
pub(super) fn max_fall<const A: usize>(
    limits: &RateLimits<A>,
    bounds: &IncrementBounds<A>,
    rate: Rate,
    highest: Rate,
) -> Rate {
    min_over_axes(limits, bounds, |axis, required| {
        by_acceleration(axis, required, rate).min(by_jerk(limits, axis, required, highest))
    })
}

/// Returns the largest rise of the commanded rate per period from `rate` on.
pub(super) fn max_rise<const A: usize>(limits: &RateLimits<A>, bounds: &IncrementBounds<A>, rate: Rate) -> Rate {
    let highest = Rate::ONE / 16 * i64::from(bounds.max_cap);
    min_over_axes(limits, bounds, |axis, required| {
        // Jensen's inequality requires the slope at the rate that is reached
        let at_most = by_acceleration(axis, required, rate);
        by_acceleration(axis, required, rate + at_most).min(by_jerk(limits, axis, required, highest))
    })
}

fn min_over_axes<const A: usize>(
    limits: &RateLimits<A>,
    bounds: &IncrementBounds<A>,
    slope: impl Fn(&PulseLimits, &AxisBounds) -> Rate,
) -> Rate {
    limits.axes().iter().zip(&bounds.axes).map(|(axis, required)| slope(axis, required)).min().unwrap_or(Rate::ONE)
}

fn by_acceleration(axis: &PulseLimits, required: &AxisBounds, rate: Rate) -> Rate {
    ratio(axis.acceleration.saturating_sub(scaled(required.acceleration, rate, 2)), required.velocity)
}

fn by_jerk<const A: usize>(limits: &RateLimits<A>, axis: &PulseLimits, required: &AxisBounds, highest: Rate) -> Rate {
    let remaining = (2 * axis.jerk).saturating_sub(scaled(required.jerk, highest, 3));
    let bend = 2 * required.velocity / u64::from(limits.average()) + 1;
    ratio(remaining, scaled(required.acceleration, highest, 1).saturating_mul(3).saturating_add(bend))
}

/// Returns `figure` times `rate` to the `power`, rounded up; the rate is rounded up to 1 024ths. A product that does
/// not fit becomes `u64::MAX`, which is more than any limit.
pub(super) fn scaled(figure: u64, rate: Rate, power: u8) -> u64 {
    let rate = ((rate.units() + (1 << 22) - 1) >> 22).max(0) as u64;
    let times = |product: u64, _| product.checked_mul(rate).map(|product| product.div_ceil(1 << 10));
    (0..power).try_fold(figure, times).unwrap_or(u64::MAX)
}

/// Returns `numerator / denominator` as a rate, rounded down, at most one.
pub(super) fn ratio(numerator: u64, denominator: u64) -> Rate {
    if numerator >= denominator {
        return Rate::ONE;
    }
    // Of a denominator with more than 32 bits, only the upper 32 count.
    let shift = numerator.leading_zeros().min(32);
    let divisor = if shift == 32 { denominator } else { (denominator >> (32 - shift)) + 1 };
    Rate::from_units(((numerator << shift) / divisor) as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rate one in the units of the tests.
    const ONE: i64 = Rate::ONE.units();
    use proptest::prelude::*;

    /// Draws an axis, and records whose uniform bounds are within what the plan may use.
    fn scene() -> impl Strategy<Value = (RateLimits<1>, AxisBounds)> {
        let figures = (20u32..40, 0u32..8, 1u64..80, 20_000u16..62_000, [0.02..1.0f64, 0.0..1.0f64, 0.0..1.0f64]);
        figures.prop_filter_map("too fast for a length of 100", |(bits, acceleration, n, share, shares)| {
            let velocity = 1 << bits;
            let acceleration = (velocity >> acceleration).max(1 << 10);
            let axis = PulseLimits { velocity, acceleration, jerk: (acceleration / n).max(1 << 9) };
            let average = axis.acceleration.div_ceil(axis.jerk).min(99) as u16 | 1;
            let limits = RateLimits::new(average, share, [axis])?;
            let part = |figure: u64, share: f64| (figure as f64 * share) as u64;
            let required = AxisBounds {
                velocity: part(axis.velocity, shares[0]).max(1),
                acceleration: part(limits.plan_acceleration(&axis), shares[1]),
                jerk: part(limits.plan_jerk(&axis), shares[2]),
            };
            Some((limits, required))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Acceleration and jerk of what is played stay within the limits for any sequence of targets over records with
        /// uniform bounds.
        #[test]
        fn what_is_played_keeps_acceleration_and_jerk(
            (limits, required) in scene(), requested in prop::collection::vec((prop_oneof![Just(0), Just(ONE),
                0..=ONE], 1usize..150), 1..12),
        ) {
            let bounds = IncrementBounds { axes: [required], min_cap: 16, max_cap: 16 };
            let (n, axis) = (usize::from(limits.average()), limits.axes()[0]);
            let (mut commanded, mut played) = (vec![Rate::ZERO; n], vec![0.0; 3]);
            for (requested, periods) in requested {
                let requested = Rate::from_units(requested);
                for _ in 0..periods {
                    let memory = &commanded[commanded.len() - n..];
                    let (rate, highest) = (memory[n - 1], *memory.iter().max().expect("some"));
                    commanded.push(if requested < rate {
                        (rate - max_fall(&limits, &bounds, rate, highest)).max(requested)
                    } else {
                        (rate + max_rise(&limits, &bounds, rate)).min(requested)
                    });
                    let sum: i64 = commanded[commanded.len() - n..].iter().map(|rate| rate.units()).sum();
                    played.push(sum as f64 / n as f64 / ONE as f64);
                }
            }
            let [velocity, acceleration, jerk] = [required.velocity, required.acceleration,
                required.jerk].map(|x| x as f64);
            for r in played.windows(3) {
                let (rate, change, bend) = ((r[0] + r[1] + r[2]) / 3.0, (r[2] - r[1]).abs().max((r[1] - r[0]).abs()),
                    r[2] - 2.0 * r[1] + r[0]);
                let faster = r[1].max(r[2]);
                let accelerated = acceleration * faster * faster + velocity * (r[2] - r[1]).abs();
                prop_assert!(accelerated <= 1.001 * axis.acceleration as f64, "{accelerated} of {axis:?}");
                let jerked = jerk * rate.powi(3) + 3.0 * acceleration * rate * change + velocity * bend.abs();
                prop_assert!(jerked <= 2.002 * axis.jerk as f64, "{jerked} of {axis:?}, {required:?}, {r:?}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Slopes are as steep as the two inequalities allow, and no steeper, for every rate up to eight: over records
        /// that may be retraced at `cap` sixteenths, for falls from `rate` with `highest` in the average, and for
        /// rises.
        #[test]
        fn a_slope_is_as_steep_as_its_inequalities_allow(
            (limits, required) in scene(), cap in 16u8..=128, rate in 0..=ONE, highest in 0..=ONE,
        ) {
            let axis = limits.axes()[0];
            let scale = f64::from(cap) / 16.0;
            let part = |figure: u64, power: i32| (figure as f64 / scale.powi(power)) as u64;
            let required = AxisBounds {
                velocity: part(required.velocity, 1),
                acceleration: part(required.acceleration, 2),
                jerk: part(required.jerk, 3),
            };
            let bounds = IncrementBounds { axes: [required], min_cap: 16, max_cap: cap };
            let at = |units: i64| Rate::from_units(units / 16 * i64::from(cap));
            let (rate, highest) = (at(rate), at(highest));
            let (top, n) = (at(ONE), f64::from(limits.average()));
            let figures = [required.velocity, required.acceleration, required.jerk];
            let [velocity, acceleration, jerk] = figures.map(|figure| figure as f64);
            let real = |rate: Rate| f64::from(rate);
            // the parts of the limits that a slope uses
            let used = |slope: Rate, from: Rate, highest: Rate| {
                let accelerated = acceleration * real(from).powi(2) + velocity * real(slope);
                let bend = 3.0 * acceleration * real(highest) + 2.0 * velocity / n;
                let jerked = jerk * real(highest).powi(3) + bend * real(slope);
                [accelerated / axis.acceleration as f64, jerked / (2 * axis.jerk) as f64]
            };
            let fall = max_fall(&limits, &bounds, rate, highest);
            let rise = max_rise(&limits, &bounds, rate);
            for (slope, used) in [(fall, used(fall, rate, highest)), (rise, used(rise, rate + rise, top))] {
                prop_assert!(slope == Rate::ZERO || used.iter().all(|&used| used <= 1.0 + 1e-9), "{used:?} {slope:?}");
            }
            // a rate is rounded up to 1 024ths, whose square and cube show where the rate is low
            let used = used(fall + Rate::from_units(1 << 8), rate + Rate::ONE / 1024, highest + Rate::ONE / 1024);
            let coarse = 64.0 / axis.jerk as f64;
            let is_used = used.iter().any(|&used| used >= 1.0 - 1e-6 - coarse);
            prop_assert!(fall == Rate::ONE || is_used, "{used:?} {fall:?}");
        }
    }

    proptest! {
        #[test]
        fn a_ratio_is_rounded_down_and_good_to_thirty_bits(numerator in 0u64..1 << 51, bits in 0u32..40,
            low in any::<u64>()) {
            let denominator = (low >> (63 - bits)).max(1);
            for (a, b) in [(numerator, denominator), (numerator >> bits, denominator)] {
                let exact = ((u128::from(a) << 32) / u128::from(b)).min(1 << 32) as i64;
                let found = ratio(a, b).units();
                prop_assert!(found <= exact && exact - found <= 1 + (exact >> 30), "{a}/{b}: {found} {exact}");
            }
        }

        #[test]
        fn a_scaled_figure_is_rounded_up(figure in 0u64..1 << 48, rate in 0..8 * ONE, power in 1u8..=3) {
            let exact = figure as f64 * (rate as f64 / ONE as f64).powi(i32::from(power));
            let found = scaled(figure, Rate::from_units(rate), power) as f64;
            prop_assert!(found >= exact * (1.0 - 1e-12), "{found} {exact}");
            // one step of the rate, and the rounding of each product
            let above = (rate as f64 / ONE as f64 + 1.0 / 1024.0).powi(i32::from(power)) * figure as f64 + 73.0;
            prop_assert!(found <= above || found >= u64::MAX as f64, "{found} {above}");
        }
    }
}
