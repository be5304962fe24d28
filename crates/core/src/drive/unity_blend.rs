//! Easing into rate one so that the commanded place then goes from record boundary to record boundary.
//!
//! At rate ±1 motion is to be the recorded motion to the pulse, and no mean of two records. So the place at which the commanded rate
//! becomes one has to be a boundary: what the rate lacks of one, summed up, has to come to a boundary's distance. That is braking to a
//! place once more, with the lacking rate in the place of the rate.
//!
//! Invariant: the lacking rate changes by at most one slope a period, and with nothing to lack for it stays zero.

use crate::{ONE, Travel};

/// The lack up to which it is eased: braking it from there takes one record.
pub(super) fn eased_from(slope: Travel) -> Travel {
    if slope >= ONE / 2 { ONE } else { (2 * slope as u64 * ONE as u64).isqrt() as Travel }
}

/// The next lack after `lack`, both 0 … [`eased_from`], with the commanded place `passed` beyond a boundary, 0 … 1.
pub(super) fn next(lack: Travel, passed: Travel, slope: Travel) -> Travel {
    let least = (lack - slope).max(0);
    // the nearest boundary that can be hit from here
    let short = least + ramp(least, slope) - passed;
    let way = passed + if short > 0 { (short + ONE - 1) / ONE * ONE } else { 0 };
    longest(way, slope).clamp(least, (lack + slope).min(eased_from(slope)))
}

/// What a lack comes to while it falls by `slope` a period, after the period at it.
fn ramp(lack: Travel, slope: Travel) -> Travel {
    let whole = lack / slope;
    whole * lack - triangle(whole, slope)
}

/// The largest lack that comes to `way` at most, itself included.
fn longest(way: Travel, slope: Travel) -> Travel {
    let steps = (8 * way / slope + 1).isqrt();
    let whole = (steps - 1) / 2;
    (way + triangle(whole, slope)) / (whole + 1)
}

/// `slope` times 1 + 2 + … + `n`.
fn triangle(n: Travel, slope: Travel) -> Travel {
    n * (n + 1) / 2 * slope
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// From any state the commanded place comes to a boundary just as nothing is lacking, within the time of three such ramps.
        #[test]
        fn a_boundary_is_hit(share in 0..=ONE, passed in 0..ONE, slope in prop_oneof![1i64 << 16..ONE / 8, Just(ONE), Just(ONE / 3)]) {
            let from = eased_from(slope);
            let (mut lack, mut passed) = (((i128::from(from) * i128::from(share)) >> 32) as Travel, passed);
            let mut periods = 0;
            while (lack, passed) != (0, 0) {
                let now = next(lack, passed, slope);
                prop_assert!((now - lack).abs() <= slope && (0..=from).contains(&now), "{lack} {now} of {slope}");
                lack = now;
                passed = (passed - now).rem_euclid(ONE);
                periods += 1;
                prop_assert!(periods <= 3 * (from / slope) + 6, "{lack} {passed} at {slope}");
            }
            prop_assert_eq!(next(0, 0, slope), 0);
        }
    }
}
