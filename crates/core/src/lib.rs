//! Everything retrace's exactness and order rest on: records, the record ring, playback, the rate law, gates and sizes.
//!
//! `no_std`, allocates nothing, depends on nothing. Pulses are integers, places and rates are fixed point; there is no
//! floating point in this crate.
#![cfg_attr(not(test), no_std)]

pub mod drive;
pub mod fine;
pub mod gate;
pub mod interruption;
pub mod limits;
pub mod mode;
pub mod place;
pub mod playback;
pub mod rate;
pub mod record;
pub mod ring;
pub mod ring_indices;
pub mod size;
mod sync;
pub mod wheel;

pub use place::{ONE, Place, Travel};
pub use rate::RateTarget;
pub use record::{Flags, RapidCap, Record};
