//! A piece of path, and what speed the axes allow along it.
//!
//! Invariant: motion along a piece within its path limits keeps every axis within its planned velocity, acceleration and
//! jerk, less the share of the jerk that is left to the joints at its ends.

use crate::curve::{Curve, Derivatives};
use crate::limits::AxisLimits;
use crate::profile::PathLimits;

/// A piece of path that is moved along in one go.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece<const A: usize> {
    pub(crate) curve: Curve<A>,
    /// Length in mm, above 0.
    pub(crate) length: f64,
    /// Highest speed asked for, mm/s.
    pub(crate) feed: f64,
    /// Program line.
    pub(crate) tag: u32,
    /// Bounds on the derivatives.
    pub(crate) bounds: Derivatives<A>,
    /// The way from the piece before it into this one is not smooth.
    pub(crate) rough_entry: bool,
}

/// Shares of acceleration and jerk, least first, that tangential motion gets on a curve; the rest is for the curvature.
const TANGENTIAL: [f64; 5] = [0.35, 0.5, 0.65, 0.8, 0.9];

/// How a joint may be passed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Joint {
    /// Cap on the speed, mm/s; 0 for a stop.
    pub(crate) v: f64,
    /// Share of the jerk that the pieces on both sides leave to it.
    pub(crate) share: f64,
}

impl Joint {
    /// A full stop.
    pub(crate) const STOP: Self = Self { v: 0.0, share: 0.0 };
    /// No jump at all.
    pub(crate) const SMOOTH: Self = Self { v: f64::MAX, share: 0.0 };
}

impl<const A: usize> Piece<A> {
    pub(crate) fn new(curve: Curve<A>, length: f64, feed: f64, tag: u32) -> Self {
        Self { curve, length, feed, tag, bounds: curve.bounds(length), rough_entry: false }
    }

    /// Path limits along the piece when `share` of the jerk is left to its joints.
    pub(crate) fn limits(&self, axes: &AxisLimits<A>, share: f64) -> PathLimits {
        let mut want = self.feed.min(axes.path_v);
        for i in 0..A {
            want = want.min(axes.v[i] / self.bounds.first[i].max(1e-12));
        }
        if self.bounds.second.iter().all(|&d| d == 0.0) {
            return self.with_tangential(axes, share, 1.0, want);
        }
        let mut best = PathLimits { v: 0.0, a: 0.0, j: 0.0 };
        for tangential in TANGENTIAL {
            let limits = self.with_tangential(axes, share, tangential, want);
            if best.v == 0.0 || limits.v >= 0.98 * want {
                best = limits;
            }
        }
        best
    }

    /// Path limits where tangential motion gets the share `tangential` of each axis' acceleration and jerk.
    fn with_tangential(&self, axes: &AxisLimits<A>, share: f64, tangential: f64, want: f64) -> PathLimits {
        let mut limits = PathLimits { v: want, a: f64::MAX, j: f64::MAX };
        let d = &self.bounds;
        // Each axis leaves the joint's share; an acceleration seen over one period may be off by what the jerk does in it.
        let a_of = |i: usize| axes.a[i] - share * axes.j[i] * axes.period;
        let j_of = |i: usize| (1.0 - share) * axes.j[i];
        for i in 0..A {
            let first = d.first[i].max(1e-12);
            limits.a = limits.a.min(tangential * a_of(i) / first);
            limits.j = limits.j.min(tangential * j_of(i) / first);
        }
        for i in 0..A {
            if d.second[i] == 0.0 {
                continue;
            }
            let a_along = d.first[i] * limits.a;
            let a_left = if self.curve.is_arc() {
                (a_of(i) * a_of(i) - a_along * a_along).max(0.0).sqrt()
            } else {
                (a_of(i) - a_along).max(0.0)
            };
            limits.v = limits.v.min((a_left / d.second[i]).sqrt());
            let j_left = (j_of(i) - d.first[i] * limits.j).max(0.0);
            limits.v = limits.v.min(speed_within(d.third[i], 3.0 * d.second[i] * limits.a, j_left));
        }
        limits
    }
}

/// The largest v with `cubic·v³ + linear·v ≤ most`, or a little less; all are at least 0.
fn speed_within(cubic: f64, linear: f64, most: f64) -> f64 {
    let alone = |x: f64| if x > 0.0 { x } else { f64::MAX };
    let mut v = alone((most / cubic).cbrt()).min(alone(most / linear));
    if v.is_nan() || v >= f64::MAX {
        return if most > 0.0 { f64::MAX } else { 0.0 };
    }
    for _ in 0..3 {
        let excess = cubic * v * v * v + linear * v - most;
        v -= excess / (3.0 * cubic * v * v + linear);
    }
    // Newton came from above; the chord from 0 ends below the root, because the function is convex.
    let above = cubic * v * v * v + linear * v;
    if above > most { v * most / above } else { v }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::Limits;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_speed_within_a_cubic_is_its_root_from_below(c in 0.0..1e6f64, l in 0.0..1e6f64, m in 1e-3..1e6f64) {
            prop_assume!(c + l > 1e-3);
            let v = speed_within(c, l, m);
            prop_assert!(c * v * v * v + l * v <= m * (1.0 + 1e-12));
            prop_assert!(c * v * v * v + l * v >= 0.9 * m);
        }
    }

    #[test]
    fn a_diagonal_line_is_faster_than_an_axis_and_a_small_circle_slower() {
        let axes = Limits::<3>::built_in().planned();
        let (curve, length) = Curve::line([0.0; 3], [10.0, 10.0, 0.0]);
        let limits = Piece::new(curve, length, 1e9, 1).limits(&axes, 0.0);
        assert!((limits.a - 900.0 * 2f64.sqrt()).abs() < 1e-9 && (limits.v - 100.0).abs() < 1e-9);
        let arc = crate::Arc { plane: [0, 1], centre_mm: [0.0, 1.0], rotation: 1, end_mm: [0.0, 0.0, 0.0] };
        let (curve, length) = Curve::arc([0.0; 3], &arc).expect("valid");
        let limits = Piece::new(curve, length, 1e9, 1).limits(&axes, 0.0);
        assert!(limits.v < 30.0 && limits.v > 5.0 && limits.a > 0.3 * 900.0, "{limits:?}");
    }
}
