//! A piece of path, and the speed that the axes allow along it.
//!
//! Invariant: motion along a piece within its path limits keeps every axis within its planned velocity, acceleration
//! and jerk, less the share of the jerk that is left to the junctions at its ends.

use crate::accel_split::{GENTLE, LONG, LimitOptions, RETAINED_SPEED, TANGENTIAL};
use crate::curve::{Curve, Derivatives};
use crate::limits::AxisLimits;
use crate::profile::PathLimits;

/// Requested speed of rapid motion: as fast as the axes can.
pub(crate) const RAPID: f64 = f64::MAX;

/// A piece of path with uniform limits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathPiece<const A: usize> {
    pub(crate) curve: Curve<A>,
    /// Length, mm, above 0.
    pub(crate) length: f64,
    /// Highest requested speed, mm/s.
    pub(crate) feed: f64,
    /// Program line at its start.
    pub(crate) tag: u32,
    /// Number of marks of further program lines that belong to it.
    pub(crate) marks: u32,
    /// Bounds on the derivatives.
    pub(crate) bounds: Derivatives<A>,
    /// Whether the path from the piece before it into this one is not smooth.
    pub(crate) rough_entry: bool,
    /// Share of the jerk that is left to the junctions at its ends.
    pub(crate) share: f64,
    /// Cap on the speed at its end, mm/s.
    pub(crate) exit_v: f64,
}

/// How a junction may be passed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PieceJunction {
    /// Cap on the speed, mm/s; 0 for a stop.
    pub(crate) v: f64,
    /// Share of the jerk that the pieces on both sides leave to it.
    pub(crate) share: f64,
}

impl PieceJunction {
    /// A full stop.
    pub(crate) const STOP: Self = Self { v: 0.0, share: 0.0 };
    /// No jump at all.
    pub(crate) const SMOOTH: Self = Self { v: f64::MAX, share: 0.0 };
}

impl<const A: usize> PathPiece<A> {
    pub(crate) fn new(curve: Curve<A>, length: f64, feed: f64, tag: u32) -> Self {
        let bounds = curve.bounds(length);
        Self { curve, length, feed, tag, marks: 0, bounds, rough_entry: false, share: 0.0, exit_v: f64::MAX }
    }

    /// Whether the piece is rapid motion.
    pub(crate) fn is_rapid(&self) -> bool {
        self.feed == RAPID
    }

    /// Path limits to choose from along the piece when its feed is multiplied by `factor`.
    pub(crate) fn limit_options(&self, axes: &AxisLimits<A>, factor: f64) -> LimitOptions {
        let share = self.share;
        let (mut want, mut a, mut j) = ((factor * self.feed).min(axes.path_v), f64::MAX, f64::MAX);
        for i in 0..A {
            let per_first = self.bounds.first[i].max(1e-12).recip();
            want = want.min(axes.v[i] * per_first);
            a = a.min(remaining_acceleration(axes, share, i) * per_first);
            j = j.min(remaining_jerk(axes, share, i) * per_first);
        }
        if self.bounds.second.iter().all(|&d| d == 0.0) {
            let limits = PathLimits { v: want, a, j };
            return LimitOptions { v: want, gentle: GENTLE * a, calm: limits, rough: limits };
        }
        let most = self.speed(axes, share, along((a, j), TANGENTIAL[0]), want);
        let at_least = |part: f64| {
            let allowed = |&&shares: &&(f64, f64)| self.allows(axes, share, along((a, j), shares), part * most);
            let shares = TANGENTIAL.iter().rev().find(allowed).unwrap_or(&TANGENTIAL[0]);
            let (a, j) = along((a, j), *shares);
            PathLimits { v: self.speed(axes, share, (a, j), most), a, j }
        };
        let rough = at_least(if self.length > LONG * most { RETAINED_SPEED.2 } else { RETAINED_SPEED.1 });
        // Where nothing was given up, nothing can be gained.
        let calm = if rough.v >= RETAINED_SPEED.0 * most { rough } else { at_least(RETAINED_SPEED.0) };
        LimitOptions { v: most, gentle: GENTLE * a, calm, rough }
    }

    /// Highest speed that feed and velocities of the axes allow when the feed is multiplied by `factor`, mm/s, and the
    /// acceleration and jerk of each axis that the junctions at its ends leave.
    pub(crate) fn axis_limits(&self, axes: &AxisLimits<A>, factor: f64) -> (f64, [f64; A], [f64; A]) {
        let feed = (factor * self.feed).min(axes.path_v);
        let v = (0..A).fold(feed, |v, i| v.min(axes.v[i] / self.bounds.first[i].max(1e-12)));
        let a = std::array::from_fn(|i| remaining_acceleration(axes, self.share, i));
        (v, a, std::array::from_fn(|i| remaining_jerk(axes, self.share, i)))
    }

    /// Acceleration and jerk of axis `i` that tangential motion (a, j) leaves.
    fn remaining(&self, axes: &AxisLimits<A>, share: f64, (a, j): (f64, f64), i: usize) -> (f64, f64) {
        let (a_all, j_all, first) =
            (remaining_acceleration(axes, share, i), remaining_jerk(axes, share, i), self.bounds.first[i]);
        let along = first * a;
        let across = if self.curve.is_arc() { (a_all * a_all - along * along).max(0.0).sqrt() } else { a_all - along };
        (across.max(0.0), (j_all - first * j).max(0.0))
    }

    /// Whether speed `v` is within the limits with tangential acceleration and jerk `along`.
    fn allows(&self, axes: &AxisLimits<A>, share: f64, along: (f64, f64), v: f64) -> bool {
        (0..A).all(|i| {
            let (second, third) = (self.bounds.second[i], self.bounds.third[i]);
            let (a, j) = self.remaining(axes, share, along, i);
            v * v * second <= a && v * (v * v * third + 3.0 * second * along.0) <= j
        })
    }

    /// Highest speed up to `v` that is within the limits with tangential acceleration and jerk `along`.
    fn speed(&self, axes: &AxisLimits<A>, share: f64, along: (f64, f64), mut v: f64) -> f64 {
        for i in 0..A {
            let (second, third) = (self.bounds.second[i], self.bounds.third[i]);
            if second > 0.0 || third > 0.0 {
                let (a_across, j_across) = self.remaining(axes, share, along, i);
                if second * v * v > a_across {
                    v = (a_across / second).sqrt();
                }
                v = speed_within(v, third, 3.0 * second * along.0, j_across);
            }
        }
        v
    }
}

/// These shares of acceleration and jerk.
fn along((a, j): (f64, f64), (a_share, j_share): (f64, f64)) -> (f64, f64) {
    (a_share * a, j_share * j)
}

/// Acceleration of axis `i` that remains for a piece whose junctions get `share` of acceleration and jerk. Measured
/// over one period, a junction adds no more than that share, nor more than the share of the jerk does in the period.
fn remaining_acceleration<const A: usize>(axes: &AxisLimits<A>, share: f64, i: usize) -> f64 {
    axes.a[i] - share * axes.a[i].min(axes.j[i] * axes.period)
}

/// Jerk of axis `i` that remains for a piece whose junctions get `share` of it.
fn remaining_jerk<const A: usize>(axes: &AxisLimits<A>, share: f64, i: usize) -> f64 {
    (1.0 - share) * axes.j[i]
}

/// The largest v up to `wanted` with `cubic·v³ + linear·v ≤ most`, or a little less; all are at least 0.
fn speed_within(wanted: f64, cubic: f64, linear: f64, most: f64) -> f64 {
    let used = |v: f64| v * (cubic * v * v + linear);
    if used(wanted) <= most {
        return wanted;
    }
    // Each term alone bounds it from above; NaN, where a term and `most` are 0, is not a bound.
    let mut v = wanted.min(above_root(most / cubic)).min(most / linear);
    for _ in 0..3 {
        v -= (used(v) - most) / (3.0 * cubic * v * v + linear).max(f64::MIN_POSITIVE);
    }
    // Newton's steps came from above; the chord from 0 ends below the root, because the function is convex.
    let above = used(v);
    if above > most { v * most / above } else { v.max(0.0) }
}

/// A bound between the cube root of `x` ≥ 0 and a sixteenth more: the chord over each factor of two between powers of 8
/// (the first guess of FreeBSD's `cbrt`, without its correction).
fn above_root(x: f64) -> f64 {
    if x.is_nan() { x } else { f64::from_bits(x.to_bits() / 3 + (682 << 52)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::MachineLimits;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_guess_at_a_root_is_above_it(size in -200.0..200.0f64) {
            let x = 10f64.powf(size);
            prop_assert!((0.999_999_9..1.0625).contains(&(above_root(x) / x.cbrt())), "{}", above_root(x) / x.cbrt());
        }

        #[test]
        fn the_speed_within_a_cubic_is_its_root_from_below(c in 0.0..1e6f64, l in 0.0..1e6f64, m in 1e-3..1e6f64) {
            prop_assume!(c + l > 1e-3);
            prop_assert_eq!(speed_within(1e-9, c, l, m.max(1.0)), 1e-9);
            let v = speed_within(1e12, c, l, m);
            prop_assert!(c * v * v * v + l * v <= m * (1.0 + 1e-12));
            prop_assert!(c * v * v * v + l * v >= 0.9 * m);
        }
    }

    #[test]
    fn a_diagonal_line_is_faster_than_an_axis_and_a_small_circle_slower() {
        let axes = MachineLimits::<3>::built_in().planned();
        let (curve, length) = Curve::line([0.0; 3], [10.0, 10.0, 0.0]);
        let limits = PathPiece::new(curve, length, 1e9, 1).limit_options(&axes, 1.0).rough;
        assert!((limits.a - 900.0 * 2f64.sqrt()).abs() < 1e-9 && (limits.v - 100.0).abs() < 1e-9);
        let arc = crate::Arc { plane: [0, 1], centre_mm: [0.0, 1.0], rotation: 1, end_mm: [0.0, 0.0, 0.0] };
        let (curve, length) = Curve::arc([0.0; 3], &arc).expect("valid");
        let limits = PathPiece::new(curve, length, 1e9, 1).limit_options(&axes, 1.0).rough;
        assert!(limits.v < 30.0 && limits.v > 20.0 && limits.a >= 0.05 * 900.0, "{limits:?}");
    }
}
