//! A piece of a chain in normalised coordinates: cutting runs towards -u, the free side is +v.
//!
//! Invariant: along a piece u never grows, and v either never falls or never rises. An arc is within one quadrant of
//! its circle, and is neither flat nor upright.

use super::Point;
use super::curve::Curve;

/// Differences below this count as zero: far below any machine, far above the noise of the arithmetic.
pub(super) const TINY: f64 = 1e-9;

/// Curvature of a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Bend {
    Straight,
    /// An arc that is convex on the free side: its centre is below.
    Over {
        centre: Point,
        radius: f64,
    },
    /// An arc that is concave on the free side: its centre is above.
    Under {
        centre: Point,
        radius: f64,
    },
}

/// A line or an arc from one point to the next along the cut direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Piece {
    pub from: Point,
    pub to: Point,
    pub bend: Bend,
    /// Line of the contour's source.
    pub line: u32,
}

impl Piece {
    pub(super) fn straight(from: Point, to: Point, line: u32) -> Self {
        Self { from, to, bend: Bend::Straight, line }
    }

    /// Returns the same piece, straight where it is so short that its curvature is lost in the last digit.
    pub(super) fn settled(self) -> Self {
        let bend = if self.is_flat() || self.is_upright() { Bend::Straight } else { self.bend };
        Self { bend, ..self }
    }

    pub(super) fn rises(&self) -> bool {
        self.to.v > self.from.v
    }

    pub(super) fn falls(&self) -> bool {
        self.to.v < self.from.v
    }

    pub(super) fn is_flat(&self) -> bool {
        self.to.v == self.from.v
    }

    pub(super) fn is_nothing(&self) -> bool {
        self.from.distance(self.to) <= TINY
    }

    pub(super) fn is_upright(&self) -> bool {
        self.from.u - self.to.u <= TINY
    }

    /// Returns the whole line or circle of the piece.
    pub(super) fn curve(&self) -> Curve {
        match self.bend {
            Bend::Straight => Curve::Line { through: self.from, along: self.to.minus(self.from) },
            Bend::Over { centre, radius } | Bend::Under { centre, radius } => Curve::Circle { centre, radius },
        }
    }

    /// Returns the height at a place; for an upright piece the height of its higher end.
    pub(super) fn height(&self, u: f64) -> f64 {
        let (low, high) = (self.from.v.min(self.to.v), self.from.v.max(self.to.v));
        // The ends are returned exactly, so that a chain stays joined whatever the rounding in between.
        let height = if self.is_upright() {
            high
        } else if u >= self.from.u {
            self.from.v
        } else if u <= self.to.u {
            self.to.v
        } else {
            let share = |centre: Point, radius: f64| {
                let across = u - centre.u;
                ((radius - across) * (radius + across)).max(0.0).sqrt()
            };
            match self.bend {
                Bend::Straight => {
                    self.from.v + (self.to.v - self.from.v) * ((self.from.u - u) / (self.from.u - self.to.u))
                }
                Bend::Over { centre, radius } => centre.v + share(centre, radius),
                Bend::Under { centre, radius } => centre.v - share(centre, radius),
            }
        };
        height.clamp(low, high)
    }

    /// Returns the point of the piece at a height between those of its ends.
    pub(super) fn at_height(&self, v: f64) -> Point {
        if v == self.from.v {
            return self.from;
        }
        if v == self.to.v {
            return self.to;
        }
        let u = match self.bend {
            Bend::Straight => self.from.u + (self.to.u - self.from.u) * ((v - self.from.v) / (self.to.v - self.from.v)),
            Bend::Over { centre, radius } | Bend::Under { centre, radius } => {
                let up = v - centre.v;
                let across = ((radius - up) * (radius + up)).max(0.0).sqrt();
                let right = self.from.u + self.to.u >= 2.0 * centre.u;
                centre.u + if right { across } else { -across }
            }
        };
        Point::new(u.clamp(self.to.u, self.from.u), v)
    }

    /// Returns the part before a point of it.
    pub(super) fn until(&self, to: Point) -> Self {
        Self { to, ..*self }
    }

    /// Returns the part after a point of it.
    pub(super) fn after(&self, from: Point) -> Self {
        Self { from, ..*self }
    }

    pub(super) fn shifted(&self, by: Point) -> Self {
        let bend = match self.bend {
            Bend::Straight => Bend::Straight,
            Bend::Over { centre, radius } => Bend::Over { centre: centre.plus(by), radius },
            Bend::Under { centre, radius } => Bend::Under { centre: centre.plus(by), radius },
        };
        Self { from: self.from.plus(by), to: self.to.plus(by), bend, line: self.line }
    }

    /// Returns the direction of travel at a point of it.
    pub(super) fn heading(&self, at: Point) -> Point {
        match self.bend {
            Bend::Straight => self.to.minus(self.from).unit(),
            Bend::Over { centre, .. } => at.minus(centre).rotate_left().unit(),
            Bend::Under { centre, .. } => centre.minus(at).rotate_left().unit(),
        }
    }

    /// Returns the point after this share of the piece, and the direction to the free side there.
    pub(super) fn sample(&self, share: f64) -> (Point, Point) {
        let chord = self.from.plus(self.to.minus(self.from).times(share));
        let at = match self.bend {
            Bend::Straight => chord,
            Bend::Over { centre, radius } | Bend::Under { centre, radius } => {
                centre.plus(chord.minus(centre).unit().times(radius))
            }
        };
        // Travelling towards -u, the free side is on the right.
        (at, self.heading(at).rotate_left().times(-1.0))
    }
}
