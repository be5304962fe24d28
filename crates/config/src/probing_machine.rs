//! The limits of a machine in its probing moves (PRB-3).
//!
//! Invariant: they are those of [`crate::ProbingLimits`], for each axis of the machine.

use retrace_core::limits::RateLimits;
use retrace_motion::MachineLimits;

use crate::machine_config::MachineConfig;
use crate::rate_limits::rate_limits;

impl MachineConfig {
    /// Limits for the planner in a probing move; missing axes have those of the first axis.
    #[must_use]
    pub fn probing_limits<const A: usize>(&self) -> MachineLimits<A> {
        MachineLimits {
            reserve: self.probe.limits.reserve,
            ..self.limits_of(&self.probe.limits.axes(&self.axes, self.period_s()))
        }
    }

    /// Limits for a card's rate law in a probing move; missing axes have those of the first axis. Not `None` for a
    /// machine whose file was checked.
    #[must_use]
    pub fn probing_rate_limits<const A: usize>(&self) -> Option<RateLimits<A>> {
        rate_limits(&self.probe.limits.axes(&self.axes, self.period_s()), self.probe.limits.reserve, self.period_s())
    }

    /// Highest jerk of each axis in a probing move, mm/s³, in the order of [`MachineConfig::axes`].
    #[must_use]
    pub fn probing_jerks_mm_per_s3(&self) -> Vec<f64> {
        self.probe.limits.axes(&self.axes, self.period_s()).iter().map(|axis| axis.max_jerk_mm_per_s3).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numbered_error::NumberedError;

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
        let own = machine("acceleration_mm_per_s2 = 600\njerk_mm_per_s3 = 5e5\n").expect("valid");
        let (probing, others) = (own.probing_limits::<2>(), own.limits::<2>());
        assert_eq!((probing.acceleration_mm_s2, probing.jerk_mm_s3), ([600.0, 400.0], [5e5, 4e5]));
        assert_eq!((others, probing.reserve), (plain.limits::<2>(), 0.75));
        assert_eq!((probing.velocity_mm_s, probing.pulses_per_mm), (others.velocity_mm_s, others.pulses_per_mm));
        assert_eq!(own.probing_rate_limits::<2>().map(|limits| limits.average()), Some(3));
        assert_eq!(own.probing_jerks_mm_per_s3(), [5e5, 4e5], "within a period of 1 ms");
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
