//! The output for S, `[card.spindle_pwm]`: the speed of a spindle or the power of a beam, by pulse-width modulation
//! (SPN-5).
//!
//! Invariant: a curve rises in speed from point to point, as the card wants it.

use retrace_link::{MAX_CURVE_POINTS, PWM_HZ, SpeedCurve, SpeedPoint, SpindlePwm};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::axis::refuse;
use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Output for S, `[card.spindle_pwm]`: the speed of a spindle or the power of a beam, by pulse-width modulation.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct SpindlePwmSection {
    /// S at a duty cycle of 100 %: the speed of the spindle in revolutions per minute, or the power of the beam. Not
    /// beside `curve`.
    max_s: Option<f64>,
    /// Frequency in Hz.
    hz: f64,
    /// Points [S, duty cycle in percent] by rising S, 2 … 8: straight between them, constant outside of them. For a
    /// drive whose speed is not in proportion to the duty cycle.
    #[schemars(length(max = 8))]
    curve: Vec<[f64; 2]>,
}

impl Default for SpindlePwmSection {
    fn default() -> Self {
        Self { max_s: None, hz: 5000.0, curve: Vec::new() }
    }
}

/// Output for S of a beam with `power`, in a machine file without `[card.spindle_pwm]`: the defaults of that section.
pub(crate) const SPINDLE_PWM_OF_A_BEAM: SpindlePwm = SpindlePwm { full_scale: 1_000_000, hz: 5000 };

impl SpindlePwmSection {
    /// Checks the settings. Returns what the card receives: its settings, and the curve, if there is one.
    pub(crate) fn checked(&self) -> Result<(SpindlePwm, Option<SpeedCurve>), NumberedError> {
        within("card.spindle_pwm.hz", self.hz, f64::from(*PWM_HZ.start()), f64::from(*PWM_HZ.end()))?;
        let hz = self.hz.round() as u16;
        if self.curve.is_empty() {
            let max_s = self.max_s.unwrap_or(f64::from(SPINDLE_PWM_OF_A_BEAM.full_scale) / 1000.0);
            within("card.spindle_pwm.max_s", max_s, 1.0, 1e6)?;
            return Ok((SpindlePwm { full_scale: thousandths(max_s), hz }, None));
        }
        if self.max_s.is_some() {
            return Err(refuse(
                "card.spindle_pwm: `curve` and `max_s` exclude each other: the last point of the curve is the highest S"
                    .into(),
            ));
        }
        let mut curve = SpeedCurve::default();
        for (n, &[s, percent]) in self.curve.iter().enumerate() {
            within(&format!("card.spindle_pwm.curve[{n}][0]"), s, 0.0, 1e6)?;
            within(&format!("card.spindle_pwm.curve[{n}][1]"), percent, 0.0, 100.0)?;
            if let Some(slot) = curve.points.get_mut(n) {
                *slot = SpeedPoint { speed: thousandths(s), duty: (percent * 655.36).round() as u32 };
            }
        }
        curve.count = self.curve.len().min(MAX_CURVE_POINTS + 1) as u8;
        if !curve.is_valid() {
            return Err(refuse(format!(
                "card.spindle_pwm.curve: 2 to {MAX_CURVE_POINTS} points [S, percent], each at a higher S than the one \
                 before"
            )));
        }
        Ok((SpindlePwm { full_scale: SpindlePwm::BY_CURVE, hz }, Some(curve)))
    }
}

/// S as it is sent.
fn thousandths(s: f64) -> u32 {
    (1000.0 * s).round() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MachineConfig;
    use retrace_core::RecordIndex;
    use retrace_link::{CardSettings, PathStart};

    fn settings(text: &str) -> Result<CardSettings<4>, NumberedError> {
        let axis = "[[axis]]\nname = \"x\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = \
                    100\nmax_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-300, 300]\n";
        let machine = MachineConfig::parse(&format!("{axis}{text}"), "m.toml")?;
        Ok(machine.card_settings(PathStart::at(RecordIndex::new(0))))
    }

    #[test]
    fn it_is_used_where_it_is_asked_for_or_a_beam_has_a_power() {
        let told = |text: &str| settings(text).expect("valid").spindle_pwm;
        assert_eq!(told(""), None);
        let router = SpindlePwm { full_scale: 24_000_000, hz: 1000 };
        assert_eq!(told("[card.spindle_pwm]\nmax_s = 24000\nhz = 1000\n"), Some(router));
        assert_eq!(told("[card.spindle_pwm]\n"), Some(SPINDLE_PWM_OF_A_BEAM));
        let beam = "[[cutter]]\nname = \"laser\"\nkind = \"beam\"\nfire = 64\npower = {}\n";
        assert_eq!(told(beam), Some(SPINDLE_PWM_OF_A_BEAM));
        for wrong in ["max_s = 0.5", "hz = 99", "hz = 50001", "max_s = nan", "duty = 1"] {
            assert!(settings(&format!("[card.spindle_pwm]\n{wrong}\n")).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_curve_rises_in_speed_and_needs_no_highest_s() {
        let told = settings("[card.spindle_pwm]\ncurve = [[0, 0], [3000, 18.5], [24000, 100]]\n").expect("valid");
        assert_eq!(told.spindle_pwm, Some(SpindlePwm { full_scale: SpindlePwm::BY_CURVE, hz: 5000 }));
        let curve = told.speed_curve.expect("a curve");
        let points = curve.points().iter().map(|point| (point.speed, point.duty)).collect::<Vec<_>>();
        assert_eq!(points, [(0, 0), (3_000_000, 12_124), (24_000_000, 65_536)]);
        let nine = format!("curve = {:?}", (0..9).map(|n| [f64::from(n), 1.0]).collect::<Vec<_>>());
        for wrong in [
            "curve = [[0, 0]]",
            "curve = [[0, 0], [0, 50]]",
            "curve = [[1000, 0], [500, 50]]",
            "curve = [[0, -1], [500, 50]]",
            "curve = [[0, 0], [500, 101]]",
            "curve = [[0, 0], [2e6, 50]]",
            "curve = [[0, 0], [nan, 50]]",
            "curve = [[0, 0], [500, 50]]\nmax_s = 500",
            nine.as_str(),
        ] {
            assert!(settings(&format!("[card.spindle_pwm]\n{wrong}\n")).is_err(), "{wrong}");
        }
    }
}
