//! A part of the plan between two junctions.
//!
//! Invariant: `first < last`.

use crate::profile::Profile;

/// Profile between two junctions of a path.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Span {
    /// Junction at its start.
    pub(crate) first: usize,
    /// Junction at its end.
    pub(crate) last: usize,
    pub(crate) profile: Profile,
}
