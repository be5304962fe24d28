//! Errors of limits and of moves, each with the number under which `docs/errors.md` explains it.

use std::fmt;

/// A machine limit that is out of its range, from [`MachineLimits::validate`](crate::MachineLimits::validate).
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LimitError {
    /// E4101: a limit of an axis is not a positive, finite number.
    NotPositive {
        /// Axis, from 0.
        axis: usize,
        /// Name of the limit, such as `jerk`.
        quantity: &'static str,
        /// The number given, in axis units.
        value: f64,
    },
    /// E4102: the axis at full velocity makes more pulses in a control period than a record holds (32 766).
    TooManyPulses {
        /// Axis, from 0.
        axis: usize,
        /// Pulses in a control period.
        pulses: f64,
    },
    /// E4103: the path velocity is not a positive, finite number.
    PathVelocity {
        /// The number given, mm/s.
        value: f64,
    },
    /// E4104: the reserve is outside 0 … 0.9.
    Reserve {
        /// The number given.
        value: f64,
    },
    /// E4105: the control period is outside 0 … 1 s, or 0.
    Period {
        /// The number given, s.
        value: f64,
    },
    /// E4106: the glide ratio is outside 0 … 1, or 0.
    GlideRatio {
        /// The number given.
        value: f64,
    },
}

impl LimitError {
    /// The number under which `docs/errors.md` explains it.
    #[must_use]
    pub const fn number(&self) -> &'static str {
        match self {
            Self::NotPositive { .. } => "E4101",
            Self::TooManyPulses { .. } => "E4102",
            Self::PathVelocity { .. } => "E4103",
            Self::Reserve { .. } => "E4104",
            Self::Period { .. } => "E4105",
            Self::GlideRatio { .. } => "E4106",
        }
    }
}

impl fmt::Display for LimitError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotPositive { axis, quantity, value } => {
                write!(f, "the {quantity} of axis {axis} must be above 0, not {value}")
            }
            Self::TooManyPulses { axis, pulses } => {
                write!(
                    f,
                    "axis {axis} at full velocity makes {pulses} pulses in a control period; a record holds 32766"
                )
            }
            Self::PathVelocity { value } => write!(f, "the path velocity must be above 0 mm/s, not {value}"),
            Self::Reserve { value } => write!(f, "the reserve must be between 0 and 0.9, not {value}"),
            Self::Period { value } => write!(f, "the control period must be above 0 and at most 1 s, not {value}"),
            Self::GlideRatio { value } => write!(f, "the glide ratio must be above 0 and at most 1, not {value}"),
        }
    }
}

impl std::error::Error for LimitError {}

/// A move that cannot be planned; the planner is as it was before.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum MoveError {
    /// E4001: a coordinate, centre or tolerance is not a finite number of at most 10⁶ mm.
    NotFinite,
    /// E4002: the feed or the duration is not a positive, finite number.
    Feed {
        /// The number given, mm/s or s.
        value: f64,
    },
    /// E4003: the start and the end of an arc are not on one circle about its centre, or its radius is 0.
    ArcRadius {
        /// Distance of the start from the centre, mm.
        start_mm: f64,
        /// Distance of the end from the centre, mm.
        end_mm: f64,
    },
    /// E4004: the plane of an arc names an axis that the machine does not have, or one axis twice, or its rotation is
    /// 0.
    ArcPlane,
}

impl MoveError {
    /// The number under which `docs/errors.md` explains it.
    #[must_use]
    pub const fn number(&self) -> &'static str {
        match self {
            Self::NotFinite => "E4001",
            Self::Feed { .. } => "E4002",
            Self::ArcRadius { .. } => "E4003",
            Self::ArcPlane => "E4004",
        }
    }
}

impl fmt::Display for MoveError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => write!(f, "a coordinate of the move is not a finite number within 1000000 mm"),
            Self::Feed { value } => write!(f, "the feed must be above 0, not {value}"),
            Self::ArcRadius { start_mm, end_mm } => {
                write!(f, "the arc starts {start_mm} mm and ends {end_mm} mm from its centre")
            }
            Self::ArcPlane => write!(
                f,
                "the plane of the arc needs two different axes of the machine, and its rotation must not be 0"
            ),
        }
    }
}

impl std::error::Error for MoveError {}
