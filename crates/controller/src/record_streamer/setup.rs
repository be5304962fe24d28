//! What a record streamer is told of the machine and the journal.
//!
//! Invariant: none of it changes while the streamer is used.

use retrace_config::MachineConfig;
use retrace_journal::DurablePlace;
use retrace_link::OutputChange;

use super::RecordStreamer;

impl<const A: usize> RecordStreamer<'_, A> {
    /// Limits sending to what is durable in the index, if one is written.
    #[must_use]
    pub fn with_durable_place(self, durable: Option<DurablePlace>) -> Self {
        Self { durable_place: durable, ..self }
    }

    /// Sets the channels of the machine's cutters.
    #[must_use]
    pub fn with_cutters(self, machine: &MachineConfig) -> Self {
        Self { fire_channels: machine.cutting_outputs.clone(), cutter_channels: machine.cutter_channels(), ..self }
    }

    /// Whether one of these changes belongs to the start or the end of a cutter.
    pub fn switches_cutter(&self, changes: &[OutputChange]) -> bool {
        changes.iter().any(|change| self.cutter_channels.contains(&change.channel))
    }

    /// Sets the fire channels whose contours are one step of single block.
    #[must_use]
    pub fn with_contour_channels(self, outputs: Vec<u8>) -> Self {
        Self { contour_channels: outputs, ..self }
    }
}
