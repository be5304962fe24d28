//! The card (design, idea 3): what runs on every retrace card, simulated or on a microcontroller.
//!
//! It holds a window of the recorded path around its cursor and plays it at the rate it is told, forward and backward; it executes
//! switching instructions between the motion and output actions in passing, counts every pulse, homes its axes, watches its
//! inputs and its host, and says on which tick every step pulse begins. What it does not know is bytes: the line's end speaks to it by
//! [`retrace_link::Deck`].
//!
//! Our stop is a stop of category 2 (IEC 60204-1): the motion is brought to rest under control and the power stays on. The card is only
//! told of an emergency stop, which must be wired to cut the power by itself.
//!
//! Invariant: what the card does not hold it cannot run; at the ends of its window it comes to rest exactly.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

mod actions;
mod backlash;
mod card;
mod checked_settings;
mod homing;
mod inputs;
mod linked_card;
mod outputs;
pub mod permit;
mod player;
mod safety_monitor;
mod step_direction;
mod switching;
mod window;

pub use actions::ActionTable;
pub use backlash::BacklashCompensation;
pub use card::Card;
pub use checked_settings::CheckedSettings;
pub use homing::{HomingEnd, HomingSearch};
pub use inputs::{InputLevels, Inputs};
pub use linked_card::LinkedCard;
pub use outputs::OutputBank;
pub use permit::CutterPermit;
pub use player::Player;
pub use safety_monitor::{MotionState, SafetyMonitor};
pub use step_direction::{Edge, Levels, PulsesDoNotFit, StepDirection, StepTiming};
pub use switching::InstructionExecutor;
pub use window::{CardWindow, RecordStorage};

/// A card of four axes leaves a microcontroller of 64 KiB room for everything else.
const _: () = assert!(size_of::<Card<4, 1024, 256>>() <= 30 * 1024);
