//! Which way the spindle turns, and what must be known to switch it.
//!
//! Invariant: a [`SpindleTurn`] is a turning spindle; one that stands still has none.

use crate::canon::Canon;
use crate::modal::SpindleRotation;

/// Which way a turning spindle turns, seen from it towards the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpindleTurn {
    /// M3.
    Clockwise,
    /// M4.
    Counterclockwise,
}

impl SpindleTurn {
    /// The other way round.
    #[must_use]
    pub const fn opposite(self) -> SpindleTurn {
        match self {
            SpindleTurn::Clockwise => SpindleTurn::Counterclockwise,
            SpindleTurn::Counterclockwise => SpindleTurn::Clockwise,
        }
    }

    /// How it is told.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            SpindleTurn::Clockwise => "clockwise (M3)",
            SpindleTurn::Counterclockwise => "counter-clockwise (M4)",
        }
    }

    /// The call that makes it turn so.
    #[must_use]
    pub const fn start(self) -> Canon {
        match self {
            SpindleTurn::Clockwise => Canon::StartSpindleClockwise,
            SpindleTurn::Counterclockwise => Canon::StartSpindleCounterclockwise,
        }
    }
}

impl SpindleRotation {
    /// Which way it turns, if it does.
    #[must_use]
    pub const fn turn(self) -> Option<SpindleTurn> {
        match self {
            SpindleRotation::Stopped => None,
            SpindleRotation::Clockwise => Some(SpindleTurn::Clockwise),
            SpindleRotation::Counterclockwise => Some(SpindleTurn::Counterclockwise),
        }
    }
}
