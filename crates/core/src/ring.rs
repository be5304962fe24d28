//! The record ring between planning and motion: history | cursor | look-ahead (REV-2 … REV-7, design idea 2).
//!
//! Four positions (`positions`), `head ≤ read ≤ reached ≤ write`, all wrapping u32 place numbers: `head` is the oldest record kept, `read`
//! the cursor, `reached` the furthest place ever executed (the source's W), `write` the end of what is planned. Two words are
//! shared between the threads and both only grow: `write`, and `floor`, which is always `reached − keep`. `read` and
//! `reached` are the consumer's own.
//!
//! Invariant: the producer writes only cells at `write < floor + keep + look_ahead`, the consumer reads only cells at
//! `head … write`, and `floor ≤ head`; as the ring has at least `keep + look_ahead` cells, neither side ever touches a cell
//! that the other may touch. Push and read return at once, full or empty.
//!
//! At the start `floor` lies `keep` places before the first record, where nothing was ever written; `head` is the later of
//! `floor` and the first place, and follows `floor` from then on.

use core::ops::Deref;

use crate::ring_indices::{ConsumerIndices, ProducerIndices};
use crate::sync::{AtomicU32, CachePadded, Ordering, UnsafeCell};

/// One cell of a ring's storage.
#[derive(Debug, Default)]
pub struct Cell<R>(UnsafeCell<R>);

impl<R> Cell<R> {
    /// A cell with that content.
    #[must_use]
    pub fn new(content: R) -> Self {
        Self(UnsafeCell::new(content))
    }
}

// SAFETY: the content is private to this module, which reaches it only through the one `Producer` and the one `Consumer` of a
// ring, and these never touch the same cell at a time (module invariant; rows `ring-apart` and `ring-threads` of the ledger).
unsafe impl<R: Send> Sync for Cell<R> {}

/// Storage and shared positions of a ring; [`Ring::split`] gives its two ends.
#[derive(Debug)]
pub struct Ring<S> {
    cells: S,
    keep: u32,
    look_ahead: u32,
    kept: u32,
    floor: CachePadded<AtomicU32>,
    write: CachePadded<AtomicU32>,
}

/// Why a ring cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RingError {
    /// The number of cells is not a power of two, or above 2³⁰.
    NotAPowerOfTwo,
    /// `keep + look_ahead` is more than there are cells, or `look_ahead` is zero.
    TooSmall,
    /// The places do not lie in order, or are more than the ring promises to hold.
    NoSuchStretch,
}

/// The records that a ring holds: history `head … reached`, look-ahead `reached … write`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordSpan {
    /// Oldest record.
    pub head: u32,
    /// The furthest place ever executed.
    pub reached: u32,
    /// The place behind the newest record.
    pub write: u32,
}

impl<R, S: Deref<Target = [Cell<R>]>> Ring<S> {
    /// A ring over `cells` (a power of two of them, at most 2³⁰) that keeps `keep` records behind `reached` and lets at most
    /// `look_ahead` records be planned beyond it. Its first record will have the place number `start`.
    pub fn new(cells: S, keep: u32, look_ahead: u32, start: u32) -> Result<Self, RingError> {
        Self::holding(cells, keep, look_ahead, RecordSpan { head: start, reached: start, write: start })
    }

    /// A ring over cells that hold records already: record `place` in cell `place` modulo their number. The cursor stands at
    /// `reached`.
    pub fn holding(cells: S, keep: u32, look_ahead: u32, stretch: RecordSpan) -> Result<Self, RingError> {
        let n = cells.len();
        if !n.is_power_of_two() || n > 1 << 30 {
            return Err(RingError::NotAPowerOfTwo);
        }
        if look_ahead == 0 || keep as u64 + look_ahead as u64 > n as u64 {
            return Err(RingError::TooSmall);
        }
        let RecordSpan { head, reached, write } = stretch;
        if ConsumerIndices::at(head, reached, reached, write, keep).is_none()
            || write.wrapping_sub(reached) > look_ahead
        {
            return Err(RingError::NoSuchStretch);
        }
        let floor = CachePadded(AtomicU32::new(reached.wrapping_sub(keep)));
        let kept = reached.wrapping_sub(head);
        Ok(Self { cells, keep, look_ahead, kept, floor, write: CachePadded(AtomicU32::new(write)) })
    }

    /// The two ends; one pair at a time. A second pair begins without history.
    pub fn split(&mut self) -> (Producer<'_, R>, Consumer<'_, R>) {
        let write = self.write.0.load(Ordering::Relaxed);
        let floor = self.floor.0.load(Ordering::Relaxed);
        let reached = floor.wrapping_add(self.keep);
        let kept = core::mem::take(&mut self.kept);
        let shared = Shared { cells: &self.cells, floor: &self.floor.0, write: &self.write.0 };
        let planned = ProducerIndices::at(write, floor, self.keep + self.look_ahead);
        let played = ConsumerIndices::at(reached.wrapping_sub(kept), reached, reached, write, self.keep);
        let Some(played) = played else { unreachable!("a ring's own positions are in order") };
        (Producer { shared, planned }, Consumer { shared, played })
    }
}

#[derive(Debug)]
struct Shared<'a, R> {
    cells: &'a [Cell<R>],
    floor: &'a AtomicU32,
    write: &'a AtomicU32,
}

impl<R> Clone for Shared<'_, R> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<R> Copy for Shared<'_, R> {}

impl<R> Shared<'_, R> {
    #[inline]
    fn cell(&self, place: u32) -> &UnsafeCell<R> {
        // The length is a power of two, so the mask keeps the index in bounds and follows the wrap of place numbers.
        &self.cells[place as usize & (self.cells.len() - 1)].0
    }
}

/// The planner's end: appends records at `write`.
#[derive(Debug)]
pub struct Producer<'a, R> {
    shared: Shared<'a, R>,
    planned: ProducerIndices,
}

impl<R: Copy> Producer<'_, R> {
    /// Appends a record; gives it back where the look-ahead is full.
    #[inline]
    pub fn push(&mut self, record: R) -> Result<(), R> {
        if !self.has_room() {
            return Err(record);
        }
        let cell = self.shared.cell(self.planned.write());
        // SAFETY: `write − floor < keep + look_ahead ≤ cells`, so this cell is none of `floor … write`, the only ones that
        // the consumer may read before the store below; the Acquire above orders its last reads of it before this write.
        cell.with_mut(|p| unsafe { *p = record });
        self.planned.advance();
        self.shared.write.store(self.planned.write(), Ordering::Release);
        Ok(())
    }

    /// Would [`Producer::push`] take a record now?
    #[inline]
    pub fn has_room(&mut self) -> bool {
        if self.planned.is_full() {
            self.refresh_floor();
        }
        !self.planned.is_full()
    }

    /// How many records there is room for now.
    #[inline]
    pub fn slots(&mut self) -> u32 {
        self.refresh_floor();
        self.planned.slots()
    }

    /// Looks up what the consumer has let go.
    #[inline]
    fn refresh_floor(&mut self) {
        self.planned.observe_floor(self.shared.floor.load(Ordering::Acquire));
    }

    /// The place number that the next record will have.
    #[must_use]
    pub fn write(&self) -> u32 {
        self.planned.write()
    }
}

/// The motion path's end: reads anywhere in `head … write`, moves the cursor, and lets history go.
#[derive(Debug)]
pub struct Consumer<'a, R> {
    shared: Shared<'a, R>,
    played: ConsumerIndices,
}

impl<R: Copy> Consumer<'_, R> {
    /// Oldest record kept.
    #[must_use]
    pub fn head(&self) -> u32 {
        self.played.head()
    }

    /// The cursor: the record that would be read next going forward.
    #[must_use]
    pub fn read(&self) -> u32 {
        self.played.read()
    }

    /// The furthest place ever executed; the source's W.
    #[must_use]
    pub fn reached(&self) -> u32 {
        self.played.reached()
    }

    /// The end of what is planned, looked up anew.
    #[inline]
    pub fn write(&mut self) -> u32 {
        self.played.observe_write(self.shared.write.load(Ordering::Acquire));
        self.played.write()
    }

    /// The record at `place`, if it lies in `head … write` as last seen by [`Consumer::write`] or [`Consumer::forward`].
    #[inline]
    #[must_use]
    pub fn record(&self, place: u32) -> Option<R> {
        self.played.holds(place).then(|| self.content(place))
    }

    /// What the cell of `place` holds; `place` is held, or was until the last move of the cursor, which has not been published.
    #[inline]
    fn content(&self, place: u32) -> R {
        // SAFETY: `floor ≤ place < write`: written before the Release store that `write` was loaded from (Acquire), and not
        // written again before the shared floor has passed it, which only `publish` does, through `&mut self`.
        self.shared.cell(place).with(|p| unsafe { *p })
    }

    /// Reads the record under the cursor and moves it forward (REV-5, REV-7); `None` at `write`.
    #[inline]
    pub fn advance(&mut self) -> Option<R> {
        if self.played.read() == self.played.write() {
            self.write();
        }
        let floor = self.played.floor();
        let place = self.played.advance_cursor()?;
        // wrapped up before the store, which nothing is moved across: so it is copied once
        let record = Some(self.content(place));
        self.publish(floor);
        record
    }

    /// Moves the cursor back and reads the record it passes (REV-6); `None` at `head`.
    #[inline]
    pub fn retreat(&mut self) -> Option<R> {
        self.played.retreat().map(|place| self.content(place))
    }

    /// Puts the cursor on `place`, as the card reports it; false, and nothing changed, where that is not in `head … write`.
    #[inline]
    pub fn seek(&mut self, place: u32) -> bool {
        let floor = self.played.floor();
        let followed = self.played.seek(place);
        self.publish(floor);
        followed
    }

    /// Lets the planner know, if the floor is no longer at `before`.
    #[inline]
    fn publish(&mut self, before: u32) {
        let floor = self.played.floor();
        if floor != before {
            self.shared.floor.store(floor, Ordering::Release);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    fn cells(n: usize) -> Box<[Cell<u32>]> {
        (0..n).map(|_| Cell::default()).collect()
    }

    #[test]
    fn refuses_storage_that_cannot_hold_what_it_promises() {
        assert_eq!(Ring::new(cells(3), 1, 1, 0).err(), Some(RingError::NotAPowerOfTwo));
        assert_eq!(Ring::new(cells(0), 0, 1, 0).err(), Some(RingError::NotAPowerOfTwo));
        assert_eq!(Ring::new(cells(4), 4, 1, 0).err(), Some(RingError::TooSmall));
        assert_eq!(Ring::new(cells(4), 1, 0, 0).err(), Some(RingError::TooSmall));
        let holding = |head, reached, write| Ring::holding(cells(4), 2, 2, RecordSpan { head, reached, write }).err();
        assert_eq!(holding(u32::MAX, 1, 3), None);
        for (head, reached, write) in [(1, 0, 2), (0, 3, 4), (0, 2, 5), (0, 2, 1)] {
            assert_eq!(holding(head, reached, write), Some(RingError::NoSuchStretch));
        }
    }

    #[test]
    fn a_second_pair_of_ends_goes_on_without_history() {
        let held: Box<[Cell<u32>]> = (0..4).map(Cell::new).collect();
        let mut ring = Ring::holding(held, 2, 2, RecordSpan { head: u32::MAX, reached: 1, write: 2 }).expect("valid");
        let (mut producer, mut consumer) = ring.split();
        producer.push(7).expect("room");
        assert_eq!((consumer.retreat(), consumer.retreat(), consumer.retreat()), (Some(0), Some(3), None));
        assert!(consumer.seek(2));
        let (_, mut consumer) = ring.split();
        assert_eq!((consumer.retreat(), consumer.advance(), consumer.advance()), (None, Some(7), None));
    }

    #[test]
    fn the_empty_ring_stops_at_once_in_both_directions() {
        let mut ring = Ring::new(cells(4), 2, 2, 9).expect("valid");
        let (_, mut consumer) = ring.split();
        assert_eq!(consumer.retreat(), None);
        assert_eq!(consumer.advance(), None);
        assert!(!consumer.seek(10) && !consumer.seek(8) && consumer.seek(9));
    }

    proptest! {
        /// Any sequence of operations against a plain list of everything ever written, over the wrap of place numbers.
        #[test]
        fn agrees_with_a_list(
            exponent in 1u32..5, keep in 0u32..8, look_ahead in 1u32..8,
            start in prop_oneof![Just(0u32), Just(u32::MAX - 5), any::<u32>()],
            operations in prop::collection::vec(0u8..4, 1..200),
        ) {
            let n = 1u32 << exponent;
            prop_assume!(keep + look_ahead <= n);
            let mut ring = Ring::new(cells(n as usize), keep, look_ahead, start).expect("valid");
            let (mut producer, mut consumer) = ring.split();
            let mut all: Vec<u32> = Vec::new();
            let (mut read, mut reached) = (0usize, 0usize);
            for operation in operations {
                match operation {
                    0 | 1 => {
                        let full = all.len() - reached == look_ahead as usize;
                        // the producer may lag behind in what it knows, but here it always looks before it refuses
                        prop_assert_eq!(producer.slots() as usize, look_ahead as usize - (all.len() - reached));
                        prop_assert_eq!(producer.push(all.len() as u32).is_err(), full);
                        if !full { all.push(all.len() as u32); }
                    }
                    2 => {
                        let want = all.get(read).copied();
                        prop_assert_eq!(consumer.advance(), want);
                        if want.is_some() { read += 1; reached = reached.max(read); }
                    }
                    _ => {
                        let oldest = reached.saturating_sub(keep as usize);
                        let want = if read > oldest { read -= 1; Some(all[read]) } else { None };
                        prop_assert_eq!(consumer.retreat(), want);
                    }
                }
                prop_assert_eq!(consumer.read(), start.wrapping_add(read as u32));
                prop_assert_eq!(consumer.reached(), start.wrapping_add(reached as u32));
                prop_assert_eq!(consumer.head(), start.wrapping_add(reached.saturating_sub(keep as usize) as u32));
                prop_assert_eq!(consumer.write(), start.wrapping_add(all.len() as u32));
            }
        }
    }

    #[test]
    fn two_threads_forward_and_back_read_what_was_pushed() {
        let mut ring = Ring::new(cells(64), 40, 24, u32::MAX - 100).expect("valid");
        let (mut producer, mut consumer) = ring.split();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for i in 0..100_000u32 {
                    while producer.push(i).is_err() {
                        std::thread::yield_now();
                    }
                }
            });
            let mut back = VecDeque::new();
            let mut next = 0u32;
            while next < 100_000 {
                match consumer.advance() {
                    None => std::thread::yield_now(),
                    Some(v) => {
                        assert_eq!(v, next);
                        back.push_back(v);
                        next += 1;
                        if next.is_multiple_of(37) {
                            while let Some(v) = consumer.retreat() {
                                assert_eq!(Some(v), back.pop_back());
                            }
                            assert_eq!(consumer.reached().wrapping_sub(consumer.head()), next.min(40));
                            for v in next - next.min(40)..next {
                                assert_eq!(consumer.advance(), Some(v));
                                back.push_back(v);
                            }
                        }
                    }
                }
            }
        });
    }
}
