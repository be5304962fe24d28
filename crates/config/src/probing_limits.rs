//! Limits of the axes in a probing move (PRB-3).
//!
//! Invariant: no acceleration is above that of the axis in any other move; velocities are those of the axes. Limits
//! that passed the check fit a card.

use crate::axis::{AxisConfig, refuse};
use crate::numbered_error::NumberedError;
use crate::rate_limits::{StoppingTimes, rate_limits};
use crate::value_range::within;

/// Acceleration and jerk of probing moves, as the machine file names them, and how the machine stops with them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbingLimits {
    /// Highest acceleration in mm/s² (degrees/s²); `None` for that of each axis. An axis whose own is lower keeps it.
    acceleration_mm_per_s2: Option<f64>,
    /// Highest jerk in mm/s³ (degrees/s³), of all axes; `None` for that of each axis. An axis uses no more than builds
    /// up its acceleration within a control period: more would shorten no stop.
    jerk_mm_per_s3: Option<f64>,
    /// Share of acceleration and jerk that the plan of a probing move leaves to the stop behind a touch.
    pub(crate) reserve: f64,
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
        let limited = limited_axes(axes, period_s, acceleration_mm_per_s2, jerk_mm_per_s3);
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
    pub(crate) fn axes(&self, axes: &[AxisConfig], period_s: f64) -> Vec<AxisConfig> {
        limited_axes(axes, period_s, self.acceleration_mm_per_s2, self.jerk_mm_per_s3)
    }
}

fn limited_axes(
    axes: &[AxisConfig],
    period_s: f64,
    acceleration_mm_per_s2: Option<f64>,
    jerk_mm_per_s3: Option<f64>,
) -> Vec<AxisConfig> {
    let mut axes = axes.to_vec();
    for axis in &mut axes {
        let acceleration = acceleration_mm_per_s2.unwrap_or(f64::INFINITY).min(axis.max_acceleration_mm_per_s2);
        let jerk = jerk_mm_per_s3.map_or(axis.max_jerk_mm_per_s3, |jerk| jerk.min(acceleration / period_s));
        (axis.max_acceleration_mm_per_s2, axis.max_jerk_mm_per_s3) = (acceleration, jerk);
    }
    axes
}
