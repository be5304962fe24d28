//! The duty cycle of the output for S in each control period: the speed of a spindle, or the power of a beam.
//!
//! Invariant: the duty cycle is 0 unless the spindle's channel is not 0, and at most [`FULL`].

use retrace_link::{Outputs, SpindlePwm, channel};

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

/// Returns the duty cycle, 0 … [`FULL`]. `beam_power` is the power of a beam in the unit of S, if the output is that of
/// a beam; the speed of a spindle is S while it turns, in either direction.
#[must_use]
pub fn duty_of(pwm: SpindlePwm, beam_power: Option<i32>, outputs: &Outputs) -> u32 {
    let [spindle, speed] = [channel::SPINDLE, channel::SPEED].map(|number| outputs[usize::from(number)]);
    let value = if spindle == 0 { 0 } else { beam_power.unwrap_or(speed) };
    let value = (value.max(0) as u32).min(pwm.full_scale);
    // below 2⁴⁷; the full scale is not 0, and the result is at most 2¹⁶
    ((u64::from(value) << 16) / u64::from(pwm.full_scale.max(1))) as u32
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
        let duty = |spindle, speed| duty_of(PWM, None, &outputs(spindle, speed));
        assert_eq!([duty(0, 12_000_000), duty(1, 12_000_000), duty(-1, 12_000_000)], [0, FULL / 2, FULL / 2]);
        assert_eq!([duty(1, 0), duty(1, 24_000_000), duty(1, i32::MAX), duty(1, -5)], [0, FULL, FULL, 0]);
        assert_eq!(duty_of(PWM, Some(6_000_000), &outputs(1, 24_000_000)), FULL / 4);
        assert_eq!(duty_of(PWM, Some(6_000_000), &outputs(0, 24_000_000)), 0, "a beam that is off");
    }

    proptest! {
        /// The duty cycle is S over full scale, within a step, and grows with S.
        #[test]
        fn the_duty_cycle_follows_s(full_scale in 1u32..=i32::MAX as u32, speed: i32, more in 0i32..1000) {
            let duty = |speed| duty_of(SpindlePwm { full_scale, hz: 100 }, None, &outputs(1, speed));
            let exact = f64::from(speed).clamp(0.0, f64::from(full_scale)) / f64::from(full_scale);
            let below = exact * f64::from(FULL) - f64::from(duty(speed));
            prop_assert!((-1e-6..1.0).contains(&below), "{below}");
            prop_assert!(duty(speed) <= duty(speed.saturating_add(more)) && duty(speed) <= FULL);
        }
    }
}
