//! The card (design, idea 3): the code that runs on every retrace card, simulated or on a microcontroller.
//!
//! It holds a window of the recorded path around its cursor and plays it at the commanded rate, forward and backward.
//! It executes switching instructions between motions and output actions during motion, counts every pulse, homes its
//! axes, checks its inputs and its host, and determines the tick at which every step pulse begins. It does not handle
//! bytes: the endpoint of the serial line calls it through [`retrace_link::CardCore`].
//!
//! The stop is a stop of category 2 (IEC 60204-1): the motion is brought to rest under control and the power stays on.
//! The card only reads an emergency stop, which must be wired to cut the power by itself.
//!
//! Invariant: the card cannot play records that it does not hold; at the ends of its window it comes to rest exactly.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

mod actions;
mod backlash;
pub mod beam_power;
mod card;
mod checked_settings;
pub mod gear_drive;
mod height_control;
mod homing;
mod inputs;
mod layer;
mod linked_card;
mod outputs;
pub mod permit;
mod played_window;
mod player;
pub mod probe_drive;
mod safety_monitor;
pub mod spindle_encoder;
mod spindle_follower;
pub mod spindle_monitor;
pub mod spindle_pwm;
mod step_direction;
mod switching;
mod window;

pub use actions::ActionTable;
pub use backlash::BacklashCompensation;
pub use card::Card;
pub use checked_settings::CheckedSettings;
pub use gear_drive::GearDrive;
pub use height_control::{HeightConditions, HeightControl, HeightControllers, HeightOrder};
pub use homing::{HomingEnd, HomingSearch};
pub use inputs::{InputLevels, Inputs};
pub use layer::{LayerDrive, LayerProgress, SheetFault};
pub use linked_card::{LentCard, LinkedCard};
pub use outputs::{OutputBank, OutputCounts};
pub use permit::CutterPermit;
pub use player::Player;
pub use probe_drive::{AwaitedProbe, ProbeDrive, ProbeReading};
pub use safety_monitor::{MotionState, SafetyMonitor};
pub use spindle_encoder::{EncoderReading, EncoderSample, MAX_ENCODER_SAMPLES, SpindleEncoder};
pub use spindle_follower::{FOLLOWED_SPINDLES, SpindleFollower};
pub use spindle_monitor::SpindleMonitor;
pub use step_direction::{Edge, Levels, PulsePlanError, StepDirection, StepTiming};
pub use switching::InstructionExecutor;
pub use window::{CardWindow, RecordStorage};

/// A card of four axes leaves enough memory of a microcontroller with 64 KiB for everything else.
const _: () = assert!(size_of::<Card<4, 1024, 256>>() <= 30 * 1024);
