//! Instructions that a restart repeats, and the block of motion until they are complete.
//!
//! Invariant: a block that a restart has set is released by its last repeated instruction alone.

use retrace_link::{CommandRefusal, RepeatedInstruction};

use super::{MotionBlock, Player};
use crate::window::RecordStorage;

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Player<A, W, M, S> {
    /// Blocks motion until the repeated instruction `last` is complete; releases the block if it is already complete.
    pub(super) fn block_until_repeated(&mut self, last: u32) {
        self.block = MotionBlock::Restart { last, begun: false };
        self.release_block();
    }

    /// Executes switching again, while the machine is at rest.
    pub(super) fn repeat_instruction(&mut self, repeated: RepeatedInstruction) -> Result<(), CommandRefusal> {
        if !self.has_stopped() {
            return Err(CommandRefusal::InMotion);
        }
        if let Some(alarm) = self.alarm_of_start(repeated.changes(), repeated.layer) {
            // Not a refusal, which would be reported before the alarm that is its cause.
            self.start_alarm = Some(alarm);
            return Ok(());
        }
        let has_encoder = self.followed.first().is_some_and(|followed| followed.monitor.settings().is_some());
        self.switching.repeat(repeated, &mut self.outputs, &mut self.layer, has_encoder)?;
        self.begin_height_control(repeated.layer);
        if let MotionBlock::Restart { begun, .. } = &mut self.block {
            *begun = true;
        }
        self.release_block();
        Ok(())
    }

    /// Releases the block if its last repeated instruction is complete.
    pub(super) fn release_block(&mut self) {
        if let MotionBlock::Restart { last, .. } = self.block
            && last.wrapping_sub(self.switching.repeated()) as i32 <= 0
        {
            self.block = MotionBlock::None;
        }
    }
}
