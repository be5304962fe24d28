//! The host's prediction of the card's window, and the records that are in it or were recently.
//!
//! Invariant: the cells near the window's ends hold the records that were sent, so that a late report can still be
//! evaluated.
use retrace_core::{Place, Record, RecordIndex};

use crate::{CommandRefusal, HostCommand};

/// Records that the cursor may normally have passed since the last report. If it has passed more, the card rejects the
/// command, and the report shows that.
const MARGIN: u32 = 40;

/// The predicted window, and `N` cells of records (a power of two, at least twice the window).
#[derive(Clone, Debug)]
pub(crate) struct PredictedWindow<const A: usize, const N: usize> {
    cells: [Record<A>; N],
    low: RecordIndex,
    high: RecordIndex,
    window: u32,
    /// Records that the cursor may still pass after its reported place.
    lead: u32,
}

impl<const A: usize, const N: usize> PredictedWindow<A, N> {
    const CHECKED: () = assert!(N.is_power_of_two());

    /// Creates an empty window of a card that can hold `window` records.
    ///
    /// `lead`: maximum number of records that the cursor passes before it is at rest.
    pub(crate) fn new(place: RecordIndex, window: u32, lead: u32) -> Self {
        let () = Self::CHECKED;
        let window = window.clamp(4, N as u32 / 2);
        Self { cells: [Record::default(); N], low: place, high: place, window, lead: lead + MARGIN }
    }

    pub(crate) fn low(&self) -> RecordIndex {
        self.low
    }

    pub(crate) fn high(&self) -> RecordIndex {
        self.high
    }

    pub(crate) fn window(&self) -> u32 {
        self.window
    }

    /// Returns the record of a number that is, or recently was, in the window.
    pub(crate) fn record(&self, place: RecordIndex) -> Option<&Record<A>> {
        let near = self.high.since(place).wrapping_add(self.window / 2) <= N as u32;
        near.then(|| &self.cells[place.number() as usize & (N - 1)])
    }

    /// Sets the window that the card reported.
    pub(crate) fn set_reported(&mut self, low: RecordIndex, high: RecordIndex) {
        (self.low, self.high) = (low, high);
    }

    /// Predicts the effect of a command. `cursor` is the last reported place; `runs` means that the cursor may have
    /// moved since.
    ///
    /// # Errors
    /// Returns the reason for which the card would reject it.
    pub(crate) fn predict(
        &mut self,
        command: &HostCommand<A>,
        cursor: Place,
        runs: bool,
    ) -> Result<(), CommandRefusal> {
        let margin = if runs { self.lead } else { 0 };
        match *command {
            HostCommand::Ahead { place, record } => {
                if place != self.high {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if self.high.since(self.low) == self.window {
                    if cursor.record.is_before(self.low + (self.window / 4 + 1)) {
                        return Err(CommandRefusal::Full);
                    }
                    self.low += 1;
                }
                self.cells[place.number() as usize & (N - 1)] = record;
                self.high = place + 1;
            }
            HostCommand::Behind { place, record, .. } => {
                if place != self.low - 1 {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if self.high.since(self.low) == self.window {
                    let needed = cursor.boundary_ahead() + (margin + self.window / 4 + 1);
                    if self.high.is_before(needed) {
                        return Err(CommandRefusal::Full);
                    }
                    self.high -= 1;
                }
                self.cells[place.number() as usize & (N - 1)] = record;
                self.low = place;
            }
            HostCommand::Trim { high } => {
                if self.high.is_before(high) || high.is_before(self.low) {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if high.is_before(cursor.boundary_ahead() + margin) {
                    return Err(CommandRefusal::InMotion);
                }
                self.high = high;
            }
            HostCommand::Forget { low } => {
                if low.is_before(self.low) || self.high.is_before(low) {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if cursor.record.is_before(low + margin) {
                    return Err(CommandRefusal::InMotion);
                }
                self.low = low;
            }
            _ => {}
        }
        Ok(())
    }
}
