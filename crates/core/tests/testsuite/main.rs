//! The integration tests of `retrace-core`, in one binary, which links once.

mod braking;
mod drive;
mod records;
