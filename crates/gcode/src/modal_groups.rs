//! The values of modal groups: motion, distance, arc centres, spindle.
//!
//! Invariant: each is one code of its group.

use crate::canon_modes::Probing;
use crate::drilling_cycle::DrillingCycle;

/// Motion modes; G80 is the absence of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionMode {
    /// G0.
    Traverse,
    /// G1.
    Feed,
    /// G2.
    ArcClockwise,
    /// G3.
    ArcCounterclockwise,
    /// G33: synchronised with the spindle.
    SpindleFeed,
    /// G33.1.
    RigidTap,
    /// G76.
    ThreadingCycle,
    /// G73, G74, G81 … G89.
    Cycle(DrillingCycle),
    /// G5; executed once, never a mode in force.
    CubicSpline,
    /// G5.1; executed once, never a mode in force.
    QuadraticSpline,
    /// G5.2.
    ControlPoint,
    /// G5.3; executed once, never a mode in force.
    EndOfPoints,
    /// G38.2 to G38.5.
    Probe(Probing),
}

impl MotionMode {
    /// Returns the notation.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            MotionMode::Traverse => "G0",
            MotionMode::Feed => "G1",
            MotionMode::ArcClockwise => "G2",
            MotionMode::ArcCounterclockwise => "G3",
            MotionMode::SpindleFeed => "G33",
            MotionMode::RigidTap => "G33.1",
            MotionMode::ThreadingCycle => "G76",
            MotionMode::Cycle(cycle) => cycle.name(),
            MotionMode::CubicSpline => "G5",
            MotionMode::QuadraticSpline => "G5.1",
            MotionMode::ControlPoint => "G5.2",
            MotionMode::EndOfPoints => "G5.3",
            MotionMode::Probe(Probing { away: false, must_trip: true }) => "G38.2",
            MotionMode::Probe(Probing { away: false, must_trip: false }) => "G38.3",
            MotionMode::Probe(Probing { away: true, must_trip: true }) => "G38.4",
            MotionMode::Probe(Probing { away: true, must_trip: false }) => "G38.5",
        }
    }

    /// Whether it is G2 or G3.
    #[must_use]
    pub const fn is_arc(self) -> bool {
        matches!(self, MotionMode::ArcClockwise | MotionMode::ArcCounterclockwise)
    }
}

/// Meaning of axis words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DistanceMode {
    /// G90: the end position.
    Absolute,
    /// G91: the distance from the current position.
    Incremental,
}

/// Meaning of the centre words of an arc.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArcCentres {
    /// G90.1: the position of the centre.
    Absolute,
    /// G91.1: the distance from the start.
    Incremental,
}

/// Commanded direction of the spindle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpindleRotation {
    /// M5.
    Stopped,
    /// M3.
    Clockwise,
    /// M4.
    Counterclockwise,
}
