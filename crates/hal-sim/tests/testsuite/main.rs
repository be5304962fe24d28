//! The integration tests of `retrace-hal-sim`, in one binary, which links once.

mod epochs;
mod line;
mod replay;
mod rig;
mod threads;
mod trace;
