//! Modes of canonical functions: unit of length, plane, path control, feed mode, probing.
//!
//! Invariant: each is one value of a canonical function, independent of the others.

use crate::pose::Axis;

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LengthUnit {
    /// Inch, 25.4 mm.
    Inch,
    /// Millimetre.
    Millimetre,
}

impl LengthUnit {
    /// Returns the length of one unit in millimetres.
    #[must_use]
    pub const fn millimetres(self) -> f64 {
        match self {
            LengthUnit::Inch => 25.4,
            LengthUnit::Millimetre => 1.0,
        }
    }
}

/// A plane of arcs, with its axes in the order that [`Canon::ArcFeed`](crate::Canon::ArcFeed) uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plane {
    /// G17: first X, second Y, normal Z.
    Xy,
    /// G18: first Z, second X, normal Y.
    Zx,
    /// G19: first Y, second Z, normal X.
    Yz,
    /// G17.1: U and V. Arcs in this plane are not possible.
    Uv,
    /// G18.1: W and U. Arcs in this plane are not possible.
    Wu,
    /// G19.1: V and W. Arcs in this plane are not possible.
    Vw,
}

impl Plane {
    /// Returns the first, second and normal axis.
    #[must_use]
    pub const fn axes(self) -> [Axis; 3] {
        match self {
            Plane::Xy => [Axis::X, Axis::Y, Axis::Z],
            Plane::Zx => [Axis::Z, Axis::X, Axis::Y],
            Plane::Yz => [Axis::Y, Axis::Z, Axis::X],
            Plane::Uv => [Axis::U, Axis::V, Axis::W],
            Plane::Wu => [Axis::W, Axis::U, Axis::V],
            Plane::Vw => [Axis::V, Axis::W, Axis::U],
        }
    }

    /// The number of the G code that selects this plane.
    #[must_use]
    pub const fn g_code(self) -> f64 {
        match self {
            Plane::Xy => 17.0,
            Plane::Zx => 18.0,
            Plane::Yz => 19.0,
            Plane::Uv => 17.1,
            Plane::Wu => 18.1,
            Plane::Vw => 19.1,
        }
    }

    /// Whether arcs are possible in this plane.
    #[must_use]
    pub const fn has_arcs(self) -> bool {
        matches!(self, Plane::Xy | Plane::Zx | Plane::Yz)
    }
}

/// Treatment of junctions between blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathControl {
    /// G61: exactly along the path, stopping only where necessary.
    ExactPath,
    /// G61.1: a full stop at the end of each block.
    ExactStop,
    /// G64: blended. The deviation is at most the tolerance, or 0 where the program names none.
    Continuous {
        /// Blend tolerance in program units, at least 0.
        tolerance: f64,
    },
}

/// Meaning of the feed rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeedMode {
    /// G93: F is the inverse of the duration of the block in minutes.
    InverseTime,
    /// G94: units per minute.
    UnitsPerMinute,
    /// G95: units per turn of the spindle.
    UnitsPerRevolution,
}

/// Condition that ends a probing move, and whether it is an error if it does not occur.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Probing {
    /// Whether loss of contact ends the move (G38.4, G38.5); otherwise contact does.
    pub away: bool,
    /// Whether it is an error to reach the end of the move (G38.2, G38.4).
    pub must_trip: bool,
}
