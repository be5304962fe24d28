//! Pieces of the shop's jobs, in a command that was built without the shop: there are none.
//!
//! Invariant: nothing is started.

use retrace_config::NumberedError;

use super::MachineThread;

impl<const A: usize> MachineThread<'_, '_, A> {
    /// Starts nothing.
    pub(super) fn start_shop_job(&mut self, _id: &str, _pieces: u32) {
        self.reject_text("this command was built without the shop");
    }

    /// Nothing is recorded.
    #[expect(clippy::unused_self, reason = "as with the shop")]
    pub(super) fn record_ended_pieces(&mut self) {}
}

/// Error of a start inside the program of a job; there are none.
pub(super) fn begins_inside_piece() -> NumberedError {
    NumberedError::new("E5031", "a piece of a job of the shop begins at its first block", "start it at its beginning")
}
