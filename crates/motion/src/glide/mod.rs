//! Glides: corners that are passed while the motion on one track fades out and that on the next one fades in (SMO-1 …
//! SMO-7).
//!
//! - `tracks`: two adjacent tracks, and the limits of a glide between them;
//! - `ramp_pair`: a glide is two ramps of constant jerk in cells, superposed in time;
//! - `optimum`: the glide that saves most time, by linear programs (`simplex`);
//! - `glide_cache`: glides that were found before;
//! - `source`: the glide of a set ratio, as the source defines it;
//! - `glide_segment`: a glide at its corner, as it is interpolated.
//!
//! Invariant: a glide stays within every limit and the tolerance, and a glide of the default method never takes longer
//! than a stop in the corner.

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
    /// The fastest way that is found: an optimised glide or rounding, whichever is faster. Never slower than a stop.
    #[default]
    Optimum,
    /// The source's glide of this ratio; where there is no space for it, as `Optimum` without glides.
    Source(GlideRatio),
}
