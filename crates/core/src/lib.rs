//! Everything retrace's exactness and order rest on: records, the record ring, playback, the rate law, gates and sizes.
//!
//! `no_std`, allocates nothing, depends on nothing. Pulses are integers, places and rates are fixed point; there is no
//! floating point in this crate.
#![no_std]

pub mod record;

pub use record::{Flags, RapidCap, Record};
