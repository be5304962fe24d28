//! Cutter radius compensation as a mode: side, radius, and programmed position.
//!
//! Invariant: the radius is not negative; a negative diameter has swapped the side instead.

use crate::canon_modes::Plane;
use crate::pose::Pose;

/// A point of the plane of compensation: its first and its second axis.
pub(crate) type Point = (f64, f64);

/// No shift. Unlike zero, −0 does not change the sign of a zero.
pub(crate) const UNSHIFTED: Point = (-0.0, -0.0);

/// Side of the path on which the tool is, seen in the direction of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// G41.
    Left,
    /// G42.
    Right,
}

impl Side {
    /// Returns the opposite side.
    #[must_use]
    pub const fn other(self) -> Side {
        match self {
            Side::Left => Side::Right,
            Side::Right => Side::Left,
        }
    }
}

/// Cutter radius compensation in force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compensation {
    /// Side of the tool.
    pub side: Side,
    /// Radius of the tool in program units. With 0, moves stay unchanged.
    pub radius: f64,
    /// Programmed position in program coordinates. `None` before the first move, which leads to the compensated path.
    pub programmed: Option<Pose>,
}

impl Compensation {
    /// Converts to another unit of length.
    pub(crate) fn scale(&mut self, factor: f64) {
        self.radius *= factor;
        self.programmed = self.programmed.map(|programmed| programmed.scaled_lengths(factor));
    }
}

/// Returns the vector from the centre of a lathe tool's tip to its controlled point, on the first and second axis of
/// the plane of compensation. Orientations are those of LinuxCNC's tool table; they have a meaning in G18 only.
pub(crate) fn tip_shift(plane: Plane, orientation: i32, radius: f64) -> Point {
    if plane != Plane::Zx {
        return UNSHIFTED;
    }
    let along_z = match orientation {
        2 | 3 | 7 => -radius,
        1 | 4 | 5 => radius,
        _ => -0.0,
    };
    let along_x = match orientation {
        1 | 2 | 6 => -radius,
        3 | 4 | 8 => radius,
        _ => -0.0,
    };
    (along_z, along_x)
}
