//! Exact geometry of a programmed move: lines, and arcs and helices with linear motion of the other axes.
//!
//! Invariant: a curve's parameter s is the length along its linear axes in mm (the first three axes; all axes where those stand
//! still); `at(0)` is its start and `at(length)` its end, to the rounding of an f64.

use crate::error::MoveError;

/// A circular arc or helix, as the canonical function ARC_FEED describes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc<const A: usize> {
    /// The two axes of the plane, from 0, in the order in which counterclockwise turns the first towards the second.
    pub plane: [usize; 2],
    /// Centre in the plane, absolute, mm.
    pub centre_mm: [f64; 2],
    /// Above 0 counterclockwise, below 0 clockwise; ±1 is at most one full turn, each further 1 a full turn more.
    pub rotation: i32,
    /// Where all axes end; those outside the plane move linearly.
    pub end_mm: [f64; A],
}

/// Position along a move as a function of s.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Curve<const A: usize> {
    Line {
        start: [f64; A],
        direction: [f64; A],
    },
    /// `base + rate·s`, and in the plane `radius` in the direction `angle + turn·s` besides.
    Arc {
        base: [f64; A],
        rate: [f64; A],
        plane: [usize; 2],
        radius: f64,
        angle: f64,
        /// Radians per mm.
        turn: f64,
    },
}

/// First, second and third derivative of the position by s, per axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Derivatives<const A: usize> {
    pub(crate) first: [f64; A],
    pub(crate) second: [f64; A],
    pub(crate) third: [f64; A],
}

/// Ends of an arc may lie this far from one circle, in mm and as a share of its radius.
const RADIUS_SLACK: (f64, f64) = (0.01, 0.01);

/// Length over the linear axes, or over all axes where those stand still.
fn length_of<const A: usize>(way: [f64; A]) -> f64 {
    let norm = |axes: &[f64]| axes.iter().map(|x| x * x).sum::<f64>().sqrt();
    let linear = norm(&way[..A.min(3)]);
    if linear > 1e-9 { linear } else { norm(&way) }
}

impl<const A: usize> Curve<A> {
    /// A line and its length in mm.
    pub(crate) fn line(start: [f64; A], end: [f64; A]) -> (Self, f64) {
        let way: [f64; A] = std::array::from_fn(|i| end[i] - start[i]);
        let length = length_of(way);
        (Self::Line { start, direction: way.map(|x| x / length.max(f64::MIN_POSITIVE)) }, length)
    }

    /// An arc and its length in mm. Where the end lies a little off the circle, the path drifts there evenly.
    ///
    /// # Errors
    /// E4003 where start and end are not on one circle, E4004 for a plane or rotation that is none.
    pub(crate) fn arc(start: [f64; A], arc: &Arc<A>) -> Result<(Self, f64), MoveError> {
        let [p, q] = arc.plane;
        if p >= A || q >= A || p == q || arc.rotation == 0 || arc.rotation.unsigned_abs() > 1_000_000 {
            return Err(MoveError::ArcPlane);
        }
        let from = [start[p] - arc.centre_mm[0], start[q] - arc.centre_mm[1]];
        let to = [arc.end_mm[p] - arc.centre_mm[0], arc.end_mm[q] - arc.centre_mm[1]];
        let (start_mm, end_mm) = (from[0].hypot(from[1]), to[0].hypot(to[1]));
        let off = (end_mm - start_mm).abs();
        if start_mm < 1e-6 || off > RADIUS_SLACK.0.max(RADIUS_SLACK.1 * start_mm).min(0.5 * start_mm) {
            return Err(MoveError::ArcRadius { start_mm, end_mm });
        }
        let angle = from[1].atan2(from[0]);
        let mut sweep = to[1].atan2(to[0]) - angle;
        let full = std::f64::consts::TAU;
        // From the direction alone a full circle and no motion look alike; it is a full circle.
        if arc.rotation > 0 {
            sweep += if sweep <= 1e-9 { full } else { 0.0 } + full * f64::from(arc.rotation - 1);
            sweep += if sweep <= 1e-9 { full } else { 0.0 };
        } else {
            sweep -= if sweep >= -1e-9 { full } else { 0.0 } + full * f64::from(-1 - arc.rotation);
            sweep -= if sweep >= -1e-9 { full } else { 0.0 };
        }
        let mut way: [f64; A] = std::array::from_fn(|i| arc.end_mm[i] - start[i]);
        (way[p], way[q]) = (start_mm * sweep, 0.0);
        let length = length_of(way);
        let (sin, cos) = (angle + sweep).sin_cos();
        // What is left between the end of the circle and the programmed end.
        way[p] = arc.end_mm[p] - (arc.centre_mm[0] + start_mm * cos);
        way[q] = arc.end_mm[q] - (arc.centre_mm[1] + start_mm * sin);
        let mut base = start;
        (base[p], base[q]) = (arc.centre_mm[0], arc.centre_mm[1]);
        let curve = Self::Arc {
            base,
            rate: way.map(|x| x / length),
            plane: arc.plane,
            radius: start_mm,
            angle,
            turn: sweep / length,
        };
        Ok((curve, length))
    }

    /// The position at s.
    #[inline]
    pub(crate) fn at(&self, s: f64) -> [f64; A] {
        match self {
            Self::Line { start, direction } => std::array::from_fn(|i| start[i] + direction[i] * s),
            Self::Arc { base, rate, plane, radius, angle, turn } => {
                let mut at: [f64; A] = std::array::from_fn(|i| base[i] + rate[i] * s);
                let (sin, cos) = (angle + turn * s).sin_cos();
                at[plane[0]] += radius * cos;
                at[plane[1]] += radius * sin;
                at
            }
        }
    }

    /// The derivatives at s.
    pub(crate) fn derivatives(&self, s: f64) -> Derivatives<A> {
        let mut d = Derivatives { first: [0.0; A], second: [0.0; A], third: [0.0; A] };
        match self {
            Self::Line { direction, .. } => d.first = *direction,
            Self::Arc { rate, plane, radius, angle, turn, .. } => {
                let ([p, q], (sin, cos)) = (*plane, (angle + turn * s).sin_cos());
                let (one, two, three) = (radius * turn, radius * turn * turn, radius * turn * turn * turn);
                d.first = *rate;
                d.first[p] -= one * sin;
                d.first[q] += one * cos;
                (d.second[p], d.second[q]) = (-two * cos, -two * sin);
                (d.third[p], d.third[q]) = (three * sin, -three * cos);
            }
        }
        d
    }

    /// Bounds on the absolute derivatives over the whole curve.
    pub(crate) fn bounds(&self) -> Derivatives<A> {
        let mut d = self.derivatives(0.0);
        if let Self::Arc { rate, plane, radius, turn, .. } = self {
            let (radius, turn) = (radius.abs(), turn.abs());
            for &i in plane {
                d.first[i] = rate[i].abs() + radius * turn;
                d.second[i] = radius * turn * turn;
                d.third[i] = radius * turn * turn * turn;
            }
        }
        Derivatives { first: d.first.map(f64::abs), second: d.second, third: d.third }
    }

    /// In an arc the tangential and the centripetal part of a derivative are never both at their bound in one axis.
    pub(crate) fn is_arc(&self) -> bool {
        matches!(self, Self::Arc { .. })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close<const A: usize>(a: [f64; A], b: [f64; A], tolerance: f64) -> bool {
        a.iter().zip(b).all(|(x, y)| (x - y).abs() <= tolerance)
    }

    #[test]
    fn arcs_turn_the_way_and_as_often_as_they_are_told() {
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
    fn an_arc_that_is_none_is_refused_by_number() {
        let number = |arc: Arc<3>| Curve::arc([10.0, 0.0, 0.0], &arc).map(|_| ()).unwrap_err().number();
        let arc = Arc { plane: [0, 1], centre_mm: [0.0, 0.0], rotation: 1, end_mm: [0.0, 10.5, 0.0] };
        assert_eq!(number(arc), 4003);
        assert_eq!(number(Arc { centre_mm: [10.0, 0.0], ..arc }), 4003);
        assert_eq!(number(Arc { plane: [1, 1], ..arc }), 4004);
        assert_eq!(number(Arc { plane: [1, 3], ..arc }), 4004);
        assert_eq!(number(Arc { rotation: 0, ..arc }), 4004);
    }

    #[test]
    fn derivatives_are_those_of_the_position_and_keep_the_bounds() {
        let arc = Arc { plane: [2, 0], centre_mm: [1.0, 2.0], rotation: -2, end_mm: [2.0, 7.0, 4.0, 90.0] };
        let (curve, length) = Curve::arc([5.0, 1.0, 1.0, 0.0], &arc).expect("valid");
        let (h, bounds) = (1e-3, curve.bounds());
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
