//! The host's prediction of the card's window, and the records that are in it or were recently.
//!
//! Invariant: the cells near the window's ends hold the records that were sent, so that a late report can still be
//! evaluated.
use core::hash::{Hash, Hasher};

use retrace_core::{Place, Record, RecordIndex};

use crate::{CommandRefusal, HostCommand};

/// Records that the cursor may normally have passed since the last report. If it has passed more, the card rejects the
/// command, and the report shows that.
const MARGIN: u32 = 40;

/// The predicted ends of the card's window, and the rule by which commands change them.
///
/// In each rule `cursor` is the last reported place, and `margin` the number of records by which the cursor may be
/// ahead of it, or behind it, before it is at rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PredictedBounds {
    /// First record of the window.
    pub low: RecordIndex,
    /// Place after its last record.
    pub high: RecordIndex,
    /// Number of records that the card can hold.
    pub window: u32,
}

impl PredictedBounds {
    fn is_full(self) -> bool {
        self.high.since(self.low) == self.window
    }

    /// Returns the window after the record `place` was added ahead.
    ///
    /// # Errors
    /// Returns the reason for which the card would reject the command, as all rules do.
    pub fn after_ahead(self, place: RecordIndex, cursor: Place) -> Result<Self, CommandRefusal> {
        if place != self.high {
            return Err(CommandRefusal::OutOfOrder);
        }
        let mut after = self;
        if self.is_full() {
            if cursor.record.is_before(self.low + (self.window / 4 + 1)) {
                return Err(CommandRefusal::Full);
            }
            after.low += 1;
        }
        after.high = place + 1;
        Ok(after)
    }

    /// Returns the window after the record `place` was added behind.
    ///
    /// # Errors
    /// As [`PredictedBounds::after_ahead`].
    pub fn after_behind(self, place: RecordIndex, cursor: Place, margin: u32) -> Result<Self, CommandRefusal> {
        if place != self.low - 1 {
            return Err(CommandRefusal::OutOfOrder);
        }
        let mut after = self;
        if self.is_full() {
            if self.high.is_before(cursor.boundary_ahead() + (margin + self.window / 4 + 1)) {
                return Err(CommandRefusal::Full);
            }
            after.high -= 1;
        }
        after.low = place;
        Ok(after)
    }

    /// Returns the window after the records from `high` on were dropped.
    ///
    /// # Errors
    /// As [`PredictedBounds::after_ahead`].
    pub fn after_trim(self, high: RecordIndex, cursor: Place, margin: u32) -> Result<Self, CommandRefusal> {
        if self.high.is_before(high) || high.is_before(self.low) {
            return Err(CommandRefusal::OutOfOrder);
        }
        if high.is_before(cursor.boundary_ahead() + margin) {
            return Err(CommandRefusal::InMotion);
        }
        Ok(Self { high, ..self })
    }

    /// Returns the window after the records before `low` were dropped.
    ///
    /// # Errors
    /// As [`PredictedBounds::after_ahead`].
    pub fn after_forget(self, low: RecordIndex, cursor: Place, margin: u32) -> Result<Self, CommandRefusal> {
        if low.is_before(self.low) || self.high.is_before(low) {
            return Err(CommandRefusal::OutOfOrder);
        }
        if cursor.record.is_before(low + margin) {
            return Err(CommandRefusal::InMotion);
        }
        Ok(Self { low, ..self })
    }
}

/// The predicted window, and `N` cells of records (a power of two, at least twice the window).
#[derive(Clone, Debug)]
pub(crate) struct PredictedWindow<const A: usize, const N: usize> {
    cells: [Record<A>; N],
    bounds: PredictedBounds,
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
        let bounds = PredictedBounds { low: place, high: place, window };
        Self { cells: [Record::default(); N], bounds, lead: lead + MARGIN }
    }

    pub(crate) fn low(&self) -> RecordIndex {
        self.bounds.low
    }

    pub(crate) fn high(&self) -> RecordIndex {
        self.bounds.high
    }

    pub(crate) fn window(&self) -> u32 {
        self.bounds.window
    }

    /// Returns the record of a number that is, or recently was, in the window.
    pub(crate) fn record(&self, place: RecordIndex) -> Option<&Record<A>> {
        let near = self.high().since(place).wrapping_add(self.window() / 2) <= N as u32;
        near.then(|| &self.cells[place.number() as usize & (N - 1)])
    }

    /// Sets the window that the card reported.
    pub(crate) fn set_reported(&mut self, low: RecordIndex, high: RecordIndex) {
        (self.bounds.low, self.bounds.high) = (low, high);
    }

    /// Hashes the window and every cell.
    pub(crate) fn hash_state(&self, state: &mut impl Hasher) {
        let Self { cells, bounds, lead } = self;
        (cells, bounds, lead).hash(state);
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
                self.bounds = self.bounds.after_ahead(place, cursor)?;
                self.cells[place.number() as usize & (N - 1)] = record;
            }
            HostCommand::Behind { place, record, .. } => {
                self.bounds = self.bounds.after_behind(place, cursor, margin)?;
                self.cells[place.number() as usize & (N - 1)] = record;
            }
            HostCommand::Trim { high } => self.bounds = self.bounds.after_trim(high, cursor, margin)?,
            HostCommand::Forget { low } => self.bounds = self.bounds.after_forget(low, cursor, margin)?,
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_near_the_window_are_found() {
        for start in [0u32, u32::MAX - 9, 0x7FFF_FFF8] {
            let at = |offset: u32| RecordIndex::new(start.wrapping_add(offset));
            let mut window = PredictedWindow::<1, 16>::new(at(0), 4, 0);
            let record = |offset: u32| Record { increments: [offset as i16], ..Record::default() };
            for offset in 0..20 {
                let command = HostCommand::Ahead { place: at(offset), record: record(offset) };
                // the cursor is at the end
                window.predict(&command, Place::start_of(at(offset)), true).expect("the window slides");
            }
            assert_eq!((window.low(), window.high(), window.window()), (at(16), at(20), 4));
            // as many cells as there are, less half a window ahead
            for offset in 6..20 {
                assert_eq!(window.record(at(offset)), Some(&record(offset)), "{offset}");
            }
            assert!(window.record(at(5)).is_none() && window.record(at(23)).is_none());
            assert!(window.record(at(20)).is_some() && window.record(at(22)).is_some());
            let behind = HostCommand::Behind { place: at(15), record: record(77), rests: false };
            let reported = Place::start_of(at(16));
            assert_eq!(window.predict(&behind, reported, true), Err(CommandRefusal::Full), "it may still run ahead");
            assert_eq!(window.predict(&behind, reported, false), Ok(()));
            assert_eq!((window.low(), window.high(), window.record(at(15))), (at(15), at(19), Some(&record(77))));
            let trim = HostCommand::Trim { high: at(17) };
            assert_eq!(window.predict(&trim, reported, true), Err(CommandRefusal::InMotion));
            assert_eq!(window.predict(&trim, reported, false), Ok(()));
            let forget = HostCommand::Forget { low: at(16) };
            assert_eq!(window.predict(&forget, reported, true), Err(CommandRefusal::InMotion));
            assert_eq!(window.predict(&forget, reported, false), Ok(()));
            assert_eq!((window.low(), window.high()), (at(16), at(17)));
            window.set_reported(at(15), at(18));
            assert_eq!((window.low(), window.high()), (at(15), at(18)));
        }
    }

    /// The margin is the way to rest and some records more.
    #[test]
    fn the_margin_is_the_way_to_rest_and_more() {
        let at = |offset: u32| RecordIndex::new(offset);
        let mut window = PredictedWindow::<1, 512>::new(at(0), 1000, 7);
        assert_eq!(window.window(), 256, "at most half the cells");
        window.set_reported(at(0), at(200));
        let trim = |high| HostCommand::Trim { high: at(high) };
        let cursor = Place::start_of(at(100));
        assert_eq!(window.predict(&trim(146), cursor, true), Err(CommandRefusal::InMotion));
        assert_eq!(window.predict(&trim(147), cursor, true), Ok(()));
        assert_eq!(PredictedWindow::<1, 16>::new(at(0), 1, 0).window(), 4, "at least four");
    }
}
