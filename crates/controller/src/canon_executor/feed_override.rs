//! Where the operator's overrides apply: M48, M49, M50, and the tapping cycles, which switch them off for themselves.
//!
//! Invariant: the path rests, and an instruction stands there, before the first move behind a change alone. Codes that
//! change nothing cost nothing, and neither do those that are taken back before anything moves.

use super::{CanonError, CanonExecutor};
use crate::motion_sink::MotionSink;
use crate::plan_writer::SwitchInstruction;

/// Whether the operator's overrides apply.
#[derive(Clone, Copy, Debug)]
pub(super) struct FeedOverrideSwitch {
    /// As programmed last.
    is_programmed_on: bool,
    /// As the moves so far have it.
    is_on: bool,
}

impl Default for FeedOverrideSwitch {
    fn default() -> Self {
        Self { is_programmed_on: true, is_on: true }
    }
}

impl FeedOverrideSwitch {
    /// Switches the overrides on or off for the moves to come.
    pub(super) fn program(&mut self, is_on: bool) {
        self.is_programmed_on = is_on;
    }
}

impl CanonExecutor<'_> {
    /// Before a move: the instruction for what was programmed since the last one.
    pub(super) fn switch_feed_override<const A: usize>(
        &mut self,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let applies = self.feed_override.is_programmed_on;
        if std::mem::replace(&mut self.feed_override.is_on, applies) == applies {
            return Ok(());
        }
        Ok(sink.exclusive(SwitchInstruction::of_feed_override(applies, line))?)
    }
}
