//! The simulated machine: the card crate itself, with a clock and pulse counters around it.
//!
//! Invariant: the counts it reports are counted pulse by pulse behind the fine interpolation, not copied from the player.
#![forbid(unsafe_code)]

mod clock;
mod pulses;
mod sim;

pub use clock::Clock;
pub use pulses::PulseCounters;
pub use sim::{SimCard, WINDOW};
