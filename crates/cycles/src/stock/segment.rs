//! A line or arc of the contour in plane coordinates, as programmed.
//!
//! Invariant: it has length, and an arc has one radius at both its ends.

use std::f64::consts::TAU;

use super::Point;
use super::curve::Curve;

/// A line, or an arc of at most half a turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    pub start: Point,
    pub end: Point,
    pub arc: Option<Arc>,
    pub line: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Arc {
    pub centre: Point,
    pub counterclockwise: bool,
}

impl Arc {
    /// Returns the angle swept from one point to another in its direction, 0 to a whole turn.
    pub(super) fn sweep(&self, from: Point, to: Point) -> f64 {
        let (a, b) = (from.minus(self.centre), to.minus(self.centre));
        let angle = a.cross(b).atan2(a.dot(b));
        let angle = if self.counterclockwise { angle } else { -angle };
        if angle < 0.0 { angle + TAU } else { angle }
    }
}

impl Segment {
    pub(super) fn length(&self) -> f64 {
        match self.arc {
            None => self.start.distance(self.end),
            Some(arc) => arc.sweep(self.start, self.end) * self.start.distance(arc.centre),
        }
    }

    /// Returns the direction of travel at a point of it.
    pub(super) fn heading(&self, at: Point) -> Point {
        match self.arc {
            None => self.end.minus(self.start).unit(),
            Some(arc) => {
                let left = at.minus(arc.centre).rotate_left().unit();
                if arc.counterclockwise { left } else { left.times(-1.0) }
            }
        }
    }

    /// Returns the curve at this distance to its left; `None` where an arc would have no radius left.
    pub(super) fn offset_curve(&self, left: f64) -> Option<Curve> {
        match self.arc {
            None => {
                let along = self.end.minus(self.start).unit();
                Some(Curve::Line { through: self.start.plus(along.rotate_left().times(left)), along })
            }
            Some(arc) => {
                let inward = if arc.counterclockwise { left } else { -left };
                let radius = self.start.distance(arc.centre) - inward;
                (radius > 0.0).then_some(Curve::Circle { centre: arc.centre, radius })
            }
        }
    }

    /// Returns the point of the whole line or circle nearest to a place.
    pub(super) fn nearest(&self, place: Point) -> Point {
        match self.arc {
            None => {
                let along = self.end.minus(self.start).unit();
                self.start.plus(along.times(place.minus(self.start).dot(along)))
            }
            Some(arc) => arc.centre.plus(place.minus(arc.centre).unit().times(self.start.distance(arc.centre))),
        }
    }

    /// Whether a point of the whole line or circle is between the ends.
    pub(super) fn contains(&self, point: Point) -> bool {
        const SLACK: f64 = 1e-9;
        match self.arc {
            None => {
                let along = self.end.minus(self.start).unit();
                let reach = point.minus(self.start).dot(along);
                (-SLACK..=self.start.distance(self.end) + SLACK).contains(&reach)
            }
            Some(arc) => {
                let (swept, whole) = (arc.sweep(self.start, point), arc.sweep(self.start, self.end));
                swept <= whole + SLACK || swept >= TAU - SLACK
            }
        }
    }

    /// Returns the same segment in the opposite direction.
    pub(super) fn reversed(&self) -> Self {
        let arc = self.arc.map(|arc| Arc { counterclockwise: !arc.counterclockwise, ..arc });
        Self { start: self.end, end: self.start, arc, line: self.line }
    }
}
