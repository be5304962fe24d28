//! The motion of a block.
//!
//! Invariant: a block has at most one motion.

use crate::drilling_cycle::DrillingCycle;
use crate::groups::Tenths;
use crate::modal_groups::MotionMode;

/// Letters of axis words and of polar coordinates.
pub(super) const AXES: &[u8] = b"xyzabcuvw@^";

/// Motion of the block; G80 is distinct from no motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BlockMotion {
    None,
    Cancel,
    Move(MotionMode),
    /// G70, G71, G72 and their variants, in tenths: executed once, not modal.
    Turn(Tenths),
}

impl BlockMotion {
    pub(super) fn is_arc(self) -> bool {
        matches!(self, BlockMotion::Move(motion) if motion.is_arc())
    }

    /// Returns the drilling cycle of the block.
    pub(super) fn cycle(self) -> Option<DrillingCycle> {
        match self {
            BlockMotion::Move(MotionMode::Cycle(cycle)) => Some(cycle),
            _ => None,
        }
    }

    /// Whether this motion needs axis words.
    pub(super) fn needs_axes(self) -> bool {
        let BlockMotion::Move(motion) = self else { return false };
        matches!(
            motion,
            MotionMode::Cycle(_) | MotionMode::SpindleFeed | MotionMode::RigidTap | MotionMode::ThreadingCycle
        )
    }
}
