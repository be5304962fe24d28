//! The duty cycle of the output for S in each control period: the speed of a spindle, or the power of a beam.
//!
//! Invariant: the duty cycle is 0 unless the spindle's channel is not 0, and at most [`FULL`].

use retrace_link::{Outputs, SpeedCurve, SpeedPoint, SpindlePwm, channel};

/// A duty cycle of 100 %.
pub const FULL: u32 = 1 << 16;

/// The output for S in a control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PwmSignal {
    /// Frequency in Hz.
    pub hz: u16,
    /// Duty cycle, 0 … [`FULL`].
    pub duty: u32,
}

/// Returns the duty cycle, 0 … [`FULL`]. `curve` is the one that the card has received, if any. `beam_power` is the
/// power of a beam in the unit of S, if the output is that of a beam; the speed of a spindle is S while it turns, in
/// either direction.
#[must_use]
pub fn duty_of(pwm: SpindlePwm, curve: Option<&SpeedCurve>, beam_power: Option<i32>, outputs: &Outputs) -> u32 {
    let [spindle, speed] = [channel::SPINDLE, channel::SPEED].map(|number| outputs[usize::from(number)]);
    let value = if spindle == 0 { 0 } else { beam_power.unwrap_or(speed) };
    if pwm.full_scale == SpindlePwm::BY_CURVE {
        // Off is off, whatever the curve has at 0.
        return curve.filter(|_| value > 0).map_or(0, |curve| duty_on(curve, value as u32));
    }
    let value = (value.max(0) as u32).min(pwm.full_scale);
    // below 2⁴⁷; the full scale is not 0, and the result is at most 2¹⁶
    ((u64::from(value) << 16) / u64::from(pwm.full_scale.max(1))) as u32
}

/// The curve at this speed.
fn duty_on(curve: &SpeedCurve, speed: u32) -> u32 {
    let points = curve.points();
    let next = points.partition_point(|point| point.speed <= speed);
    let (Some(&from), Some(&to)) = (points.get(next.saturating_sub(1)), points.get(next)) else {
        return points.last().map_or(0, |last| last.duty);
    };
    let SpeedPoint { speed: from_speed, duty: from_duty } = from;
    if next == 0 || to.speed <= from_speed {
        return from_duty;
    }
    // Both products are below 2⁴⁸, and the quotient is between the two.
    let [share, way] = [speed - from_speed, to.speed - from_speed].map(i64::from);
    let rise = i64::from(to.duty) - i64::from(from_duty);
    (i64::from(from_duty) + (rise * share).div_euclid(way)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PWM: SpindlePwm = SpindlePwm { full_scale: 24_000_000, hz: 5000 };

    fn outputs(spindle: i32, speed: i32) -> Outputs {
        let mut outputs = [0; channel::COUNT];
        (outputs[usize::from(channel::SPINDLE)], outputs[usize::from(channel::SPEED)]) = (spindle, speed);
        outputs
    }

    #[test]
    fn a_spindle_turns_at_s_and_a_beam_has_its_power() {
        let duty = |spindle, speed| duty_of(PWM, None, None, &outputs(spindle, speed));
        assert_eq!([duty(0, 12_000_000), duty(1, 12_000_000), duty(-1, 12_000_000)], [0, FULL / 2, FULL / 2]);
        assert_eq!([duty(1, 0), duty(1, 24_000_000), duty(1, i32::MAX), duty(1, -5)], [0, FULL, FULL, 0]);
        assert_eq!(duty_of(PWM, None, Some(6_000_000), &outputs(1, 24_000_000)), FULL / 4);
        assert_eq!(duty_of(PWM, None, Some(6_000_000), &outputs(0, 24_000_000)), 0, "a beam that is off");
    }

    #[test]
    fn a_curve_is_straight_between_its_points_and_constant_outside() {
        let points = [(1000, 100), (2000, 1100), (3000, 1000)].map(|(speed, duty)| SpeedPoint { speed, duty });
        let mut curve = SpeedCurve { count: 3, ..SpeedCurve::default() };
        curve.points[..3].copy_from_slice(&points);
        let pwm = SpindlePwm { full_scale: SpindlePwm::BY_CURVE, hz: 100 };
        let duty = |spindle, speed| duty_of(pwm, Some(&curve), None, &outputs(spindle, speed));
        assert_eq!([0, 1, 999, 1000, 1500, 2000].map(|speed| duty(1, speed)), [0, 100, 100, 100, 600, 1100]);
        assert_eq!([2001, 2500, 3000, i32::MAX, -7].map(|speed| duty(-1, speed)), [1099, 1050, 1000, 1000, 0]);
        assert_eq!((duty(0, 2000), duty_of(pwm, None, None, &outputs(1, 2000))), (0, 0), "off, and without a curve");
    }

    proptest! {
        /// Whatever the curve, the duty cycle is within those of the two points around S.
        #[test]
        fn the_duty_cycle_is_between_the_points(
            points in prop::collection::btree_map(0u32..=i32::MAX as u32, 0u32..=FULL, 2..=8),
            speed in 1..=i32::MAX,
        ) {
            let mut curve = SpeedCurve { count: points.len() as u8, ..SpeedCurve::default() };
            for (slot, (&speed, &duty)) in curve.points.iter_mut().zip(&points) {
                *slot = SpeedPoint { speed, duty };
            }
            prop_assert!(curve.is_valid());
            let pwm = SpindlePwm { full_scale: SpindlePwm::BY_CURVE, hz: 100 };
            let duty = duty_of(pwm, Some(&curve), None, &outputs(1, speed));
            let below = points.range(..=speed as u32).next_back().or(points.iter().next()).map(|(_, &duty)| duty);
            let above = points.range(speed as u32..).next().or(points.iter().next_back()).map(|(_, &duty)| duty);
            let [low, high] = [below.min(above), below.max(above)].map(Option::unwrap);
            prop_assert!((low..=high).contains(&duty), "{duty} of {low} to {high}");
        }

        /// The duty cycle is S over full scale, within a step, and grows with S.
        #[test]
        fn the_duty_cycle_follows_s(full_scale in 1u32..=i32::MAX as u32, speed: i32, more in 0i32..1000) {
            let duty = |speed| duty_of(SpindlePwm { full_scale, hz: 100 }, None, None, &outputs(1, speed));
            let exact = f64::from(speed).clamp(0.0, f64::from(full_scale)) / f64::from(full_scale);
            let below = exact * f64::from(FULL) - f64::from(duty(speed));
            prop_assert!((-1e-6..1.0).contains(&below), "{below}");
            prop_assert!(duty(speed) <= duty(speed.saturating_add(more)) && duty(speed) <= FULL);
        }
    }
}
