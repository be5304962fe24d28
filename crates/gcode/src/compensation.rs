//! Cutter radius compensation as a mode: which side, how far, and how the program has got on with it.
//!
//! Invariant: the radius is not negative; a negative diameter has changed the side instead.

use crate::canon::Plane;
use crate::interp::{Point, UNSHIFTED};
use crate::pose::Pose;

/// On which side of the path the tool is, seen along the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// G41.
    Left,
    /// G42.
    Right,
}

impl Side {
    /// The other one.
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
    /// Where the tool is.
    pub side: Side,
    /// The radius of the tool in program units; with 0, moves stay as they are.
    pub radius: f64,
    /// The position as it is programmed, in program coordinates; none before the first move, which leads to the compensated path.
    pub programmed: Option<Pose>,
}

impl Compensation {
    /// Converts it to another unit of length.
    pub(crate) fn scale(&mut self, factor: f64) {
        self.radius *= factor;
        self.programmed = self.programmed.map(|programmed| programmed.scaled_lengths(factor));
    }
}

/// From the centre of a lathe tool's tip to its controlled point, on the first and second axis of the plane of compensation.
/// Orientations count as LinuxCNC's tool table does; only in G18 do they mean something.
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
