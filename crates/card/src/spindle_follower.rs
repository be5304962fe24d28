//! The spindle as the card measures it, together with the motion that follows it.
//!
//! Invariant: a card that follows no spindle has none of this: its arrays of followers are empty.

use crate::{GearDrive, SpindleMonitor};

/// Number of spindles that this build follows: one with the feature `spindle`, which is on by default.
pub const FOLLOWED_SPINDLES: usize = cfg!(feature = "spindle") as usize;

/// A spindle, and the motion that follows it.
#[derive(Clone, Debug)]
pub struct SpindleFollower {
    /// What is measured.
    pub monitor: SpindleMonitor,
    /// The stretches that follow its angle.
    pub gear: GearDrive,
}

impl SpindleFollower {
    /// A follower of no spindle.
    pub const NONE: Self = Self { monitor: SpindleMonitor::new(), gear: GearDrive::new() };
}
