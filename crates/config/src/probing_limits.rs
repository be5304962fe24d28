//! Limits of the axes in a probing move (PRB-3).
//!
//! Invariant: no acceleration is above that of the axis in any other move; velocities are those of the axes. Limits
//! that passed the check fit a card.

use retrace_core::limits::RateLimits;
use retrace_motion::MachineLimits;

use crate::axis::{AxisConfig, refuse};
use crate::machine_config::MachineConfig;
use crate::numbered_error::NumberedError;
use crate::rate_limits::{StoppingTimes, rate_limits};
use crate::value_range::within;

/// Acceleration and jerk of probing moves, as the machine file names them, and how the machine stops with them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbingLimits {
    /// Highest acceleration in mm/s² (degrees/s²); `None` for that of each axis. An axis whose own is lower keeps it.
    acceleration_mm_per_s2: Option<f64>,
    /// Highest jerk in mm/s³ (degrees/s³), of all axes; `None` for that of each axis.
    jerk_mm_per_s3: Option<f64>,
    /// Share of acceleration and jerk that the plan of a probing move leaves to the stop behind a touch.
    reserve: f64,
    /// Stopping times in a probing move.
    pub stopping: StoppingTimes,
}

/// Share of acceleration and jerk of its own that the plan of a probing move leaves to the stop at least: it speeds up
/// gently, and stops in little more than the shortest way.
const STOP_RESERVE: f64 = 0.75;

impl ProbingLimits {
    /// Checks `probe.acceleration_mm_per_s2` and `probe.jerk_mm_per_s3`.
    ///
    /// # Errors
    /// `E2112` for a value out of its range, and where the machine would brake too slowly for a card.
    pub(crate) fn checked(
        acceleration_mm_per_s2: Option<f64>,
        jerk_mm_per_s3: Option<f64>,
        (axes, reserve, period_s): (&[AxisConfig], f64, f64),
    ) -> Result<Self, NumberedError> {
        if let Some(value) = acceleration_mm_per_s2 {
            let highest = axes.iter().map(|axis| axis.max_acceleration_mm_per_s2).fold(0.001, f64::max);
            within("probe.acceleration_mm_per_s2", value, 0.001, highest)?;
        }
        if let Some(value) = jerk_mm_per_s3 {
            within("probe.jerk_mm_per_s3", value, 0.001, 1e10)?;
        }
        let has_its_own = acceleration_mm_per_s2.is_some() || jerk_mm_per_s3.is_some();
        let reserve = if has_its_own { reserve.max(STOP_RESERVE) } else { reserve };
        let limited = limited_axes(axes, acceleration_mm_per_s2, jerk_mm_per_s3);
        let limits = rate_limits::<9>(&limited, reserve, period_s);
        let stopping = limits.as_ref().and_then(StoppingTimes::from_limits).ok_or_else(|| {
            let name = |key: &str, value: Option<f64>| value.map(|value| format!("probe.{key} = {value}"));
            let named =
                [name("acceleration_mm_per_s2", acceleration_mm_per_s2), name("jerk_mm_per_s3", jerk_mm_per_s3)];
            let named = named.into_iter().flatten().collect::<Vec<_>>().join(", ");
            refuse(format!("{named}: the machine brakes too slowly in a probing move for the card's memory"))
        })?;
        Ok(Self { acceleration_mm_per_s2, jerk_mm_per_s3, reserve, stopping })
    }

    /// The axes as they are limited in a probing move.
    fn axes(&self, axes: &[AxisConfig]) -> Vec<AxisConfig> {
        limited_axes(axes, self.acceleration_mm_per_s2, self.jerk_mm_per_s3)
    }
}

fn limited_axes(axes: &[AxisConfig], acceleration: Option<f64>, jerk: Option<f64>) -> Vec<AxisConfig> {
    let mut axes = axes.to_vec();
    for axis in &mut axes {
        axis.max_acceleration_mm_per_s2 = acceleration.unwrap_or(f64::INFINITY).min(axis.max_acceleration_mm_per_s2);
        axis.max_jerk_mm_per_s3 = jerk.unwrap_or(axis.max_jerk_mm_per_s3);
    }
    axes
}

impl MachineConfig {
    /// Limits for the planner in a probing move; missing axes have those of the first axis.
    #[must_use]
    pub fn probing_limits<const A: usize>(&self) -> MachineLimits<A> {
        MachineLimits { reserve: self.probe.limits.reserve, ..self.limits_of(&self.probe.limits.axes(&self.axes)) }
    }

    /// Limits for a card's rate law in a probing move; missing axes have those of the first axis. Not `None` for a
    /// machine whose file was checked.
    #[must_use]
    pub fn probing_rate_limits<const A: usize>(&self) -> Option<RateLimits<A>> {
        rate_limits(&self.probe.limits.axes(&self.axes), self.probe.limits.reserve, self.period_s())
    }

    /// Highest jerk of each axis in a probing move, mm/s³, in the order of [`MachineConfig::axes`].
    #[must_use]
    pub fn probing_jerks_mm_per_s3(&self) -> Vec<f64> {
        self.probe.limits.axes(&self.axes).iter().map(|axis| axis.max_jerk_mm_per_s3).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine(probe: &str) -> Result<MachineConfig, NumberedError> {
        let axis = |name: char, acceleration: f64| {
            format!(
                "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\n\
                 max_acceleration_mm_per_s2 = {acceleration}\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-500, 500]\n"
            )
        };
        MachineConfig::parse(&format!("{}{}[probe]\n{probe}", axis('x', 1000.0), axis('z', 400.0)), "m.toml")
    }

    #[test]
    fn a_probing_move_has_the_limits_of_the_axes_unless_it_names_its_own() {
        let plain = machine("").expect("valid");
        assert_eq!(plain.probing_limits::<2>(), plain.limits::<2>());
        assert_eq!(plain.probing_rate_limits::<2>(), plain.rate_limits::<2>());
        assert_eq!(plain.probe.limits.stopping, plain.stopping);
        let own = machine("acceleration_mm_per_s2 = 600\njerk_mm_per_s3 = 1e6\n").expect("valid");
        let (probing, others) = (own.probing_limits::<2>(), own.limits::<2>());
        assert_eq!((probing.acceleration_mm_s2, probing.jerk_mm_s3), ([600.0, 400.0], [1e6; 2]));
        assert_eq!((others, probing.reserve), (plain.limits::<2>(), 0.75));
        assert_eq!((probing.velocity_mm_s, probing.pulses_per_mm), (others.velocity_mm_s, others.pulses_per_mm));
        assert_eq!(own.probing_rate_limits::<2>().map(|limits| limits.average()), Some(1));
        assert_eq!(own.probing_jerks_mm_per_s3(), [1e6; 2]);
        assert!(own.probe.limits.stopping.periods < own.stopping.periods, "{:?}", own.probe.limits);
    }

    #[test]
    fn what_no_axis_can_do_or_no_card_can_brake_with_is_refused() {
        for (probe, told) in [
            ("acceleration_mm_per_s2 = 1000.5\n", "0.001 to 1000"),
            ("acceleration_mm_per_s2 = 0\n", "0.001 to 1000"),
            ("acceleration_mm_per_s2 = nan\n", "0.001 to 1000"),
            ("jerk_mm_per_s3 = -1\n", "0.001 to 10000000000"),
            ("jerk_mm_per_s3 = inf\n", "0.001 to 10000000000"),
            ("jerk_mm_per_s3 = 100\n", "probe.jerk_mm_per_s3 = 100: the machine brakes too slowly"),
            ("acceleration_mm_per_s2 = 0.001\n", "probe.acceleration_mm_per_s2 = 0.001"),
        ] {
            let error = machine(probe).expect_err(probe);
            assert_eq!(error.number, "E2112", "{probe}");
            let told_all = format!("{error} {}", error.remedy);
            assert!(told_all.contains(told), "{probe}: {told_all}");
        }
    }

    /// The axes need more records ahead to brake slowly in a probing move, so that more are planned.
    #[test]
    fn enough_is_planned_ahead_to_stop_in_a_probing_move() {
        let slow = machine("acceleration_mm_per_s2 = 20\n").expect("valid");
        let (probing, usual) = (slow.probe.limits.stopping.look_ahead_records, slow.stopping.look_ahead_records);
        assert!(probing > 2 * usual, "{probing} {usual}");
        assert!(slow.look_ahead_records > probing, "{} {probing}", slow.look_ahead_records);
    }
}
