//! The integration tests of `retrace-link`, in one binary, which links once.

mod decoder;
mod dice;
mod ends;
mod frames;
mod wire;
