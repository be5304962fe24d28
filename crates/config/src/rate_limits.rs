//! The limits of the rate law: the machine file's limits in pulses and control periods (REV, *Rate law*).
//!
//! Invariant: no limit is better than the machine file's, and the filter is the shortest with `n ≥ A/J` on every axis.

use retrace_core::Rate;
use retrace_core::drive::Braking;
use retrace_core::limits::{PulseLimits, RateLimits};

use crate::axis::AxisConfig;

/// Longest filter that a card's memory is expected to hold, in periods.
const LONGEST: u16 = 1023;

/// Records that may be in flight to the card, or that it has run since its last report, at the latency of a common
/// link.
pub const IN_FLIGHT_RECORDS: u32 = 120;

/// The limits as a card receives them. Missing axes have those of the first. `None` where an axis is too slow for the
/// units of [`PulseLimits`], or its acceleration takes too many periods to build up for a card's memory.
#[must_use]
pub(crate) fn rate_limits<const A: usize>(axes: &[AxisConfig], reserve: f64, period_s: f64) -> Option<RateLimits<A>> {
    let mut all = [axis_limits(axes.first()?, period_s)?; A];
    for (slot, axis) in all.iter_mut().zip(axes) {
        *slot = axis_limits(axis, period_s)?;
    }
    let average = all.iter().map(|axis| axis.acceleration.div_ceil(axis.jerk)).max()?;
    let average = u16::try_from(average).ok().filter(|&n| n <= LONGEST)? | 1;
    RateLimits::new(average, ((1.0 - reserve) * 65_536.0).ceil() as u16, all)
}

/// Limits of one axis in fixed point. Values above the largest that can be represented become that.
fn axis_limits(axis: &AxisConfig, period_s: f64) -> Option<PulseLimits> {
    let figure = |per_s: f64, power: i32| {
        let pulses = per_s * axis.pulses_per_mm * period_s.powi(power);
        // A value that is exact in theory must not become smaller by the rounding of floats.
        let figure = (pulses * 4_294_967_296.0 * (1.0 + 1e-12)) as u64;
        (figure >= PulseLimits::MIN).then_some(figure.min(PulseLimits::MAX))
    };
    Some(PulseLimits {
        velocity: figure(axis.max_velocity_mm_per_s, 1)?,
        acceleration: figure(axis.max_acceleration_mm_per_s2, 2)?,
        jerk: figure(axis.max_jerk_mm_per_s3, 3)?,
    })
}

/// What the host derives from the limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoppingTimes {
    /// Periods within which the machine is at rest after a hold at rate 1, wherever it is.
    pub periods: u32,
    /// The same on a straight run at an axis' maximum velocity.
    pub straight_periods: u32,
    /// Records beyond the cursor on which the rate may depend up to rate 1: those it needs to brake, and those of the
    /// increment bounds.
    pub look_ahead_records: u32,
}

impl StoppingTimes {
    /// Times for these limits. `None` where the machine brakes too slowly for a card.
    #[must_use]
    pub fn from_limits<const A: usize>(limits: &RateLimits<A>) -> Option<Self> {
        let braking = Braking::<32>::new(limits)?;
        let average = u32::from(limits.average());
        let braked = (braking.length(Rate::ONE).units() >> 32) as u32 + average / 2 + 4;
        // bounds cover blocks of eight records, two beyond what the cursor may reach
        let foresight_records = braked.max(average + 36);
        let ramp = limits.axes().iter().map(|axis| axis.velocity.div_ceil(axis.acceleration)).max().unwrap_or(0);
        let straight_periods = u32::try_from(ramp).ok()?.checked_add(average)?;
        Some(Self { straight_periods, periods: braking.periods() + average, look_ahead_records: foresight_records })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine_config::MachineConfig;

    #[test]
    fn the_built_in_machine_in_pulses_and_periods() {
        let machine = MachineConfig::built_in().expect("valid");
        let limits = machine.rate_limits::<3>().expect("checked");
        assert_eq!((limits.average(), limits.share()), (51, 58_983));
        let axis = limits.axes()[2];
        assert_eq!((axis.velocity >> 32, axis.acceleration >> 32, (50 * (axis.jerk + 1)) >> 32), (100, 1, 1));
        // the ramp under (A − αAu²)/V and the jerk's bound takes a third of a second
        assert!((370..=400).contains(&machine.stopping.periods), "{:?}", machine.stopping);
        assert_eq!(machine.stopping.straight_periods, 100 + 51);
        assert!((240..=250).contains(&machine.stopping.look_ahead_records), "{:?}", machine.stopping);
    }

    #[test]
    fn stiffer_machines_stop_sooner() {
        let mut axes = MachineConfig::built_in().expect("valid").axes;
        let stopping =
            |axes: &[AxisConfig]| rate_limits::<3>(axes, 0.1, 0.001).as_ref().and_then(StoppingTimes::from_limits);
        let slow = stopping(&axes).expect("fits").periods;
        for axis in &mut axes {
            axis.max_acceleration_mm_per_s2 *= 4.0;
            axis.max_jerk_mm_per_s3 *= 10.0;
        }
        assert!(stopping(&axes).expect("fits").periods * 5 < 2 * slow);
        for axis in &mut axes {
            axis.max_jerk_mm_per_s3 = 100.0;
        }
        assert_eq!(stopping(&axes), None);
    }
}
