//! Single block: where sending ends.
//!
//! Invariant: the end of a block is a boundary between records of different lines, at which the card can still stop,
//! and at which no cutter is on whose contours are one step.

use retrace_core::RecordIndex;
use retrace_link::{HostCommand, MotionCard};

use super::{RecordStreamer, SendHorizon};
use crate::plan_item::ExclusiveInstruction;

/// Single block: progress of the search for the end of the block.
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockWindow {
    searched_until: RecordIndex,
    /// Whether the block ends at that place.
    found: bool,
}

impl<const A: usize> RecordStreamer<'_, A> {
    /// Place at which sending ahead ends, gates aside.
    pub(super) fn send_end(&mut self, horizon: SendHorizon) -> RecordIndex {
        if let SendHorizon::Until(place) = horizon {
            return place;
        }
        // Records behind this place may have items before them that are not received yet.
        let write = self.items_known_until;
        while let Some(BlockWindow { searched_until: looked, found: false }) = self.block_window
            && looked.is_before(write)
        {
            let place = looked + 1;
            self.block_window = Some(BlockWindow { searched_until: place, found: self.is_block_end(place) });
            if place == write {
                // what follows is not planned yet: check this place again
                self.block_window = Some(BlockWindow { searched_until: looked, found: false });
                break;
            }
        }
        match self.block_window {
            Some(BlockWindow { searched_until: looked, found: true }) if looked.is_before(write) => looked,
            _ => write,
        }
    }

    /// Single block: ends sending at the first block boundary after `after` at which the card can still stop.
    pub fn trim_at_block_end<C: MotionCard<A>>(&mut self, card: &mut C, after: RecordIndex) {
        let mut place = after;
        while place.is_before(card.status().high) {
            place += 1;
            if self.is_block_end(place) && card.send(HostCommand::Trim { high: place }).is_ok() {
                self.block_window = Some(BlockWindow { searched_until: place, found: true });
                return;
            }
        }
        self.block_window = Some(BlockWindow { searched_until: place, found: false });
    }

    fn is_block_end(&self, place: RecordIndex) -> bool {
        match (self.ring.record(place - 1), self.ring.record(place)) {
            (Some(last), Some(next)) => last.line != next.line && !self.is_in_contour(place),
            _ => false,
        }
    }

    /// Whether a cutter whose contours are one step is on before this place and behind it. The place is not before the
    /// furthest one that was executed.
    fn is_in_contour(&self, place: RecordIndex) -> bool {
        self.contour_channels.iter().any(|&channel| {
            let is_on = self.expected[usize::from(channel)] != 0;
            let instructed = self.exclusives.iter().filter_map(|exclusive| {
                let mut changes = exclusive.changes[..usize::from(exclusive.count)].iter().rev();
                changes.find(|change| change.channel == channel).map(|change| (exclusive.place, change.value != 0))
            });
            let actions = self.actions.iter().skip(self.passed).filter(|(action, _)| action.channel == channel);
            // an action is executed in passing: behind this place
            let in_passing = actions.map(|(action, _)| (action.place, action.after != 0));
            is_on_around(is_on, instructed.chain(in_passing.filter(|(at, _)| at.is_before(place))), place)
        })
    }

    /// Whether a cutter is on whose contours are one step.
    pub fn is_contour_open(&self) -> bool {
        self.contour_channels.iter().any(|&channel| self.expected[usize::from(channel)] != 0)
    }

    /// Whether an instruction lights a cutter whose contours are one step.
    pub fn begins_contour(&self, exclusive: &ExclusiveInstruction) -> bool {
        self.contour_channels.iter().any(|&channel| exclusive.switches_on(channel))
    }

    /// Place at which single block ends sending, once it is known.
    #[must_use]
    pub fn block_end(&self) -> Option<RecordIndex> {
        self.block_window.filter(|b| b.found).map(|b| b.searched_until)
    }

    /// Removes the end of the block: single block is off.
    pub fn clear_block_end(&mut self) {
        self.block_window = None;
    }
}

/// Whether a channel that is now on or off is on both before and behind `place`; each change has its place.
fn is_on_around(is_on: bool, changes: impl Iterator<Item = (RecordIndex, bool)>, place: RecordIndex) -> bool {
    let mut before = (None, is_on);
    let mut goes_off = false;
    for (at, value) in changes {
        if at.is_before(place) {
            let is_later = before.0.is_none_or(|last: RecordIndex| !at.is_before(last));
            before = if is_later { (Some(at), value) } else { before };
        } else if at == place {
            goes_off |= !value;
        }
    }
    before.1 && !goes_off
}
