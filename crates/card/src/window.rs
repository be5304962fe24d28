//! The window: the records that the card holds around its cursor.
//!
//! Invariant: `low ≤ cursor ≤ high`, except at the beginning of an epoch inside a record, until that record has
//! arrived; at most `W` records. The host slides the window, one record at a time, at either end. Records that are
//! replaced are taken from the far end, and never within a quarter of the window from the cursor, nor where the cursor
//! cannot avoid going.

use retrace_core::drive::RecordWindow;
use retrace_core::{Flags, Place, RapidCap, Record, RecordIndex};
use retrace_link::CommandRefusal;

/// Storage for the records of a window: an array, or a borrowed slice.
pub trait RecordStorage<const A: usize>: AsRef<[Record<A>]> + AsMut<[Record<A>]> {}

impl<const A: usize, S: AsRef<[Record<A>]> + AsMut<[Record<A>]>> RecordStorage<A> for S {}

/// Window of at most `W` records (a power of two, at least 4), which are stored in `S`: usually its own array. On a
/// microcontroller the storage is provided separately, so that the card's initial value in flash does not contain it.
#[derive(Clone, Debug)]
pub struct CardWindow<const A: usize, const W: usize, S = [Record<A>; W]> {
    records: S,
    low: RecordIndex,
    high: RecordIndex,
    low_rests: bool,
}

impl<const A: usize, const W: usize> CardWindow<A, W> {
    const CHECKED: () = assert!(W.is_power_of_two() && W >= 4 && W <= 1 << 24);

    /// Creates an empty window at `place`, where the path is at rest.
    #[must_use]
    pub const fn new(place: RecordIndex) -> Self {
        let () = Self::CHECKED;
        Self::with_records(place, [Record::ZERO; W])
    }
}

impl<const A: usize, const W: usize, S> CardWindow<A, W, S> {
    /// Creates an empty window at `place` with its records in `records`.
    pub(crate) const fn with_records(place: RecordIndex, records: S) -> Self {
        Self { records, low: place, high: place, low_rests: true }
    }

    /// Sets the storage of its `W` records, before it holds any.
    pub(crate) fn lend_records(&mut self, records: S) {
        self.records = records;
    }

    /// Drops all records and restarts at `place`; `rests` means that the path is at rest there.
    pub const fn restart(&mut self, place: RecordIndex, rests: bool) {
        (self.low, self.high, self.low_rests) = (place, place, rests);
    }
}

impl<const A: usize, const W: usize, S: RecordStorage<A>> CardWindow<A, W, S> {
    fn index(place: RecordIndex) -> usize {
        place.number() as usize & (W - 1)
    }

    fn len(&self) -> u32 {
        self.high.since(self.low)
    }

    /// Returns the record of that number, if held.
    #[must_use]
    pub fn record(&self, place: RecordIndex) -> Option<&Record<A>> {
        (place.since(self.low) < self.len()).then(|| &self.records.as_ref()[Self::index(place)])
    }

    /// Adds the next record ahead. `bound` is the furthest place behind that the cursor is at or cannot avoid reaching.
    pub fn push_ahead(&mut self, place: RecordIndex, record: Record<A>, bound: Place) -> Result<(), CommandRefusal> {
        if place != self.high {
            return Err(CommandRefusal::OutOfOrder);
        }
        if self.len() as usize == W {
            if bound.record.is_before(self.low + (W / 4 + 1) as u32) {
                return Err(CommandRefusal::Full);
            }
            self.low_rests = self.records.as_ref()[Self::index(self.low)].flags.contains(Flags::REST);
            self.low += 1;
        }
        self.records.as_mut()[Self::index(place)] = record;
        self.high += 1;
        Ok(())
    }

    /// Adds the next record behind; `rests` means that the path is at rest before it. `bound` is the furthest place
    /// ahead that the cursor is at or cannot avoid reaching.
    pub fn push_behind(
        &mut self,
        place: RecordIndex,
        record: Record<A>,
        rests: bool,
        bound: Place,
    ) -> Result<(), CommandRefusal> {
        if place != self.low - 1 {
            return Err(CommandRefusal::OutOfOrder);
        }
        if self.len() as usize == W {
            let ahead = bound.boundary_ahead().records_to(self.high);
            if ahead <= (W / 4) as i32 {
                return Err(CommandRefusal::Full);
            }
            self.high -= 1;
        }
        self.records.as_mut()[Self::index(place)] = record;
        self.low = place;
        self.low_rests = rests;
        Ok(())
    }

    /// Drops the records from `high` on, but not those that the cursor is in or cannot avoid reaching.
    pub fn trim(&mut self, high: RecordIndex, bound: Place) -> Result<(), CommandRefusal> {
        if self.high.is_before(high) || high.is_before(self.low) {
            return Err(CommandRefusal::OutOfOrder);
        }
        if high.is_before(bound.boundary_ahead()) {
            return Err(CommandRefusal::InMotion);
        }
        self.high = high;
        Ok(())
    }

    /// Drops the records before `low`, but not those that the cursor is in or cannot avoid reaching backward.
    pub fn forget(&mut self, low: RecordIndex, bound: Place) -> Result<(), CommandRefusal> {
        if low.is_before(self.low) || self.high.is_before(low) {
            return Err(CommandRefusal::OutOfOrder);
        }
        if bound.record.is_before(low) {
            return Err(CommandRefusal::InMotion);
        }
        self.low_rests = self.rests_at(low);
        self.low = low;
        Ok(())
    }
}

impl<const A: usize, const W: usize, S: RecordStorage<A>> RecordWindow<A> for CardWindow<A, W, S> {
    fn low(&self) -> RecordIndex {
        self.low
    }

    fn high(&self) -> RecordIndex {
        self.high
    }

    fn rests_at(&self, place: RecordIndex) -> bool {
        if place == self.low {
            return self.low_rests;
        }
        self.record(place - 1).is_some_and(|r| r.flags.contains(Flags::REST))
    }

    fn cap(&self, place: RecordIndex) -> RapidCap {
        self.record(place).map_or(RapidCap::PLANNED, |r| r.cap)
    }

    fn increments(&self, place: RecordIndex) -> [i16; A] {
        self.record(place).map_or([0; A], |r| r.increments)
    }

    fn is_rapid(&self, place: RecordIndex) -> bool {
        self.record(place).is_some_and(|r| r.flags.contains(Flags::RAPID))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(n: i16) -> Record<1> {
        Record { increments: [n], ..Record::default() }
    }

    #[test]
    fn slides_both_ways_and_keeps_a_quarter_around_the_cursor() {
        let start = u32::MAX - 3;
        let mut window = CardWindow::<1, 8>::new(RecordIndex::new(start));
        let at = |n: u32| Place::start_of(RecordIndex::new(start.wrapping_add(n)));
        for n in 0..8 {
            window.push_ahead(RecordIndex::new(start.wrapping_add(n)), record(n as i16), at(0)).expect("room");
        }
        assert_eq!(
            window.push_ahead(RecordIndex::new(start.wrapping_add(8)), record(8), at(2)),
            Err(CommandRefusal::Full)
        );
        window.push_ahead(RecordIndex::new(start.wrapping_add(8)), record(8), at(3)).expect("the oldest goes");
        assert_eq!(window.record(RecordIndex::new(start)), None);
        assert_eq!(window.record(RecordIndex::new(start.wrapping_add(8))), Some(&record(8)));
        assert_eq!(window.push_behind(RecordIndex::new(start), record(0), true, at(7)), Err(CommandRefusal::Full));
        window.push_behind(RecordIndex::new(start), record(0), true, at(6)).expect("the newest goes");
        assert_eq!(window.record(RecordIndex::new(start.wrapping_add(8))), None);
        assert!(window.rests_at(RecordIndex::new(start)));
        assert_eq!(
            window.push_behind(RecordIndex::new(start), record(0), true, at(0)),
            Err(CommandRefusal::OutOfOrder)
        );
        assert_eq!(window.trim(RecordIndex::new(start.wrapping_add(2)), at(3)), Err(CommandRefusal::InMotion));
        window.trim(RecordIndex::new(start.wrapping_add(3)), at(3)).expect("behind nothing that is needed");
        assert_eq!(window.high(), RecordIndex::new(start.wrapping_add(3)));
        assert_eq!(window.forget(RecordIndex::new(start.wrapping_add(3)), at(2)), Err(CommandRefusal::InMotion));
        window.forget(RecordIndex::new(start.wrapping_add(2)), at(2)).expect("nothing that is needed");
        assert!(window.low() == RecordIndex::new(start.wrapping_add(2)) && !window.rests_at(window.low()));
    }

    /// Every pattern of planned stops: a window that slides over them knows at each of its places, both ends included,
    /// whether the path is at rest there, and loses none that a forgotten or trimmed record ended with.
    #[test]
    fn a_planned_stop_is_known_even_when_its_record_has_gone() {
        const RECORDS: u32 = 9;
        for stops in 0..1u32 << RECORDS {
            // the path is at rest at its beginning; a record's flag is about its end
            let rests = |place: u32| place == 0 || stops >> (place - 1) & 1 == 1;
            let record = |n: u32| {
                let flags = if rests(n + 1) { Flags::REST } else { Flags::default() };
                Record { flags, ..record(n as i16) }
            };
            let mut window = CardWindow::<1, 4>::new(RecordIndex::new(0));
            let agrees = |window: &CardWindow<1, 4>| {
                (window.low().number()..=window.high().number())
                    .all(|place| window.rests_at(RecordIndex::new(place)) == rests(place))
            };
            for n in 0..RECORDS {
                window.push_ahead(RecordIndex::new(n), record(n), Place::start_of(RecordIndex::new(n))).expect("room");
                assert!(agrees(&window), "{stops:b} ahead to {n}");
            }
            while window.low().number() > 0 {
                let n = window.low() - 1;
                window.push_behind(n, record(n.number()), rests(n.number()), Place::start_of(n)).expect("room");
                assert!(agrees(&window), "{stops:b} back to {n:?}");
            }
            for low in 1..=window.high().number() {
                let (low, high) = (RecordIndex::new(low), window.high());
                window.forget(low, Place::start_of(high)).expect("behind what is needed");
                assert!(agrees(&window), "{stops:b} forgotten to {low:?}");
            }
        }
    }
}
