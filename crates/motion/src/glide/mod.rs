//! Glides: corners passed by letting the motion on one track die away while that on the next one begins (SMO-1 … SMO-7).
//!
//! - `tracks`: two adjacent tracks, and what a glide between them may do;
//! - `ramp`: a glide is two ramps of constant jerk in cells, superposed in time;
//! - `optimum`: the glide that saves most time, by linear programs (`simplex`);
//! - `book`: glides that were found already;
//! - `source`: the glide of a set ratio, as the source has it;
//! - `passage`: a glide in its place, as it is interpolated.
//!
//! Invariant: a glide keeps every limit and the tolerance, and that of the default method never takes longer than a stop in the
//! corner.

use source::GlideRatio;

pub(crate) mod glide_cache;
pub(crate) mod glide_segment;
pub(crate) mod optimum;
pub(crate) mod ramp_pair;
mod simplex;
pub(crate) mod source;
pub(crate) mod tracks;

/// How corners between two lines are passed where blending is allowed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Blending {
    /// As fast as can be found: by an optimised glide or by rounding, whichever is faster, and never slower than a stop.
    #[default]
    Optimum,
    /// By the source's glide of this ratio; where it has no room, as in `Optimum` without glides.
    Source(GlideRatio),
}
