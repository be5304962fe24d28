//! Positions and increments in whole pulses.
//!
//! Invariant: rounding is half away from zero, so that a path and its mirror image have mirrored pulses.

use crate::rapid_cap::larger;

/// Positions in whole pulses, rounded half away from zero.
#[inline]
pub(crate) fn counts_of<const A: usize>(position_mm: &[f64; A], pulses_per_mm: &[f64; A]) -> [f64; A] {
    std::array::from_fn(|i| {
        let pulses = position_mm[i] * pulses_per_mm[i];
        let size = pulses.abs();
        // To the nearest whole number, and half to the even one, as sums beyond 2⁵² are; then half up. Quicker than
        // `round`, and equal to it up to 2⁵² pulses.
        let even = size + WHOLE - WHOLE;
        let up = if size - even == 0.5 { 1.0 } else { 0.0 };
        (even + up).copysign(pulses)
    })
}

/// From here on every f64 is a whole number.
const WHOLE: f64 = (1u64 << 52) as f64;

/// A whole number of pulses, clamped to the range of an increment.
#[inline]
pub(crate) fn increment_of(pulses: f64) -> (f64, i16) {
    let (least, most) = (f64::from(i16::MIN), f64::from(i16::MAX));
    let held = if pulses < most { larger(pulses, least) } else { most };
    // The last digits of the sum are the number itself, in two's complement.
    (held, (held + 1.5 * WHOLE).to_bits() as i16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn counts_are_rounded_half_away_from_zero(x in -1e7..1e7f64, halves in -100_000i64..100_000) {
            prop_assert_eq!(counts_of(&[x], &[1000.0])[0], (x * 1000.0).round());
            let half = halves as f64 + 0.5;
            for x in [half, half.next_up(), half.next_down()] {
                prop_assert_eq!(counts_of(&[x], &[1.0])[0], x.round());
            }
            for x in [(0.99 * WHOLE).copysign(x), x * 1e-9, 0.0] {
                prop_assert_eq!(counts_of(&[x], &[1.0])[0], x.round());
            }
        }

        #[test]
        fn increments_are_whole_and_held(pulses in -40_000i64..40_000) {
            let held = pulses.clamp(i16::MIN.into(), i16::MAX.into());
            prop_assert_eq!(increment_of(pulses as f64), (held as f64, held as i16));
        }
    }
}
