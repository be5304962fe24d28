//! How fast an axis is jogged.
//!
//! Invariant: a jog is never faster than the jog speed of its axis.

/// Speed of a jog.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum JogSpeed {
    /// The jog speed of the axis.
    #[default]
    Full,
    /// A tenth of it, to come close to an edge.
    Slow,
}

impl JogSpeed {
    /// The part of the jog speed.
    #[must_use]
    pub const fn share(self) -> f64 {
        match self {
            Self::Full => 1.0,
            Self::Slow => 0.1,
        }
    }
}
