//! Exact geometry of a programmed move: lines, and arcs and helices with linear motion of the other axes.
//!
//! Invariant: a curve's parameter s is the length along its linear axes in mm (the first three axes; all axes where
//! those do not move); `at(0)` is its start and `at(length)` its end, to the rounding of an f64.

use crate::error::MoveError;

/// Circular arc or helix, as the canonical function `ARC_FEED` describes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc<const A: usize> {
    /// The two axes of the plane, from 0, both axes of the machine and different. Counterclockwise turns the first
    /// towards the second.
    pub plane: [usize; 2],
    /// Centre in the plane, absolute, mm.
    pub centre_mm: [f64; 2],
    /// Direction and number of turns, not 0: positive is counterclockwise, negative clockwise. ±1 is at most one full
    /// turn; each further 1 adds a full turn. At most ±1 000 000.
    pub rotation: i32,
    /// End position of all axes, absolute, mm or degrees. Axes outside the plane move linearly.
    pub end_mm: [f64; A],
}

impl<const A: usize> Arc<A> {
    /// Direction from the centre to `start_mm`, and the angle from there to the end of the arc, both in radians.
    ///
    /// The direction is in −π … π; the angle is positive counterclockwise. Where start and end have the same direction,
    /// the arc is a full circle.
    ///
    /// # Panics
    /// Where an axis of the plane is not an axis of the machine.
    #[must_use]
    pub fn sweep(&self, start_mm: &[f64; A]) -> (f64, f64) {
        let direction = |point: &[f64; A]| {
            let [p, q] = self.plane;
            (point[q] - self.centre_mm[1]).atan2(point[p] - self.centre_mm[0])
        };
        let full = std::f64::consts::TAU;
        let (from, sign) = (direction(start_mm), f64::from(self.rotation.signum()));
        let mut sweep = sign * (direction(&self.end_mm) - from);
        if sweep <= 1e-9 {
            sweep += full;
        }
        if sweep <= 1e-9 {
            sweep += full;
        }
        (from, sign * (sweep + full * f64::from(self.rotation.unsigned_abs().saturating_sub(1))))
    }
}

/// Coefficients of a cubic in s for every axis, constant first.
pub(crate) type Cubic<const A: usize> = [[f64; A]; 4];

/// Position along a move as a function of s: a cubic, plus a rotating radius for an arc.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Curve<const A: usize> {
    cubic: Cubic<A>,
    circle: Option<Circle>,
}

/// Vector of length `radius` in the direction `angle + turn·s` in a plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Circle {
    pub(crate) plane: [usize; 2],
    pub(crate) radius: f64,
    pub(crate) angle: f64,
    /// Radians per mm.
    pub(crate) turn: f64,
}

/// First, second and third derivative of the position by s, for each axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Derivatives<const A: usize> {
    pub(crate) first: [f64; A],
    pub(crate) second: [f64; A],
    pub(crate) third: [f64; A],
}

/// Largest difference between the radii at start and end of an arc, in mm and as a share of the radius.
const RADIUS_SLACK: (f64, f64) = (0.01, 0.01);

/// Length over the linear axes, or over all axes where those do not move.
fn length_of<const A: usize>(displacement: [f64; A]) -> f64 {
    let norm = |axes: &[f64]| axes.iter().map(|x| x * x).sum::<f64>().sqrt();
    let linear = norm(&displacement[..A.min(3)]);
    if linear > 1e-9 { linear } else { norm(&displacement) }
}

impl<const A: usize> Curve<A> {
    /// Line from `start` to `end`, and its length in mm.
    pub(crate) fn line(start: [f64; A], end: [f64; A]) -> (Self, f64) {
        let displacement: [f64; A] = std::array::from_fn(|i| end[i] - start[i]);
        let length = length_of(displacement);
        let rate = displacement.map(|x| x / length.max(f64::MIN_POSITIVE));
        (Self { cubic: [start, rate, [0.0; A], [0.0; A]], circle: None }, length)
    }

    /// Arc from `start`, and its length in mm. Where the end is a little off the circle, the path drifts there evenly.
    ///
    /// # Errors
    /// E4003 where start and end are not on one circle, E4004 where the plane or the rotation is not valid.
    pub(crate) fn arc(start: [f64; A], arc: &Arc<A>) -> Result<(Self, f64), MoveError> {
        let [p, q] = arc.plane;
        if p >= A || q >= A || p == q || arc.rotation == 0 || arc.rotation.unsigned_abs() > 1_000_000 {
            return Err(MoveError::ArcPlane);
        }
        let from = [start[p] - arc.centre_mm[0], start[q] - arc.centre_mm[1]];
        let to = [arc.end_mm[p] - arc.centre_mm[0], arc.end_mm[q] - arc.centre_mm[1]];
        let (start_mm, end_mm) = (from[0].hypot(from[1]), to[0].hypot(to[1]));
        let radius_error = (end_mm - start_mm).abs();
        if start_mm < 1e-6 || radius_error > RADIUS_SLACK.0.max(RADIUS_SLACK.1 * start_mm).min(0.5 * start_mm) {
            return Err(MoveError::ArcRadius { start_mm, end_mm });
        }
        let (angle, sweep) = arc.sweep(&start);
        let mut displacement: [f64; A] = std::array::from_fn(|i| arc.end_mm[i] - start[i]);
        (displacement[p], displacement[q]) = (start_mm * sweep, 0.0);
        let length = length_of(displacement);
        let (sin, cos) = (angle + sweep).sin_cos();
        // The difference between the end of the circle and the programmed end.
        displacement[p] = arc.end_mm[p] - (arc.centre_mm[0] + start_mm * cos);
        displacement[q] = arc.end_mm[q] - (arc.centre_mm[1] + start_mm * sin);
        let mut base = start;
        (base[p], base[q]) = (arc.centre_mm[0], arc.centre_mm[1]);
        let circle = Circle { plane: arc.plane, radius: start_mm, angle, turn: sweep / length };
        let curve = Self { cubic: [base, displacement.map(|x| x / length), [0.0; A], [0.0; A]], circle: Some(circle) };
        Ok((curve, length))
    }

    /// The curve from `s` on, with `correction` added to it.
    pub(crate) fn corrected(&self, s: f64, correction: &Cubic<A>) -> Self {
        let [a, b, c, d] = &self.cubic;
        let [value, first, second, third] = correction;
        let cubic = [
            std::array::from_fn(|i| value[i] + a[i] + s * (b[i] + s * (c[i] + s * d[i]))),
            std::array::from_fn(|i| first[i] + b[i] + s * (2.0 * c[i] + 3.0 * s * d[i])),
            std::array::from_fn(|i| second[i] + c[i] + 3.0 * s * d[i]),
            std::array::from_fn(|i| third[i] + d[i]),
        ];
        Self { cubic, circle: self.circle.map(|circle| Circle { angle: circle.angle + circle.turn * s, ..circle }) }
    }

    /// Position at `s`.
    #[inline]
    pub(crate) fn at(&self, s: f64) -> [f64; A] {
        let [a, b, c, d] = &self.cubic;
        let mut at: [f64; A] = std::array::from_fn(|i| a[i] + s * (b[i] + s * (c[i] + s * d[i])));
        if let Some(Circle { plane: [p, q], radius, angle, turn }) = self.circle {
            let (sin, cos) = (angle + turn * s).sin_cos();
            at[p] += radius * cos;
            at[q] += radius * sin;
        }
        at
    }

    /// Derivatives at `s`.
    pub(crate) fn derivatives(&self, s: f64) -> Derivatives<A> {
        let [_, b, c, d] = &self.cubic;
        let mut all = Derivatives {
            first: std::array::from_fn(|i| b[i] + s * (2.0 * c[i] + 3.0 * s * d[i])),
            second: std::array::from_fn(|i| 2.0 * c[i] + 6.0 * s * d[i]),
            third: std::array::from_fn(|i| 6.0 * d[i]),
        };
        if let Some(Circle { plane: [p, q], radius, angle, turn }) = self.circle {
            let (sin, cos) = (angle + turn * s).sin_cos();
            let (one, two, three) = (radius * turn, radius * turn * turn, radius * turn * turn * turn);
            all.first[p] -= one * sin;
            all.first[q] += one * cos;
            all.second[p] -= two * cos;
            all.second[q] -= two * sin;
            all.third[p] += three * sin;
            all.third[q] -= three * cos;
        }
        all
    }

    /// Bounds on the absolute derivatives over 0 … `length`.
    pub(crate) fn bounds(&self, length: f64) -> Derivatives<A> {
        let [_, b, c, d] = &self.cubic;
        let mut all = Derivatives { first: [0.0; A], second: [0.0; A], third: [0.0; A] };
        for i in 0..A {
            let first = |s: f64| (b[i] + s * (2.0 * c[i] + 3.0 * s * d[i])).abs();
            let turning = if d[i] == 0.0 { 0.0 } else { (-c[i] / (3.0 * d[i])).clamp(0.0, length) };
            all.first[i] = first(0.0).max(first(length)).max(first(turning));
            all.second[i] = (2.0 * c[i]).abs().max((2.0 * c[i] + 6.0 * length * d[i]).abs());
            all.third[i] = (6.0 * d[i]).abs();
        }
        if let Some(Circle { plane, radius, turn, .. }) = self.circle {
            let turn = turn.abs();
            for i in plane {
                all.first[i] += radius * turn;
                all.second[i] += radius * turn * turn;
                all.third[i] += radius * turn * turn * turn;
            }
        }
        all
    }

    /// The cubic, and the circle that is added to it.
    pub(crate) fn parts(&self) -> (&Cubic<A>, Option<&Circle>) {
        (&self.cubic, self.circle.as_ref())
    }

    /// Whether the curve is a straight line.
    pub(crate) fn is_line(&self) -> bool {
        self.circle.is_none() && self.cubic[2] == [0.0; A] && self.cubic[3] == [0.0; A]
    }

    /// The curve from `s` on.
    pub(crate) fn from(&self, s: f64) -> Self {
        self.corrected(s, &[[0.0; A]; 4])
    }

    /// Whether the curve is a pure arc. In one, the tangential and the centripetal part of a derivative are never both
    /// at their bound in one axis.
    pub(crate) fn is_arc(&self) -> bool {
        self.circle.is_some() && self.cubic[2] == [0.0; A] && self.cubic[3] == [0.0; A]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close<const A: usize>(a: [f64; A], b: [f64; A], tolerance: f64) -> bool {
        a.iter().zip(b).all(|(x, y)| (x - y).abs() <= tolerance)
    }

    #[test]
    fn arcs_turn_in_the_direction_and_as_often_as_given() {
        let turn = |end: [f64; 3], rotation| {
            let arc = Arc { plane: [0, 1], centre_mm: [0.0, 0.0], rotation, end_mm: end };
            let (curve, length) = Curve::arc([10.0, 0.0, 0.0], &arc).expect("valid");
            assert!(close(curve.at(0.0), [10.0, 0.0, 0.0], 1e-12) && close(curve.at(length), end, 1e-12));
            (length / (10.0 * std::f64::consts::PI), curve.at(0.25 * length)[1] > 0.0)
        };
        let near = |(a, up): (f64, bool), (b, up2): (f64, bool)| (a - b).abs() < 1e-9 && up == up2;
        assert!(near(turn([0.0, 10.0, 0.0], 1), (0.5, true)));
        assert!(near(turn([0.0, 10.0, 0.0], -1), (1.5, false)));
        assert!(near(turn([10.0, 0.0, 0.0], 1), (2.0, true)));
        assert!(near(turn([10.0, 0.0, 0.0], -1), (2.0, false)));
        assert!((turn([-10.0, 0.0, 0.0], 3).0 - 5.0).abs() < 1e-9);
        assert!((turn([-10.0, 0.0, 0.0], -2).0 - 3.0).abs() < 1e-9);
    }

    #[test]
    fn an_invalid_arc_is_refused_by_number() {
        let number = |arc: Arc<3>| Curve::arc([10.0, 0.0, 0.0], &arc).map(|_| ()).unwrap_err().number();
        let arc = Arc { plane: [0, 1], centre_mm: [0.0, 0.0], rotation: 1, end_mm: [0.0, 10.5, 0.0] };
        assert_eq!(number(arc), "E4003");
        assert_eq!(number(Arc { centre_mm: [10.0, 0.0], ..arc }), "E4003");
        assert_eq!(number(Arc { plane: [1, 1], ..arc }), "E4004");
        assert_eq!(number(Arc { plane: [1, 3], ..arc }), "E4004");
        assert_eq!(number(Arc { rotation: 0, ..arc }), "E4004");
    }

    #[test]
    fn derivatives_are_those_of_the_position_and_keep_the_bounds() {
        let arc = Arc { plane: [2, 0], centre_mm: [1.0, 2.0], rotation: -2, end_mm: [2.0, 7.0, 4.0, 90.0] };
        let (curve, length) = Curve::arc([5.0, 1.0, 1.0, 0.0], &arc).expect("valid");
        let (h, bounds) = (1e-3, curve.bounds(length));
        for k in 1..100 {
            let s = length * f64::from(k) / 100.0;
            let (d, p) = (curve.derivatives(s), [-2.0, -1.0, 1.0, 2.0].map(|x| curve.at(s + x * h)));
            let mid = curve.at(s);
            for i in 0..4 {
                assert!(((p[2][i] - p[1][i]) / (2.0 * h) - d.first[i]).abs() < 1e-6);
                assert!(((p[2][i] - 2.0 * mid[i] + p[1][i]) / (h * h) - d.second[i]).abs() < 1e-6);
                let third = (p[3][i] - 2.0 * p[2][i] + 2.0 * p[1][i] - p[0][i]) / (2.0 * h * h * h);
                assert!((third - d.third[i]).abs() < 1e-4, "{third} {}", d.third[i]);
                assert!(d.first[i].abs() <= bounds.first[i] + 1e-12 && d.second[i].abs() <= bounds.second[i] + 1e-12);
                assert!(d.third[i].abs() <= bounds.third[i] + 1e-12);
            }
        }
        let linear: f64 = curve.derivatives(1.0).first[..3].iter().map(|x| x * x).sum();
        assert!((linear - 1.0).abs() < 1e-12);
    }
}
