//! Splines: the curves of G5, G5.1 and G5.2 to G5.3.
//!
//! Invariant: a spline has at least as many control points as its order, every weight is above 0, and its curve begins
//! at the first point and ends at the last.

use std::sync::Arc;

/// A control point in the plane of X and Y, in program coordinates and program units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlPoint {
    /// X.
    pub x: f64,
    /// Y.
    pub y: f64,
    /// Weight of the point, above 0. A greater weight draws the curve closer to it.
    pub weight: f64,
}

impl ControlPoint {
    /// Creates a point of weight 1.
    #[must_use]
    pub const fn plain(x: f64, y: f64) -> ControlPoint {
        ControlPoint { x, y, weight: 1.0 }
    }
}

/// A rational B-spline whose knots are evenly spaced and clamped at both ends (LinuxCNC, G5.2 and G5.3).
#[derive(Clone, Debug, PartialEq)]
pub struct Nurbs {
    /// Degree plus one: 3 is quadratic, 4 is cubic.
    pub order: u32,
    /// Control points; the curve begins at the first.
    pub points: Arc<[ControlPoint]>,
}

/// Orders up to this are calculated without allocation.
const USUAL_ORDER: usize = 8;

impl Nurbs {
    /// Returns the number of pieces of the curve between neighbouring knots; each is as smooth as a polynomial.
    #[must_use]
    pub fn spans(&self) -> usize {
        (self.points.len() + 1).saturating_sub(self.order as usize)
    }

    /// Returns the point of the curve at a parameter from 0 to [`Nurbs::spans`], as X and Y.
    #[must_use]
    pub fn at(&self, parameter: f64) -> (f64, f64) {
        let order = self.order.max(1) as usize;
        let last = self.spans().saturating_sub(1);
        // The piece that contains the parameter; the end belongs to the last one.
        let span = (parameter.max(0.0) as usize).min(last);
        let mut usual = [(0.0, 0.0, 0.0); USUAL_ORDER];
        let mut unusual = Vec::new();
        let points = if order <= USUAL_ORDER {
            &mut usual[..order]
        } else {
            unusual.resize(order, (0.0, 0.0, 0.0));
            &mut unusual[..]
        };
        for (held, point) in points.iter_mut().zip(self.points.get(span..).unwrap_or_default()) {
            *held = (point.x * point.weight, point.y * point.weight, point.weight);
        }
        self.draw_together(points, span, parameter);
        let (x, y, weight) = points.last().copied().unwrap_or_default();
        (x / weight, y / weight)
    }

    /// Applies de Boor's algorithm in homogeneous coordinates: the last of the points becomes the one of the curve.
    fn draw_together(&self, points: &mut [(f64, f64, f64)], span: usize, parameter: f64) {
        let degree = points.len().saturating_sub(1);
        for round in 1..=degree {
            for index in (round..=degree).rev() {
                let (from, to) = (self.knot(span + index), self.knot(span + index + degree + 1 - round));
                let share = if to > from { (parameter - from) / (to - from) } else { 0.0 };
                let (before, here) = (points[index - 1], points[index]);
                let mix = |p: f64, q: f64| p + (q - p) * share;
                points[index] = (mix(before.0, here.0), mix(before.1, here.1), mix(before.2, here.2));
            }
        }
    }

    /// Returns knot `index` of as many as there are points plus the order: 0 for the first of them, then rising by one,
    /// then the end.
    fn knot(&self, index: usize) -> f64 {
        let degree = self.order.max(1) as usize - 1;
        index.saturating_sub(degree).min(self.spans()) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spline(order: u32, points: &[(f64, f64, f64)]) -> Nurbs {
        Nurbs { order, points: points.iter().map(|&(x, y, weight)| ControlPoint { x, y, weight }).collect() }
    }

    fn near(found: (f64, f64), wanted: (f64, f64)) -> bool {
        (found.0 - wanted.0).hypot(found.1 - wanted.1) < 1e-12 * (1.0 + wanted.0.hypot(wanted.1))
    }

    proptest! {
        #[test]
        fn a_curve_of_as_many_points_as_its_order_is_beziers(
            p in prop::array::uniform8(-9.0..9.0_f64), t in 0.0..=1.0_f64
        ) {
            let points: Vec<_> = p.chunks(2).map(|pair| (pair[0], pair[1], 1.0)).collect();
            let s = 1.0 - t;
            let shares = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
            let wanted = points.iter().zip(shares).fold((0.0, 0.0), |sum, (point, share)| {
                (sum.0 + point.0 * share, sum.1 + point.1 * share)
            });
            prop_assert!(near(spline(4, &points).at(t), wanted));
        }

        #[test]
        fn it_begins_and_ends_on_its_end_points_and_leaves_no_gap(
            p in prop::collection::vec((-9.0..9.0_f64, -9.0..9.0_f64, 0.1..5.0_f64), 3..14), order in 3_u32..12
        ) {
            let curve = spline(order.min(p.len() as u32), &p);
            let end = curve.spans() as f64;
            prop_assert!(near(curve.at(0.0), (p[0].0, p[0].1)));
            prop_assert!(near(curve.at(end), (p[p.len() - 1].0, p[p.len() - 1].1)));
            for knot in 1..curve.spans() {
                let (before, after) = (curve.at(knot as f64 - 1e-12), curve.at(knot as f64));
                prop_assert!((before.0 - after.0).hypot(before.1 - after.1) < 1e-8);
            }
        }
    }

    /// A quarter of a circle is the textbook example of weights.
    #[test]
    fn weights_make_a_circle() {
        let quarter = spline(3, &[(1.0, 0.0, 1.0), (1.0, 1.0, 0.5_f64.sqrt()), (0.0, 1.0, 1.0)]);
        for step in 0..=10 {
            let (x, y) = quarter.at(f64::from(step) / 10.0);
            assert!((x.hypot(y) - 1.0).abs() < 1e-14);
        }
    }
}
