//! Rigorous bounds on the acceleration and jerk of each axis under a speed law.
//!
//! Where b = v² is a quadratic of the place s, the acceleration of an axis is q″b + ½q′b′, and its jerk over the speed
//! is q‴b + ³⁄₂q″b′ + ½q′b″. Both are polynomials of s on a cubic, and rotate with the angle on a circle. A polynomial
//! lies between its least and greatest coefficient in Bernstein form, and a vector that rotates by an angle between its
//! ends, and no further beyond than its length times 1 − cos of half the angle.
//!
//! Invariant: a bound is never below the true value, and above it by the square of the length of the part at most.

use crate::curve::Circle;
use crate::speed_law::law_path::LawPart;

/// A quadratic by the place, in Bernstein form.
pub(crate) type Quadratic = [f64; 3];

/// The part from `t` to `u`, both 0 … 1, of a quadratic.
pub(crate) fn clipped([a, b, c]: Quadratic, t: f64, u: f64) -> Quadratic {
    // The blossom: bilinear, and the quadratic itself where both arguments are equal.
    let at = |t: f64, u: f64| (1.0 - t) * ((1.0 - u) * a + u * b) + t * ((1.0 - u) * b + u * c);
    [at(t, t), at(t, u), at(u, u)]
}

/// Largest share of the acceleration and of the jerk of an axis that motion with speed² `b` over `part` uses.
pub(crate) fn largest_shares<const A: usize>(part: &LawPart<A>, b: Quadratic) -> (f64, f64) {
    let h = part.length;
    // b′ and b″, and twice the sums that are needed.
    let (slope, bend) =
        ([2.0 * (b[1] - b[0]) / h, 2.0 * (b[2] - b[1]) / h], 2.0 * (b[0] - 2.0 * b[1] + b[2]) / (h * h));
    let (cubic, circle) = part.curve.parts();
    let (mut most_a, mut most_j) = (0.0f64, 0.0f64);
    for (i, (&limit_a, &limit_j)) in part.a.iter().zip(&part.j).enumerate() {
        let [_, c1, c2, c3] = cubic.each_ref().map(|of_axes| of_axes[i]);
        // Bernstein forms of q′ (degree 2), q″ (degree 1); q‴ is constant.
        let first = [c1, c1 + c2 * h, c1 + 2.0 * c2 * h + 3.0 * c3 * h * h];
        let second = [2.0 * c2, 2.0 * c2 + 6.0 * c3 * h];
        let third = 6.0 * c3;
        let mut acceleration = [0.0; 4];
        let by_slope = times_linear(first, slope);
        let by_speed = times_linear(b, second);
        for k in 0..4 {
            acceleration[k] = by_speed[k] + 0.5 * by_slope[k];
        }
        let product = [second[0] * slope[0], 0.5 * (second[0] * slope[1] + second[1] * slope[0]), second[1] * slope[1]];
        let jerk: Quadratic = std::array::from_fn(|k| third * b[k] + 1.5 * product[k] + 0.5 * first[k] * bend);
        let (a, g) = match circle.and_then(|circle| Some((circle, circle.plane.iter().position(|&axis| axis == i)?))) {
            None => (acceleration.map(f64::abs), jerk.map(f64::abs)),
            Some((circle, axis)) => rotating(circle, axis, h, (b, slope, bend), (acceleration, jerk)),
        };
        most_a = most_a.max(a.into_iter().fold(0.0, f64::max) / limit_a);
        most_j = most_j.max(largest_jerk(g, b) / limit_j);
    }
    (most_a, most_j)
}

/// Bounds of the coefficients where the axis is one of a circle's, on which the vectors rotate.
fn rotating(
    circle: &Circle,
    axis: usize,
    h: f64,
    (b, slope, bend): (Quadratic, [f64; 2], f64),
    (acceleration, jerk): ([f64; 4], Quadratic),
) -> ([f64; 4], Quadratic) {
    let turn = circle.turn;
    let (one, two) = (circle.radius * turn, circle.radius * turn * turn);
    // Along the tangent and towards the centre; elevated to the degree of the polynomials.
    let elevated = elevate(b);
    let tangent_a = elevate([0.5 * slope[0], 0.25 * (slope[0] + slope[1]), 0.5 * slope[1]]);
    let ends = [circle.angle, circle.angle + turn * h].map(|angle| {
        let (sin, cos) = angle.sin_cos();
        // Directions of tangent and of the way to the centre, in this axis.
        if axis == 0 { [-sin, -cos] } else { [cos, -sin] }
    });
    let beyond = 1.0 - (0.5 * turn * h).cos();
    let bound = |polynomial: f64, along: f64, across: f64| {
        let at = |[t, n]: [f64; 2]| (polynomial + along * t + across * n).abs();
        at(ends[0]).max(at(ends[1])) + beyond * along.hypot(across)
    };
    let a = std::array::from_fn(|k| bound(acceleration[k], one * tangent_a[k], two * elevated[k]));
    let middle = 0.5 * (slope[0] + slope[1]);
    let slopes = [slope[0], middle, slope[1]];
    let g = std::array::from_fn(|k| bound(jerk[k], one * (0.5 * bend - turn * turn * b[k]), 1.5 * two * slopes[k]));
    (a, g)
}

/// The same quadratic as a cubic.
fn elevate([a, b, c]: Quadratic) -> [f64; 4] {
    [a, (a + 2.0 * b) / 3.0, (2.0 * b + c) / 3.0, c]
}

/// Product of a quadratic and a linear function.
fn times_linear([a, b, c]: Quadratic, [l, m]: [f64; 2]) -> [f64; 4] {
    [a * l, (2.0 * b * l + a * m) / 3.0, (c * l + 2.0 * b * m) / 3.0, c * m]
}

/// Bound of g·√b with non-negative coefficients: the root of the largest coefficient of g²·b.
fn largest_jerk([x, y, z]: Quadratic, [p, q, r]: Quadratic) -> f64 {
    let square = [x * x, x * y, (x * z + 2.0 * y * y) / 3.0, y * z, z * z];
    let [s0, s1, s2, s3, s4] = square;
    let product = [
        s0 * p,
        (s0 * q + 2.0 * s1 * p) / 3.0,
        (s0 * r + 8.0 * s1 * q + 6.0 * s2 * p) / 15.0,
        (s1 * r + 3.0 * s2 * q + s3 * p) / 5.0,
        (6.0 * s2 * r + 8.0 * s3 * q + s4 * p) / 15.0,
        (2.0 * s3 * r + s4 * q) / 3.0,
        s4 * r,
    ];
    product.into_iter().fold(0.0, f64::max).sqrt()
}
