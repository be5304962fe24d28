//! Degrees and radians with the precision of 80-bit arithmetic, which LinuxCNC uses.
//!
//! Invariant: an angle in radians is a sum of two `f64`, rounded to 64 bits of mantissa. Sine and cosine of whole right
//! angles equal those of LinuxCNC, including the sign of the residue near zero.

use crate::pose::{Axis, Pose};
use std::f64::consts::{FRAC_PI_2, PI};

/// Difference between π rounded to 64 bits and its `f64`.
const PI_LOW: f64 = 1.225_148_454_908_62e-16;

/// Ratio of the last place of an `f64` to that of an 80-bit number: 2¹¹.
const FINER: f64 = 2048.0;

/// A value with 64 bits of mantissa, stored as a sum.
#[derive(Clone, Copy)]
struct ExtendedFloat {
    high: f64,
    low: f64,
}

impl ExtendedFloat {
    /// Returns the sum of a value and a much smaller one, rounded.
    fn sum(high: f64, low: f64) -> ExtendedFloat {
        let sum = high + low;
        let rest = low - (sum - high);
        let place = (f64::from_bits(sum.to_bits() + 1) - sum).abs() / FINER;
        let low = if place > 0.0 { (rest / place).round_ties_even() * place } else { rest };
        ExtendedFloat { high: sum, low }
    }

    /// Returns the sum of a value and a much smaller one, with all the bits that two `f64` hold.
    fn exact_sum(high: f64, low: f64) -> ExtendedFloat {
        let sum = high + low;
        ExtendedFloat { high: sum, low: low - (sum - high) }
    }

    fn negative(self) -> ExtendedFloat {
        ExtendedFloat { high: -self.high, low: -self.low }
    }

    fn times_pi(factor: f64) -> ExtendedFloat {
        let high = factor * PI;
        ExtendedFloat::sum(high, factor.mul_add(PI, -high) + factor * PI_LOW)
    }

    fn over(self, divisor: f64) -> ExtendedFloat {
        let quotient = self.high / divisor;
        let rest = (-quotient).mul_add(divisor, self.high) + self.low;
        ExtendedFloat::sum(quotient, rest / divisor)
    }
}

fn radians(degrees: f64) -> ExtendedFloat {
    ExtendedFloat::times_pi(degrees).over(180.0)
}

/// π/2 as three parts. A small multiple of the first two parts is exact.
const QUARTER: [f64; 3] = [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];

/// Number of quarter turns up to which angles are reduced exactly.
const MAX_QUARTERS: f64 = 1e6;

/// Returns the nearest quarter turn of an angle, and the remainder: at most π/4.
fn reduce(angle: ExtendedFloat) -> (i64, ExtendedFloat) {
    let quarters = (angle.high / QUARTER[0]).round();
    let near = (angle.high - quarters * QUARTER[0]) - quarters * QUARTER[1];
    let lost = ((angle.high - quarters * QUARTER[0]) - near) - quarters * QUARTER[1];
    let low = angle.low + lost - quarters * QUARTER[2];
    (quarters as i64, ExtendedFloat::exact_sum(near, low))
}

/// Taylor coefficients of the sine, from the third power.
const SINE: [f64; 9] = [
    -1.0 / 6.0,
    1.0 / 120.0,
    -1.0 / 5_040.0,
    1.0 / 362_880.0,
    -1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 1_307_674_368_000.0,
    1.0 / 355_687_428_096_000.0,
    -1.0 / 121_645_100_408_832_000.0,
];

/// Taylor coefficients of the cosine, from the fourth power.
const COSINE: [f64; 8] = [
    1.0 / 24.0,
    -1.0 / 720.0,
    1.0 / 40_320.0,
    -1.0 / 3_628_800.0,
    1.0 / 479_001_600.0,
    -1.0 / 87_178_291_200.0,
    1.0 / 20_922_789_888_000.0,
    -1.0 / 6_402_373_705_728_000.0,
];

fn series(coefficients: &[f64], z: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * z + coefficient)
}

/// Sine within an eighth of a turn of zero, as the angle plus a small correction.
fn small_sine(ExtendedFloat { high: x, low }: ExtendedFloat) -> ExtendedFloat {
    let z = x * x;
    ExtendedFloat::exact_sum(x, x * z * series(&SINE, z) + low * (1.0 - z / 2.0))
}

/// Cosine within an eighth of a turn of zero, as 1 minus half the square plus a small correction.
fn small_cosine(ExtendedFloat { high: x, low }: ExtendedFloat) -> ExtendedFloat {
    let z = x * x;
    let z_low = x.mul_add(x, -z);
    let most = 1.0 - z / 2.0;
    let lost = (1.0 - most) - z / 2.0;
    ExtendedFloat::exact_sum(most, lost - z_low / 2.0 - x * low + z * z * series(&COSINE, z))
}

/// Returns sine and cosine of an angle in degrees.
fn sine_and_cosine(degrees: f64) -> (ExtendedFloat, ExtendedFloat) {
    sine_and_cosine_of(radians(degrees))
}

/// Returns sine and cosine of an angle in radians.
fn sine_and_cosine_of(angle: ExtendedFloat) -> (ExtendedFloat, ExtendedFloat) {
    if angle.high.abs() > MAX_QUARTERS {
        // The low part may be as large as whole radians here.
        let ((sine, cosine), (small_sine, small_cosine)) = (angle.high.sin_cos(), angle.low.sin_cos());
        return (
            ExtendedFloat::exact_sum(sine * small_cosine + cosine * small_sine, 0.0),
            ExtendedFloat::exact_sum(cosine * small_cosine - sine * small_sine, 0.0),
        );
    }
    let (quarter, rest) = reduce(angle);
    let (sine, cosine) = (small_sine(rest), small_cosine(rest));
    match quarter.rem_euclid(4) {
        0 => (sine, cosine),
        1 => (cosine, sine.negative()),
        2 => (sine.negative(), cosine.negative()),
        _ => (cosine.negative(), sine),
    }
}

/// Returns the sine of an angle in degrees.
pub(crate) fn sine(degrees: f64) -> f64 {
    if degrees == 0.0 { degrees } else { sine_and_cosine(degrees).0.high }
}

/// Returns the cosine of an angle in degrees.
pub(crate) fn cosine(degrees: f64) -> f64 {
    sine_and_cosine(degrees).1.high
}

/// Returns the tangent of an angle in degrees.
pub(crate) fn tangent(degrees: f64) -> f64 {
    if degrees == 0.0 {
        return degrees;
    }
    let (sine, cosine) = sine_and_cosine(degrees);
    let quotient = sine.high / cosine.high;
    let rest = (-quotient).mul_add(cosine.high, sine.high) + sine.low - quotient * cosine.low;
    quotient + rest / cosine.high
}

/// Converts radians to degrees.
pub(crate) fn to_degrees(radians: f64) -> f64 {
    if radians == 0.0 {
        return radians;
    }
    // The product is an `f64` in LinuxCNC too; only the division has more bits.
    let product = radians * 180.0;
    let quotient = product / PI;
    let rest = (-quotient).mul_add(PI, product) - quotient * PI_LOW;
    quotient + rest / PI
}

/// Returns the sum of an angle in radians and a whole number of right angles.
fn with_quarters(angle: f64, quarters: i32, more: f64) -> ExtendedFloat {
    let exact_sum = |first: f64, second: f64| {
        let sum = first + second;
        let rest = sum - first;
        (sum, (first - (sum - rest)) + (second - rest))
    };
    let quarters = f64::from(quarters);
    let turned = quarters * FRAC_PI_2;
    let (sum, lost) = exact_sum(angle, turned);
    let (sum, lost_too) = exact_sum(sum, more);
    ExtendedFloat::exact_sum(sum, lost + lost_too + quarters.mul_add(FRAC_PI_2, -turned) + quarters * (PI_LOW / 2.0))
}

/// Returns the sum of an angle in radians, a whole number of right angles and another angle, with 80 bits.
pub(crate) fn plus_quarters(angle: f64, quarters: i32, more: f64) -> f64 {
    with_quarters(angle, quarters, more).high
}

/// Returns a factor times the sine of an angle in radians plus a whole number of right angles, with 80 bits.
pub(crate) fn times_sine(factor: f64, angle: f64, quarters: i32) -> f64 {
    let sine = sine_and_cosine_of(with_quarters(angle, quarters, 0.0)).0;
    let product = factor * sine.high;
    product + (factor.mul_add(sine.high, -product) + factor * sine.low)
}

/// Returns the angle from start to end about a centre, in radians: positive counter-clockwise, plus whole turns beyond
/// the first.
pub(crate) fn sweep(start: (f64, f64), end: (f64, f64), centre: (f64, f64), turns: i32) -> f64 {
    let mut from = (start.1 - centre.1).atan2(start.0 - centre.0);
    let mut to = (end.1 - centre.1).atan2(end.0 - centre.0);
    if turns > 0 {
        if to <= from {
            to = plus_quarters(to, 4, 0.0);
        }
        plus_quarters(to - from, (turns - 1).saturating_mul(4), 0.0)
    } else {
        if from <= to {
            from = plus_quarters(from, 4, 0.0);
        }
        plus_quarters(to - from, (turns + 1).saturating_mul(4), 0.0)
    }
}

/// Rotates a point about the origin by an angle in degrees, counter-clockwise.
pub(crate) fn rotate(x: f64, y: f64, degrees: f64) -> (f64, f64) {
    // One factor is a plain `f64` here, as in LinuxCNC.
    let radians = degrees * (PI / 180.0);
    let (sine, cosine) = (radians.sin(), radians.cos());
    (x * cosine - y * sine, x * sine + y * cosine)
}

/// Rotates X and Y of a pose about the origin by an angle in degrees, counter-clockwise.
pub(crate) fn turned_xy(mut pose: Pose, degrees: f64) -> Pose {
    (pose[Axis::X], pose[Axis::Y]) = rotate(pose[Axis::X], pose[Axis::Y], degrees);
    pose
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn whole_angles_are_exact() {
        assert_eq!(to_degrees(1.0_f64.atan2(1.0)), 45.0);
        assert_eq!(to_degrees(1.0_f64.atan2(0.0)), 90.0);
        assert_eq!((sine(30.0), sine(150.0), cosine(60.0), cosine(-240.0)), (0.5, 0.5, 0.5, -0.5));
        assert_eq!((sine(90.0), cosine(180.0), tangent(45.0), tangent(-225.0)), (1.0, -1.0, 1.0, -1.0));
    }

    /// 80-bit arithmetic leaves −2.5·10⁻²⁰ instead of zero at 90°, which LinuxCNC prints as a tangent of
    /// −39867976298117103616.
    #[test]
    fn the_rest_of_zero_is_that_of_80_bits() {
        assert!((tangent(90.0) / -39_867_976_298_117_103_616.0 - 1.0).abs() < 1e-9, "{}", tangent(90.0));
        assert!(cosine(-90.0) < 0.0);
        assert!(sine(-0.0).is_sign_negative() && tangent(-0.0).is_sign_negative());
    }

    /// 80 bits hold an angle of a thousand million turns to 3·10⁻¹⁰, 64 bits to 7·10⁻⁷.
    #[test]
    fn large_angles_keep_what_80_bits_hold() {
        let turns = 360.0 * 1e9;
        assert!(cosine(turns + 90.0).abs() < 1e-9 && cosine(turns - 90.0).abs() < 1e-9, "{}", cosine(turns + 90.0));
        assert!(sine(turns).abs() < 1e-9 && (sine(turns + 30.0) - 0.5).abs() < 1e-9, "{}", sine(turns));
    }

    proptest! {
        #[test]
        fn sine_and_cosine_are_those_of_the_standard_library(degrees in -1e5..1e5_f64) {
            let plain = degrees.to_radians();
            let margin = 1e-15 + plain.abs() * f64::EPSILON;
            prop_assert!((sine(degrees) - plain.sin()).abs() <= margin);
            prop_assert!((cosine(degrees) - plain.cos()).abs() <= margin);
        }
    }

    #[test]
    fn right_angles_are_added_with_more_than_64_bits() {
        assert_eq!(plus_quarters(0.0, 2, 0.0), PI);
        // Difference between π and its nearest `f64`.
        assert_eq!(plus_quarters(-PI, 2, 0.0), PI_LOW);
        assert_eq!(plus_quarters(1.0, 2, -1.0), PI);
        assert_eq!(times_sine(2.0, PI, -2), -2.0 * PI_LOW);
        assert_eq!(sweep((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), 1), FRAC_PI_2);
        assert_eq!(sweep((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), -2), -3.5 * PI);
    }

    #[test]
    fn no_rotation_changes_nothing() {
        assert_eq!(rotate(1.25, -7.5, 0.0), (1.25, -7.5));
    }
}
