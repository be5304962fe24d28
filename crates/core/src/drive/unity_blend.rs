//! Blends the commanded rate into rate one so that the commanded place then moves from record boundary to record
//! boundary.
//!
//! At rate ±1 motion must be the recorded motion to the pulse, not a mean of two records. The place at which the
//! commanded rate becomes one must therefore be a boundary: the sum of the deficits of the rate (one less the rate)
//! must equal the distance to a boundary. This is braking to a place, with the deficit in the role of the rate.
//!
//! Invariant: the deficit changes by at most one slope per period; a deficit of zero on a boundary stays zero.

use crate::{Distance, Rate};

/// Returns the largest deficit that is blended: braking it takes one record.
pub(super) fn max_deficit(slope: Rate) -> Rate {
    if slope >= Rate::ONE / 2 {
        Rate::ONE
    } else {
        Rate::from_units((2 * slope.units() as u64 * Rate::ONE.units() as u64).isqrt() as i64)
    }
}

/// Returns the next deficit after `deficit`, both 0 … [`max_deficit`], with the commanded place `passed` beyond a
/// boundary, 0 … 1.
pub(super) fn next_deficit(deficit: Rate, passed: Distance, slope: Rate) -> Rate {
    let least = (deficit - slope).max(Rate::ZERO);
    // the nearest boundary that can be reached from here
    let missing = (least.over(1) + ramp_distance(least, slope) - passed).units();
    let records = if missing > 0 { (missing + Distance::RECORD.units() - 1) / Distance::RECORD.units() } else { 0 };
    max_deficit_within(passed + Distance::records(records), slope)
        .clamp(least, (deficit + slope).min(max_deficit(slope)))
}

/// Returns the sum of a deficit that falls by `slope` per period, after the period at it.
fn ramp_distance(deficit: Rate, slope: Rate) -> Distance {
    let steps = deficit.units() / slope.units();
    deficit.over(steps) - triangle(steps, slope)
}

/// Returns the largest deficit whose sum, itself included, is at most `distance`.
fn max_deficit_within(distance: Distance, slope: Rate) -> Rate {
    let root = (8 * distance.units() / slope.units() + 1).isqrt();
    let steps = (root - 1) / 2;
    ((distance + triangle(steps, slope)) / (steps + 1)).per_period()
}

/// Returns the distance at `slope` times 1 + 2 + … + `n`.
fn triangle(n: i64, slope: Rate) -> Distance {
    slope.over(n * (n + 1) / 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rate one, and a record, in the units of the tests.
    const ONE: i64 = Rate::ONE.units();
    use proptest::prelude::*;

    proptest! {
        /// From any state the commanded place reaches a boundary exactly when the deficit becomes zero, within the time
        /// of three such ramps.
        #[test]
        fn a_boundary_is_hit(share in 0..=ONE, passed in 0..ONE,
            slope in prop_oneof![1i64 << 16..ONE / 8, Just(ONE), Just(ONE / 3)]) {
            let from = max_deficit(Rate::from_units(slope)).units();
            let next = |deficit: i64, passed: i64| {
                let (deficit, passed) = (Rate::from_units(deficit), Distance::from_units(passed));
                next_deficit(deficit, passed, Rate::from_units(slope)).units()
            };
            let (mut deficit, mut passed) = (((i128::from(from) * i128::from(share)) >> 32) as i64, passed);
            let mut periods = 0;
            while (deficit, passed) != (0, 0) {
                let now = next(deficit, passed);
                prop_assert!((now - deficit).abs() <= slope && (0..=from).contains(&now), "{deficit} {now} of {slope}");
                deficit = now;
                passed = (passed - now).rem_euclid(ONE);
                periods += 1;
                prop_assert!(periods <= 3 * (from / slope) + 6, "{deficit} {passed} at {slope}");
            }
            prop_assert_eq!(next(0, 0), 0);
        }
    }
}
