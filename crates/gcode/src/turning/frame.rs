//! The frame in which turning is calculated, and segments in it.
//!
//! Invariant: a frame only mirrors and swaps axes, so that lengths and tangency are those of the program.

/// Length below which a value counts as zero; far below the last printed digit.
pub(super) const TINY: f64 = 1e-9;

/// X and Z of the program.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct XzPoint {
    pub(crate) x: f64,
    pub(crate) z: f64,
}

/// A point of the frame: along the profile, and above it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub(super) a: f64,
    pub(super) h: f64,
}

impl Point {
    pub(super) fn plus(self, by: Point, times: f64) -> Point {
        Point { a: self.a + by.a * times, h: self.h + by.h * times }
    }

    pub(super) fn minus(self, other: Point) -> Point {
        Point { a: self.a - other.a, h: self.h - other.h }
    }

    pub(super) fn distance(self, other: Point) -> f64 {
        (self.a - other.a).hypot(self.h - other.h)
    }

    /// Returns the cross product: above 0 where `other` is to the left.
    pub(super) fn cross(self, other: Point) -> f64 {
        self.a * other.h - self.h * other.a
    }

    pub(super) fn dot(self, other: Point) -> f64 {
        self.a * other.a + self.h * other.h
    }

    pub(super) fn unit(self) -> Point {
        let length = self.a.hypot(self.h);
        Point { a: self.a / length, h: self.h / length }
    }

    /// Rotates by a quarter turn to the left.
    pub(super) fn rotate_left(self) -> Point {
        Point { a: -self.h, h: self.a }
    }
}

/// Mirroring and swapping between program and frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(super) facing: bool,
    /// Signs of `a` and `h`.
    pub(super) along: f64,
    pub(super) above: f64,
}

impl Frame {
    pub(super) fn point(&self, place: XzPoint) -> Point {
        let (a, h) = if self.facing { (place.x, place.z) } else { (place.z, place.x) };
        Point { a: a * self.along, h: h * self.above }
    }

    pub(super) fn place(&self, point: Point) -> XzPoint {
        let (a, h) = (point.a * self.along, point.h * self.above);
        if self.facing { XzPoint { x: a, z: h } } else { XzPoint { x: h, z: a } }
    }

    /// Whether arcs have the opposite direction in the frame.
    pub(super) fn mirrors(&self) -> bool {
        (self.along * self.above < 0.0) != self.facing
    }
}

/// Centre and direction of an arc segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SegmentArc {
    pub(super) centre: Point,
    pub(super) counterclockwise: bool,
}

/// A piece of a path: a line or an arc of less than a full turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    pub(super) from: Point,
    pub(super) to: Point,
    pub(super) arc: Option<SegmentArc>,
    /// Whether the next segment is the rest of the same arc, so that the tool does not end a move between them.
    pub(super) continues: bool,
    /// Element of the profile that it belongs to.
    pub(super) element: usize,
}

impl Segment {
    pub(super) fn line(from: Point, to: Point) -> Segment {
        Segment { from, to, arc: None, continues: false, element: 0 }
    }

    /// Returns the direction of travel at one of its points.
    pub(super) fn direction(&self, at: Point) -> Point {
        match self.arc {
            None => self.to.minus(self.from).unit(),
            Some(arc) => {
                let outward = at.minus(arc.centre).unit();
                if arc.counterclockwise {
                    outward.rotate_left()
                } else {
                    outward.rotate_left().rotate_left().rotate_left()
                }
            }
        }
    }

    /// Returns the angle through which an arc turns up to `to`, 0 to a full turn.
    pub(super) fn sweep(&self, to: Point) -> f64 {
        let Some(arc) = self.arc else { return 0.0 };
        let (from, to) = (self.from.minus(arc.centre), to.minus(arc.centre));
        let turn = from.cross(to).atan2(from.dot(to));
        let turn = if arc.counterclockwise { turn } else { -turn };
        if turn < -TINY { turn + std::f64::consts::TAU } else { turn }
    }

    /// Whether it is an arc that begins at its highest point.
    pub(super) fn begins_at_top(&self) -> bool {
        self.arc.is_some_and(|arc| {
            let radius = self.from.distance(arc.centre);
            (self.from.h - arc.centre.h - radius).abs() < 1e-7
        })
    }

    /// Whether it never moves backward along the profile.
    pub(super) fn is_monotonic(&self) -> bool {
        let forward = |at: Point| self.from.distance(self.to) < TINY || self.direction(at).a >= -1e-6;
        let extremes = match self.arc {
            None => true,
            Some(arc) => {
                let radius = self.from.distance(arc.centre);
                [-radius, radius].iter().all(|offset| {
                    let extreme = Point { a: arc.centre.a + offset, h: arc.centre.h };
                    self.from.distance(extreme) < 1e-6
                        || self.to.distance(extreme) < 1e-6
                        || self.sweep(extreme) > self.sweep(self.to)
                })
            }
        };
        forward(self.from) && forward(self.to) && extremes
    }

    /// Returns the point at this height. The ends must be on both sides of it or at it, without an extreme of height
    /// between them.
    pub(super) fn at_height(&self, height: f64) -> Point {
        let (low, high) = (self.from.h.min(self.to.h), self.from.h.max(self.to.h));
        if height == self.from.h || high - low == 0.0 {
            return self.from;
        }
        match self.arc {
            None => {
                let share = (height - self.from.h) / (self.to.h - self.from.h);
                Point { a: self.from.a + share * (self.to.a - self.from.a), h: height }
            }
            Some(arc) => {
                let radius = self.from.distance(arc.centre);
                let rise = height - arc.centre.h;
                let half = (radius * radius - rise * rise).max(0.0).sqrt();
                let middle = (self.from.a + self.to.a) / 2.0;
                let side = if middle < arc.centre.a { -half } else { half };
                Point { a: arc.centre.a + side, h: height }
            }
        }
    }
}
