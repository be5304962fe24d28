//! The host's prediction of the card's window, and the records that are in it or were recently.
//!
//! Invariant: the cells near the window's ends hold the records that were sent, so that a late report can still be
//! evaluated.

use retrace_core::place::is_before;
use retrace_core::{Place, Record};

use crate::{CommandRefusal, HostCommand};

/// Records that the cursor may normally have passed since the last report. If it has passed more, the card rejects the
/// command, and the report shows that.
const MARGIN: u32 = 40;

/// The predicted window, and `N` cells of records (a power of two, at least twice the window).
#[derive(Clone, Debug)]
pub(crate) struct PredictedWindow<const A: usize, const N: usize> {
    cells: [Record<A>; N],
    low: u32,
    high: u32,
    window: u32,
    /// Records that the cursor may still pass after its reported place.
    lead: u32,
}

impl<const A: usize, const N: usize> PredictedWindow<A, N> {
    const CHECKED: () = assert!(N.is_power_of_two());

    /// Creates an empty window of a card that can hold `window` records.
    ///
    /// `lead`: maximum number of records that the cursor passes before it is at rest.
    pub(crate) fn new(place: u32, window: u32, lead: u32) -> Self {
        let () = Self::CHECKED;
        let window = window.clamp(4, N as u32 / 2);
        Self { cells: [Record::default(); N], low: place, high: place, window, lead: lead + MARGIN }
    }

    pub(crate) fn low(&self) -> u32 {
        self.low
    }

    pub(crate) fn high(&self) -> u32 {
        self.high
    }

    pub(crate) fn window(&self) -> u32 {
        self.window
    }

    /// Returns the record of a number that is, or recently was, in the window.
    pub(crate) fn record(&self, place: u32) -> Option<&Record<A>> {
        let near = self.high.wrapping_sub(place).wrapping_add(self.window / 2) <= N as u32;
        near.then(|| &self.cells[place as usize & (N - 1)])
    }

    /// Sets the window that the card reported.
    pub(crate) fn set_reported(&mut self, low: u32, high: u32) {
        (self.low, self.high) = (low, high);
    }

    /// Predicts the effect of a command. `cursor` is the last reported place; `runs` means that the cursor may have
    /// moved since.
    ///
    /// # Errors
    /// Returns the reason for which the card would reject it.
    pub(crate) fn predict(&mut self, word: &HostCommand<A>, cursor: Place, runs: bool) -> Result<(), CommandRefusal> {
        let margin = if runs { self.lead } else { 0 };
        match *word {
            HostCommand::Ahead { place, record } => {
                if place != self.high {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if self.high.wrapping_sub(self.low) == self.window {
                    if is_before(cursor.record, self.low.wrapping_add(self.window / 4 + 1)) {
                        return Err(CommandRefusal::Full);
                    }
                    self.low = self.low.wrapping_add(1);
                }
                self.cells[place as usize & (N - 1)] = record;
                self.high = place.wrapping_add(1);
            }
            HostCommand::Behind { place, record, .. } => {
                if place != self.low.wrapping_sub(1) {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if self.high.wrapping_sub(self.low) == self.window {
                    let needed = cursor.boundary_ahead().wrapping_add(margin + self.window / 4 + 1);
                    if is_before(self.high, needed) {
                        return Err(CommandRefusal::Full);
                    }
                    self.high = self.high.wrapping_sub(1);
                }
                self.cells[place as usize & (N - 1)] = record;
                self.low = place;
            }
            HostCommand::Trim { high } => {
                if is_before(self.high, high) || is_before(high, self.low) {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if is_before(high, cursor.boundary_ahead().wrapping_add(margin)) {
                    return Err(CommandRefusal::InMotion);
                }
                self.high = high;
            }
            HostCommand::Forget { low } => {
                if is_before(low, self.low) || is_before(self.high, low) {
                    return Err(CommandRefusal::OutOfOrder);
                }
                if is_before(cursor.record, low.wrapping_add(margin)) {
                    return Err(CommandRefusal::InMotion);
                }
                self.low = low;
            }
            _ => {}
        }
        Ok(())
    }
}
