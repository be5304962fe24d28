//! Instructions of a cutter that were executed with the cutter off, because their contour is passed so.
//!
//! Invariant: the output action that repeats such an instruction in reverse and forward run never reaches the card,
//! which would light the cutter by it where it passes the place for the first time.

use retrace_core::RecordIndex;
use retrace_link::OutputAction;

use super::RecordStreamer;

impl<const A: usize> RecordStreamer<'_, A> {
    /// Marks whether the instruction of a cutter at this place is executed with the cutter off.
    pub fn mark_dark(&mut self, place: RecordIndex, is_dark: bool) {
        self.dark_changes.retain(|&at| at != place);
        if is_dark {
            self.dark_changes.push(place);
        }
    }

    /// Whether this action repeats an instruction that was executed with the cutter off.
    pub(super) fn is_dark(&self, action: &OutputAction) -> bool {
        self.dark_changes.contains(&action.place) && self.fire_channels.contains(&action.channel)
    }
}
