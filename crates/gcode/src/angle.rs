//! Degrees and radians with π to more than double precision.
//!
//! Invariant: a result is the nearest `f64` but for rare ties, as with the 80-bit arithmetic of the peer interpreter.

/// What π lacks beyond its `f64`.
const PI_LOW: f64 = 1.224_646_799_147_353_2e-16;

/// Radians of an angle in degrees.
pub(crate) fn to_radians(degrees: f64) -> f64 {
    let high = degrees * std::f64::consts::PI;
    let low = degrees.mul_add(std::f64::consts::PI, -high) + degrees * PI_LOW;
    let quotient = (high + low) / 180.0;
    let rest = (-quotient).mul_add(180.0, high) + low;
    quotient + rest / 180.0
}

/// Degrees of an angle in radians.
pub(crate) fn to_degrees(radians: f64) -> f64 {
    let high = radians * 180.0;
    let low = radians.mul_add(180.0, -high);
    let quotient = high / std::f64::consts::PI;
    let rest = (-quotient).mul_add(std::f64::consts::PI, high) + (low - quotient * PI_LOW);
    quotient + rest / std::f64::consts::PI
}

/// Turns a point about the origin by an angle in degrees, counter-clockwise.
pub(crate) fn rotate(x: f64, y: f64, degrees: f64) -> (f64, f64) {
    // One factor in plain `f64` here, as the peer has it.
    let radians = degrees * (std::f64::consts::PI / 180.0);
    let (sine, cosine) = (radians.sin(), radians.cos());
    (x * cosine - y * sine, x * sine + y * cosine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_exact_in_degrees() {
        assert_eq!(to_degrees(1.0_f64.atan2(1.0)), 45.0);
        assert_eq!(to_degrees(1.0_f64.atan2(0.0)), 90.0);
        assert_eq!(to_radians(180.0), std::f64::consts::PI);
        assert_eq!(to_radians(30.0).sin(), 0.5);
    }

    #[test]
    fn no_rotation_changes_nothing() {
        assert_eq!(rotate(1.25, -7.5, 0.0), (1.25, -7.5));
    }
}
