//! What the card's window is, or will be, as far as the host can tell; and the records that are in it or were.
//!
//! Invariant: the records of the last cells on either side of the window's ends are those that were sent, so that a report that is late is
//! still understood.

use retrace_core::place::is_before;
use retrace_core::{Place, Record};

use crate::{CommandRefusal, HostCommand};

/// Records that the cursor may have run since it was last heard of, as a rule. Where it is more, the card refuses, and that is seen.
const MARGIN: u32 = 40;

/// The window that is foreseen, and `N` cells of records (a power of two, at least twice the window).
#[derive(Clone, Debug)]
pub(crate) struct PredictedWindow<const A: usize, const N: usize> {
    cells: [Record<A>; N],
    low: u32,
    high: u32,
    window: u32,
    /// Records that the cursor may still run from where it is known to be.
    lead: u32,
}

impl<const A: usize, const N: usize> PredictedWindow<A, N> {
    const CHECKED: () = assert!(N.is_power_of_two());

    /// An empty window of a card that can hold `window` records.
    ///
    /// `lead`: records that the cursor runs at most until it rests.
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

    /// The record of a number that is, or lately was, in the window.
    pub(crate) fn record(&self, place: u32) -> Option<&Record<A>> {
        let near = self.high.wrapping_sub(place).wrapping_add(self.window / 2) <= N as u32;
        near.then(|| &self.cells[place as usize & (N - 1)])
    }

    /// The card reported this window.
    pub(crate) fn set(&mut self, low: u32, high: u32) {
        (self.low, self.high) = (low, high);
    }

    /// What a word will do. `cursor` is where the cursor was last heard of; `runs`: it may have moved since.
    ///
    /// # Errors
    /// As the card would refuse it.
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
