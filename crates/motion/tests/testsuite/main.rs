//! The integration tests of `retrace-motion`, in one binary, which links once.

mod cases;
mod common;
mod corners;
mod feed_override;
mod feed_shares;
mod look_ahead;
mod marks;
mod plan;
mod record_count;
mod refinement;
mod solver;
mod source_glide;
mod whole_periods;
