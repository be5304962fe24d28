//! Blends the commanded rate into rate one so that the commanded place then moves from record boundary to record
//! boundary.
//!
//! At rate ±1 motion must be the recorded motion to the pulse, not a mean of two records. The place at which the
//! commanded rate becomes one must therefore be a boundary: the sum of the deficits of the rate (one less the rate)
//! must equal the distance to a boundary. This is braking to a place, with the deficit in the role of the rate.
//!
//! Invariant: the deficit changes by at most one slope per period; a deficit of zero on a boundary stays zero.

use crate::{ONE, Travel};

/// Returns the largest deficit that is blended: braking it takes one record.
pub(super) fn max_deficit(slope: Travel) -> Travel {
    if slope >= ONE / 2 { ONE } else { (2 * slope as u64 * ONE as u64).isqrt() as Travel }
}

/// Returns the next deficit after `deficit`, both 0 … [`max_deficit`], with the commanded place `passed` beyond a
/// boundary, 0 … 1.
pub(super) fn next_deficit(deficit: Travel, passed: Travel, slope: Travel) -> Travel {
    let least = (deficit - slope).max(0);
    // the nearest boundary that can be reached from here
    let missing = least + ramp_distance(least, slope) - passed;
    let distance = passed + if missing > 0 { (missing + ONE - 1) / ONE * ONE } else { 0 };
    max_deficit_within(distance, slope).clamp(least, (deficit + slope).min(max_deficit(slope)))
}

/// Returns the sum of a deficit that falls by `slope` per period, after the period at it.
fn ramp_distance(deficit: Travel, slope: Travel) -> Travel {
    let steps = deficit / slope;
    steps * deficit - triangle(steps, slope)
}

/// Returns the largest deficit whose sum, itself included, is at most `distance`.
fn max_deficit_within(distance: Travel, slope: Travel) -> Travel {
    let root = (8 * distance / slope + 1).isqrt();
    let steps = (root - 1) / 2;
    (distance + triangle(steps, slope)) / (steps + 1)
}

/// Returns `slope` times 1 + 2 + … + `n`.
fn triangle(n: Travel, slope: Travel) -> Travel {
    n * (n + 1) / 2 * slope
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// From any state the commanded place reaches a boundary exactly when the deficit becomes zero, within the time
        /// of three such ramps.
        #[test]
        fn a_boundary_is_hit(share in 0..=ONE, passed in 0..ONE, slope in prop_oneof![1i64 << 16..ONE / 8, Just(ONE), Just(ONE / 3)]) {
            let from = max_deficit(slope);
            let (mut deficit, mut passed) = (((i128::from(from) * i128::from(share)) >> 32) as Travel, passed);
            let mut periods = 0;
            while (deficit, passed) != (0, 0) {
                let now = next_deficit(deficit, passed, slope);
                prop_assert!((now - deficit).abs() <= slope && (0..=from).contains(&now), "{deficit} {now} of {slope}");
                deficit = now;
                passed = (passed - now).rem_euclid(ONE);
                periods += 1;
                prop_assert!(periods <= 3 * (from / slope) + 6, "{deficit} {passed} at {slope}");
            }
            prop_assert_eq!(next_deficit(0, 0, slope), 0);
        }
    }
}
