//! Program lines along a path.
//!
//! Invariant: marks are in the order of their places.

/// From `place` on, in mm from the start of a segment or piece, the program line is `tag`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LineMark {
    pub(crate) place: f64,
    pub(crate) tag: u32,
}
