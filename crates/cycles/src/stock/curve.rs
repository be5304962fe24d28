//! Infinite plane curves, and their intersections.
//!
//! Invariant: two curves have at most two intersections; parallel lines, concentric circles and curves that miss each
//! other have none.

use super::Point;

impl Point {
    pub(super) fn plus(self, other: Self) -> Self {
        Self::new(self.u + other.u, self.v + other.v)
    }

    pub(super) fn minus(self, other: Self) -> Self {
        Self::new(self.u - other.u, self.v - other.v)
    }

    pub(super) fn times(self, factor: f64) -> Self {
        Self::new(self.u * factor, self.v * factor)
    }

    pub(super) fn dot(self, other: Self) -> f64 {
        self.u * other.u + self.v * other.v
    }

    /// Returns the cross product, positive where `other` points to the left of this direction.
    pub(super) fn cross(self, other: Self) -> f64 {
        self.u * other.v - self.v * other.u
    }

    pub(super) fn length(self) -> f64 {
        self.u.hypot(self.v)
    }

    /// Rotates by a quarter turn to the left.
    pub(super) fn rotate_left(self) -> Self {
        Self::new(-self.v, self.u)
    }

    /// Returns the same direction with length one; the zero vector stays unchanged.
    pub(super) fn unit(self) -> Self {
        let length = self.length();
        if length > 0.0 { self.times(1.0 / length) } else { self }
    }

    pub(super) fn distance(self, other: Self) -> f64 {
        self.minus(other).length()
    }
}

/// A straight line or a circle, both without ends.
#[derive(Clone, Copy, Debug)]
pub(super) enum Curve {
    Line { through: Point, along: Point },
    Circle { centre: Point, radius: f64 },
}

/// None, one or two points.
pub(super) type Intersections = [Option<Point>; 2];

/// Returns the intersections of two curves.
pub(super) fn intersect(a: Curve, b: Curve) -> Intersections {
    match (a, b) {
        (Curve::Line { through: p, along: d }, Curve::Line { through: q, along: e }) => lines(p, d.unit(), q, e.unit()),
        (Curve::Line { through, along }, Curve::Circle { centre, radius })
        | (Curve::Circle { centre, radius }, Curve::Line { through, along }) => {
            line_and_circle(through, along.unit(), centre, radius)
        }
        (Curve::Circle { centre: c, radius: r }, Curve::Circle { centre: d, radius: s }) => circles(c, r, d, s),
    }
}

fn lines(p: Point, d: Point, q: Point, e: Point) -> Intersections {
    let sine = d.cross(e);
    if sine.abs() < 1e-12 {
        return [None, None];
    }
    [Some(p.plus(d.times(q.minus(p).cross(e) / sine))), None]
}

fn line_and_circle(p: Point, d: Point, centre: Point, radius: f64) -> Intersections {
    let foot = p.plus(d.times(centre.minus(p).dot(d)));
    around(foot, d, radius, foot.distance(centre))
}

fn circles(c: Point, r: f64, d: Point, s: f64) -> Intersections {
    let apart = c.distance(d);
    if apart < 1e-12 {
        return [None, None];
    }
    let towards = d.minus(c).unit();
    // Distance from the first centre to the common chord of both circles.
    let along = (apart + (r - s) * (r + s) / apart) / 2.0;
    around(c.plus(towards.times(along)), towards.rotate_left(), r, along)
}

/// Returns the two ends of a chord whose middle is `away` from the centre of a circle. A chord that just misses the
/// circle touches it.
fn around(middle: Point, along: Point, radius: f64, away: f64) -> Intersections {
    let square = (radius - away) * (radius + away);
    if square < -1e-12 * (1.0 + radius * radius) {
        return [None, None];
    }
    let half = square.max(0.0).sqrt();
    [Some(middle.plus(along.times(half))), Some(middle.minus(along.times(half)))]
}
