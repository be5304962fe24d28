//! Direction of the spindle, and the canonical functions that switch it.
//!
//! Invariant: a [`SpindleTurn`] is a turning spindle; a stopped one has none.

use crate::canon::Canon;
use crate::modal_groups::SpindleRotation;

/// Direction of a turning spindle, seen from it towards the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpindleTurn {
    /// M3.
    Clockwise,
    /// M4.
    Counterclockwise,
}

impl SpindleTurn {
    /// Returns the opposite direction.
    #[must_use]
    pub const fn opposite(self) -> SpindleTurn {
        match self {
            SpindleTurn::Clockwise => SpindleTurn::Counterclockwise,
            SpindleTurn::Counterclockwise => SpindleTurn::Clockwise,
        }
    }

    /// Returns the name for messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            SpindleTurn::Clockwise => "clockwise (M3)",
            SpindleTurn::Counterclockwise => "counter-clockwise (M4)",
        }
    }

    /// Returns the canonical function that starts the spindle in this direction.
    #[must_use]
    pub const fn start(self) -> Canon {
        match self {
            SpindleTurn::Clockwise => Canon::StartSpindleClockwise(0),
            SpindleTurn::Counterclockwise => Canon::StartSpindleCounterclockwise(0),
        }
    }
}

impl SpindleRotation {
    /// Returns the canonical function that switches the spindle of this number so.
    #[must_use]
    pub const fn canon(self, spindle: u8) -> Canon {
        match self {
            SpindleRotation::Clockwise => Canon::StartSpindleClockwise(spindle),
            SpindleRotation::Counterclockwise => Canon::StartSpindleCounterclockwise(spindle),
            SpindleRotation::Stopped => Canon::StopSpindleTurning(spindle),
        }
    }

    /// Returns the direction, if the spindle turns.
    #[must_use]
    pub const fn turn(self) -> Option<SpindleTurn> {
        match self {
            SpindleRotation::Stopped => None,
            SpindleRotation::Clockwise => Some(SpindleTurn::Clockwise),
            SpindleRotation::Counterclockwise => Some(SpindleTurn::Counterclockwise),
        }
    }
}
