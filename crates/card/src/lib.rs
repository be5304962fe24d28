//! The player (design, idea 3): what runs on every retrace card, simulated or on a microcontroller.
//!
//! The card holds a window of the recorded path around its cursor and plays it at the rate it is told, forward and backward.
//! It executes switching instructions between the motion and output actions in passing, and counts every pulse.
//!
//! Invariant: what the card does not hold it cannot run; at the ends of its window it comes to rest exactly.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

mod actions;
mod player;
mod switching;
mod window;

pub use actions::ActionTable;
pub use player::Player;
pub use switching::Switching;
pub use window::Window;
