//! Glides: corners passed by letting the motion on one track die away while that on the next one begins (SMO-1 … SMO-7).
//!
//! - `tracks`: two adjacent tracks, and what a glide between them may do;
//! - `ramp`: a glide is two ramps of constant jerk in cells, superposed in time;
//! - `optimum`: the glide that saves most time, by linear programs (`simplex`);
//! - `book`: glides that were found already;
//! - `passage`: a glide in its place, as it is interpolated.
//!
//! Invariant: a glide keeps every limit and the tolerance, and never takes longer than a stop in the corner.

pub(crate) mod book;
pub(crate) mod optimum;
pub(crate) mod passage;
pub(crate) mod ramp;
mod simplex;
pub(crate) mod tracks;
