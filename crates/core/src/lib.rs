//! The parts of retrace that exactness and order depend on.
//!
//! Contents: motion records ([`record`]), the ring that stores them ([`ring`]), playback ([`playback`]), the rate law
//! ([`rate`], [`drive`]), operating modes ([`mode`], [`interruption`]), gates ([`gate`]) and sizes ([`size`]).
//!
//! ```text
//!             history                    look-ahead
//!  head ──────────────────── reached ──────────────── write
//!         ◄── reverse │ forward ──►       │ normal run ──►
//!                   cursor = Place { record, fraction }
//! ```
//!
//! The planner appends records at `write`. The [`drive::Drive`] moves the cursor over the records at a signed rate, and
//! [`playback::emission`] gives the pulses between two places. Pulses depend on the places alone, so a path that is run
//! backward and forward again ends at the same counts.
//!
//! The crate is `no_std` and depends on nothing; it allocates nothing, but for the cells of a host's ring (feature
//! `alloc`). Pulses are integers, places and rates are
//! fixed-point numbers; nothing here calculates in floating point.
#![cfg_attr(not(test), no_std)]

pub mod drive;
pub mod fine;
pub mod gate;
pub mod gear;
pub mod interruption;
pub mod limits;
pub mod mode;
pub mod place;
pub mod playback;
pub mod rate;
pub mod record;
pub mod ring;
pub mod ring_indices;
#[cfg(feature = "alloc")]
pub mod ring_storage;
pub mod size;
mod sync;
mod units;
pub mod wheel;

pub use place::{Place, RecordIndex};
pub use rate::RateTarget;
pub use record::{FeedShare, Flags, RapidCap, Record};
pub use units::{Distance, Rate};
