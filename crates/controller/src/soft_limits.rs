//! The soft limits of the axes: which one a point or an arc exceeds.
//!
//! Invariant: rounding by less than a micrometre exceeds no limit.

use retrace_config::{AxisConfig, MachineConfig};
use retrace_motion::Arc;

use crate::check_finding::CheckFinding;

/// Excess beyond a soft limit that counts as rounding, mm.
const SLACK_MM: f64 = 1e-6;

/// A move that would leave the soft limits.
#[derive(Clone, Debug, PartialEq)]
pub struct LimitFinding {
    /// Letter of the axis.
    pub axis: char,
    /// Coordinate that the axis would reach, mm.
    pub position_mm: f64,
    /// Limit that it would pass, mm.
    pub limit_mm: f64,
    /// Program line.
    pub line: u32,
}

impl LimitFinding {
    pub(crate) const NUMBER: &'static str = "E4304";
    pub(crate) const REMEDY: &'static str =
        "move the work offset, correct the program, or widen `travel_mm` in the machine file";

    /// The first axis whose soft limits a point exceeds, of those selected by `concerned`.
    pub(crate) fn find<const A: usize>(
        machine: &MachineConfig,
        point: &[f64; A],
        concerned: impl Fn(usize) -> bool,
        line: u32,
    ) -> Option<Self> {
        let axes = machine.axes.iter().zip(point).enumerate().filter(|(index, _)| concerned(*index));
        axes.filter_map(|(_, (axis, &position_mm))| {
            let limit_mm = passed_limit(axis, position_mm)?;
            Some(Self { axis: axis.name, position_mm, limit_mm, line })
        })
        .next()
    }

    pub(crate) fn what(&self) -> String {
        let Self { axis, position_mm, limit_mm, .. } = self;
        let axis = axis.to_ascii_uppercase();
        format!("axis {axis} would go to {position_mm:.3} mm, beyond its soft limit at {limit_mm:.3} mm")
    }

    /// The error as a finding.
    #[must_use]
    pub fn finding(&self) -> CheckFinding {
        CheckFinding {
            line: self.line,
            word: Some(self.axis.to_ascii_uppercase()),
            number: Self::NUMBER,
            cause: self.what(),
            remedy: Self::REMEDY.into(),
            more_rounds: 0,
        }
    }
}

/// The soft limit of the axis that lies before this coordinate, if any, mm.
pub(crate) fn passed_limit(axis: &AxisConfig, x: f64) -> Option<f64> {
    let [least, greatest] = axis.travel_mm;
    if x < least - SLACK_MM {
        Some(least)
    } else if x > greatest + SLACK_MM {
        Some(greatest)
    } else {
        None
    }
}

/// Points of an arc where an axis of its plane reverses: the quarter points that it passes.
pub(crate) fn extremes<const A: usize>(start: &[f64; A], arc: &Arc<A>) -> Vec<[f64; A]> {
    use std::f64::consts::{FRAC_PI_2, TAU};
    let ([p, q], [cp, cq]) = (arc.plane, arc.centre_mm);
    let radius = (start[p] - cp).hypot(start[q] - cq);
    let (from, sweep) = arc.sweep(start);
    let mut points = Vec::new();
    for quarter in 0..4 {
        let towards = f64::from(quarter) * FRAC_PI_2;
        if (sweep.signum() * (towards - from)).rem_euclid(TAU) <= sweep.abs() {
            let mut point = arc.end_mm;
            point[p] = cp + radius * towards.cos();
            point[q] = cq + radius * towards.sin();
            points.push(point);
        }
    }
    points
}
