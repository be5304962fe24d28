//! Conversion between the plane and normalised coordinates: u along the cut, v along the infeed, the free side +v,
//! cutting towards -u.
//!
//! Invariant: `out` reverses `into` exactly, since both only swap axes and change signs.

use super::{MoveKind, Point};

/// Rotation and mirroring of the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    /// Whether the cuts run along the second axis.
    pub face: bool,
    /// Sign of the cut axis.
    pub cut: f64,
    /// Sign of the infeed axis.
    pub infeed: f64,
}

impl Frame {
    pub(super) fn into(self, at: Point) -> Point {
        let (cut, infeed) = if self.face { (at.v, at.u) } else { (at.u, at.v) };
        Point::new(cut * self.cut, infeed * self.infeed)
    }

    pub(super) fn out(self, at: Point) -> Point {
        let (cut, infeed) = (at.u * self.cut, at.v * self.infeed);
        if self.face { Point::new(infeed, cut) } else { Point::new(cut, infeed) }
    }

    /// Whether a left turn becomes a right turn.
    pub(super) fn mirrors(self) -> bool {
        (self.cut * self.infeed < 0.0) != self.face
    }

    /// Returns the arc of the plane that is counterclockwise, or clockwise, in normalised coordinates.
    pub(super) fn arc(self, counterclockwise: bool) -> MoveKind {
        if counterclockwise != self.mirrors() { MoveKind::Counterclockwise } else { MoveKind::Clockwise }
    }
}
