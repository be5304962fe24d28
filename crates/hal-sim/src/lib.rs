//! The simulated machine: the card crate itself, with a clock and pulse counters around it.
//!
//! Invariant: the counts it reports are counted pulse by pulse behind the fine interpolation, not copied from the player.
#![forbid(unsafe_code)]

mod clock;
mod faults;
mod line;
mod pulses;
mod random;
mod sim;

pub use clock::Clock;
pub use faults::{Fault, Rates, Tally};
pub use line::{Leftover, Line, LineSettings};
pub use pulses::PulseCounters;
pub use random::{Chance, Random};
pub use sim::{SimCard, WINDOW};
