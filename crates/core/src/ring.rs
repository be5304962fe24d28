//! The record ring between planner and motion: history | cursor | look-ahead (REV-2 … REV-7, design idea 2).
//!
//! Four positions ([`crate::ring_indices`]), `head ≤ read ≤ reached ≤ write`, are all wrapping u32 record numbers:
//! `head` is the oldest record retained, `read` the cursor, `reached` the furthest place ever executed (W in the
//! source), `write` the end of what is planned. Two numbers are shared between the threads, and both only grow:
//! `write`, and `floor`, which always equals `reached − keep`. `read` and `reached` belong to the consumer alone.
//!
//! Invariant: the producer writes only cells at `write < floor + keep + look_ahead`, the consumer reads only cells at
//! `head … write`, and `floor ≤ head`. As the ring has at least `keep + look_ahead` cells, neither side ever accesses a
//! cell that the other may access. Push and read return at once, also when the ring is full or empty.
//!
//! Initially `floor` is `keep` records before the first record, where nothing was ever written. `head` is the later of
//! `floor` and the first place, and equals `floor` from then on.

use core::ops::DerefMut;

use crate::RecordIndex;
use crate::ring_indices::{ConsumerIndices, ProducerIndices, is_cell_count, sizes_fit};
use crate::sync::{AtomicU32, CachePadded, Ordering, UnsafeCell};

/// Cell of a ring's storage.
#[derive(Debug, Default)]
pub struct Cell<R>(UnsafeCell<R>);

impl<R> Cell<R> {
    /// Creates a cell with that content.
    #[must_use]
    pub fn new(content: R) -> Self {
        Self(UnsafeCell::new(content))
    }
}

// SAFETY: the content is private to this module, which reaches it only through the ends of a ring. `split` borrows ring
// and storage exclusively, so that a cell is reached by one `Producer` and one `Consumer` only, and these never touch
// the same cell at a time (module invariant; rows `ring-apart`, `ring-sizes` and `ring-threads` of the ledger). What
// one of them writes the other reads in another thread, so it must be `Send`. The examples of `Ring` that must not
// compile are the checks of the types' part.
unsafe impl<R: Send> Sync for Cell<R> {}

/// Storage and shared positions of a ring; [`Ring::split`] returns its two ends.
///
/// # Examples
///
/// ```
/// use retrace_core::RecordIndex;
/// use retrace_core::ring::{Cell, Ring};
///
/// // four records of history, four of look-ahead
/// let cells: Vec<Cell<u32>> = (0..8).map(|_| Cell::default()).collect();
/// let mut ring = Ring::new(cells, 4, 4, RecordIndex::new(0))?;
/// let (mut planner, mut motion) = ring.split();
/// assert!((10..14).all(|record| planner.push(record).is_ok()));
/// assert_eq!(planner.push(14), Err(14), "the look-ahead is full");
/// assert_eq!((motion.advance(), motion.advance()), (Some(10), Some(11)));
/// assert_eq!(motion.retreat(), Some(11), "the same record, backward");
/// assert_eq!(motion.advance(), Some(11), "and forward again");
/// # Ok::<(), retrace_core::ring::RingError>(())
/// ```
///
/// A ring has one pair of ends at a time:
///
/// ```compile_fail,E0499
/// # use retrace_core::RecordIndex;
/// # use retrace_core::ring::{Cell, Ring};
/// # let cells: Vec<Cell<u32>> = (0..8).map(|_| Cell::default()).collect();
/// let mut ring = Ring::new(cells, 4, 4, RecordIndex::new(0)).unwrap();
/// let first = ring.split();
/// let second = ring.split();
/// drop(first);
/// ```
///
/// Cells belong to one ring at a time:
///
/// ```compile_fail,E0499
/// # use retrace_core::RecordIndex;
/// # use retrace_core::ring::{Cell, Ring};
/// # let mut cells: Vec<Cell<u32>> = (0..8).map(|_| Cell::default()).collect();
/// let first = Ring::new(&mut cells[..], 4, 4, RecordIndex::new(0));
/// let second = Ring::new(&mut cells[..], 4, 4, RecordIndex::new(0));
/// drop(first);
/// ```
///
/// and are not shared with another:
///
/// ```compile_fail,E0277
/// # use retrace_core::RecordIndex;
/// # use retrace_core::ring::{Cell, Ring};
/// # let cells: Vec<Cell<u32>> = (0..8).map(|_| Cell::default()).collect();
/// let ring = Ring::new(&cells[..], 4, 4, RecordIndex::new(0));
/// ```
///
/// What may not be sent to another thread does not cross a ring either:
///
/// ```compile_fail,E0277
/// # use retrace_core::RecordIndex;
/// # use retrace_core::ring::{Cell, Ring};
/// let shared = std::cell::Cell::new(0);
/// # let cells: Vec<_> = (0..8).map(|_| Cell::new(&shared)).collect();
/// let mut ring = Ring::new(cells, 4, 4, RecordIndex::new(0)).unwrap();
/// let (mut planner, motion) = ring.split();
/// std::thread::scope(|scope| scope.spawn(move || planner.slots()).join());
/// ```
#[derive(Debug)]
pub struct Ring<S> {
    cells: S,
    keep: u32,
    look_ahead: u32,
    history: u32,
    floor: CachePadded<AtomicU32>,
    write: CachePadded<AtomicU32>,
}

/// Reason why a ring cannot be created.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RingError {
    /// The number of cells is not a power of two, or is above 2³⁰.
    NotAPowerOfTwo,
    /// `keep + look_ahead` exceeds the number of cells, or `look_ahead` is zero.
    TooSmall,
    /// The places are not in order, or span more records than the ring can hold.
    InvalidSpan,
}

impl core::fmt::Display for RingError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::NotAPowerOfTwo => "the number of cells is not a power of two up to 2^30",
            Self::TooSmall => "the ring has fewer cells than history and look-ahead need",
            Self::InvalidSpan => "the positions of the ring are not in order",
        })
    }
}

impl core::error::Error for RingError {}

/// Span of the records in a ring: history `head … reached`, look-ahead `reached … write`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordSpan {
    /// Oldest record.
    pub head: RecordIndex,
    /// The furthest place ever executed.
    pub reached: RecordIndex,
    /// Place after the newest record.
    pub write: RecordIndex,
}

impl<R, S: DerefMut<Target = [Cell<R>]>> Ring<S> {
    /// Creates a ring over `cells` (a power of two, at most 2³⁰), which it holds exclusively. The ring retains `keep`
    /// records behind `reached` and allows at most `look_ahead` records to be planned beyond it. Its first record has
    /// the number `start`.
    ///
    /// # Errors
    /// Returns an error if the sizes do not fit.
    pub fn new(cells: S, keep: u32, look_ahead: u32, start: RecordIndex) -> Result<Self, RingError> {
        Self::with_records(cells, keep, look_ahead, RecordSpan { head: start, reached: start, write: start })
    }

    /// Creates a ring over cells that already hold records: record `place` is in cell `place` modulo the number of
    /// cells. The cursor is at `reached`.
    ///
    /// # Errors
    /// Returns an error if the sizes do not fit or the span is not in order.
    pub fn with_records(cells: S, keep: u32, look_ahead: u32, span: RecordSpan) -> Result<Self, RingError> {
        let n = cells.len();
        if !is_cell_count(n) {
            return Err(RingError::NotAPowerOfTwo);
        }
        if !sizes_fit(n, keep, look_ahead) {
            return Err(RingError::TooSmall);
        }
        let [head, reached, write] = [span.head, span.reached, span.write].map(RecordIndex::number);
        if ConsumerIndices::at(head, reached, reached, write, keep).is_none()
            || write.wrapping_sub(reached) > look_ahead
        {
            return Err(RingError::InvalidSpan);
        }
        let floor = CachePadded(AtomicU32::new(reached.wrapping_sub(keep)));
        let history = reached.wrapping_sub(head);
        Ok(Self { cells, keep, look_ahead, history, floor, write: CachePadded(AtomicU32::new(write)) })
    }

    /// Returns the two ends; one pair at a time. A second pair begins without history.
    ///
    /// # Panics
    /// If the storage has fewer cells than the ring was created with, which no storage of the standard library has.
    pub fn split(&mut self) -> (Producer<'_, R>, Consumer<'_, R>) {
        let write = self.write.0.load(Ordering::Relaxed);
        let floor = self.floor.0.load(Ordering::Relaxed);
        let reached = floor.wrapping_add(self.keep);
        let history = core::mem::take(&mut self.history);
        // by `deref_mut`: nothing else reaches these cells as long as the ends live
        let cells: &[Cell<R>] = self.cells.deref_mut();
        let is_as_created = is_cell_count(cells.len()) && sizes_fit(cells.len(), self.keep, self.look_ahead);
        assert!(is_as_created, "the storage of a ring has shrunk");
        let shared = Shared { cells, floor: &self.floor.0, write: &self.write.0 };
        let producer = ProducerIndices::at(write, floor, self.keep + self.look_ahead);
        let consumer = ConsumerIndices::at(reached.wrapping_sub(history), reached, reached, write, self.keep);
        let Some(consumer) = consumer else { unreachable!("a ring's own positions are in order") };
        (Producer { shared, indices: producer }, Consumer { shared, indices: consumer })
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

/// Planner's end of the ring: appends records at `write`.
#[derive(Debug)]
pub struct Producer<'a, R> {
    shared: Shared<'a, R>,
    indices: ProducerIndices,
}

impl<R: Copy> Producer<'_, R> {
    /// Appends a record and publishes it, with what was staged before it.
    ///
    /// # Errors
    /// Returns the record if the look-ahead is full.
    #[inline]
    pub fn push(&mut self, record: R) -> Result<(), R> {
        self.stage(record)?;
        self.publish();
        Ok(())
    }

    /// Appends a record that the consumer does not see before [`Producer::publish`]. A consumer that waits for the next
    /// record fetches the cache line of `write` with each one published, which costs more than the record: a producer
    /// that has several records stages them and publishes once.
    ///
    /// # Errors
    /// Returns the record if the look-ahead is full.
    #[inline]
    pub fn stage(&mut self, record: R) -> Result<(), R> {
        if !self.has_room() {
            return Err(record);
        }
        let cell = self.shared.cell(self.indices.write());
        // SAFETY: `write − floor < keep + look_ahead ≤ cells`, so this cell is none of `floor … write`, the only ones
        // that the consumer may read before the store of `publish`; the Acquire above orders its last reads of it
        // before this write.
        cell.with_mut(|p| unsafe { *p = record });
        self.indices.advance();
        Ok(())
    }

    /// Lets the consumer read what was staged.
    #[inline]
    pub fn publish(&mut self) {
        self.shared.write.store(self.indices.write(), Ordering::Release);
    }

    /// Whether [`Producer::push`] would accept a record now.
    #[inline]
    pub fn has_room(&mut self) -> bool {
        if self.indices.is_full() {
            self.refresh_floor();
        }
        !self.indices.is_full()
    }

    /// Returns the number of records that can be pushed now.
    #[inline]
    pub fn slots(&mut self) -> u32 {
        self.refresh_floor();
        self.indices.slots()
    }

    /// Reads the floor that the consumer has published.
    #[inline]
    fn refresh_floor(&mut self) {
        self.indices.observe_floor(self.shared.floor.load(Ordering::Acquire));
    }

    /// Returns the number that the next record will have.
    #[must_use]
    pub fn write(&self) -> RecordIndex {
        RecordIndex::new(self.indices.write())
    }
}

/// Motion path's end of the ring: reads anywhere in `head … write`, moves the cursor, and releases history.
#[derive(Debug)]
pub struct Consumer<'a, R> {
    shared: Shared<'a, R>,
    indices: ConsumerIndices,
}

impl<R: Copy> Consumer<'_, R> {
    /// Returns the number of the oldest record retained.
    #[must_use]
    pub fn head(&self) -> RecordIndex {
        RecordIndex::new(self.indices.head())
    }

    /// Returns the cursor: the number of the record that would be read next in forward direction.
    #[must_use]
    pub fn read(&self) -> RecordIndex {
        RecordIndex::new(self.indices.read())
    }

    /// Returns the furthest place ever executed; W in the source.
    #[must_use]
    pub fn reached(&self) -> RecordIndex {
        RecordIndex::new(self.indices.reached())
    }

    /// Reads and returns the end of what is planned.
    #[inline]
    pub fn write(&mut self) -> RecordIndex {
        self.indices.observe_write(self.shared.write.load(Ordering::Acquire));
        RecordIndex::new(self.indices.write())
    }

    /// Returns record `index` if it is in `head … write`, as last read by [`Consumer::write`] or
    /// [`Consumer::advance`].
    #[inline]
    #[must_use]
    pub fn record(&self, index: RecordIndex) -> Option<R> {
        let place = index.number();
        self.indices.holds(place).then(|| self.read_cell(place))
    }

    /// Returns the content of the cell of `place`, which is in the ring, or was until the last move of the cursor,
    /// which has not been published yet.
    #[inline]
    fn read_cell(&self, place: u32) -> R {
        // SAFETY: `floor ≤ place < write`: written before the Release store that `write` was loaded from (Acquire), and
        // not written again before the shared floor has passed it, which only `publish` does, through `&mut self`.
        self.shared.cell(place).with(|p| unsafe { *p })
    }

    /// Reads the record under the cursor and moves the cursor forward (REV-5, REV-7); `None` at `write`.
    #[inline]
    pub fn advance(&mut self) -> Option<R> {
        if self.indices.read() == self.indices.write() {
            self.write();
        }
        let floor = self.indices.floor();
        let place = self.indices.advance_cursor()?;
        // wrapped in `Some` before the store, which nothing is moved across, so that it is copied only once
        let record = Some(self.read_cell(place));
        self.publish(floor);
        record
    }

    /// Moves the cursor back and reads the record it passes (REV-6); `None` at `head`.
    #[inline]
    pub fn retreat(&mut self) -> Option<R> {
        self.indices.retreat().map(|place| self.read_cell(place))
    }

    /// Sets the cursor to the start of record `index`, as reported by the card.
    ///
    /// Returns false and changes nothing if it is not in `head … write`.
    #[inline]
    pub fn seek(&mut self, index: RecordIndex) -> bool {
        let floor = self.indices.floor();
        let followed = self.indices.seek(index.number());
        self.publish(floor);
        followed
    }

    /// Publishes the floor to the planner if it has moved from `before`.
    #[inline]
    fn publish(&mut self, before: u32) {
        let floor = self.indices.floor();
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
        assert_eq!(Ring::new(cells(3), 1, 1, RecordIndex::new(0)).err(), Some(RingError::NotAPowerOfTwo));
        assert_eq!(Ring::new(cells(0), 0, 1, RecordIndex::new(0)).err(), Some(RingError::NotAPowerOfTwo));
        assert_eq!(Ring::new(cells(4), 4, 1, RecordIndex::new(0)).err(), Some(RingError::TooSmall));
        assert_eq!(Ring::new(cells(4), 1, 0, RecordIndex::new(0)).err(), Some(RingError::TooSmall));
        let holding = |head, reached, write| {
            let [head, reached, write] = [head, reached, write].map(RecordIndex::new);
            Ring::with_records(cells(4), 2, 2, RecordSpan { head, reached, write }).err()
        };
        assert_eq!(holding(u32::MAX, 1, 3), None);
        for (head, reached, write) in [(1, 0, 2), (0, 3, 4), (0, 2, 5), (0, 2, 1)] {
            assert_eq!(holding(head, reached, write), Some(RingError::InvalidSpan));
        }
    }

    #[test]
    #[should_panic(expected = "has shrunk")]
    fn storage_that_shrinks_is_not_split() {
        /// Long when it is looked at, short when it is borrowed.
        struct Shrinks(Box<[Cell<u32>]>);
        impl core::ops::Deref for Shrinks {
            type Target = [Cell<u32>];
            fn deref(&self) -> &[Cell<u32>] {
                &self.0
            }
        }
        impl DerefMut for Shrinks {
            fn deref_mut(&mut self) -> &mut [Cell<u32>] {
                &mut self.0[..2]
            }
        }
        let mut ring = Ring::new(Shrinks(cells(4)), 2, 2, RecordIndex::new(0)).expect("valid");
        let _ = ring.split();
    }

    #[test]
    fn a_second_pair_of_ends_goes_on_without_history() {
        let held: Box<[Cell<u32>]> = (0..4).map(Cell::new).collect();
        let mut ring = Ring::with_records(
            held,
            2,
            2,
            RecordSpan { head: RecordIndex::new(u32::MAX), reached: RecordIndex::new(1), write: RecordIndex::new(2) },
        )
        .expect("valid");
        let (mut producer, mut consumer) = ring.split();
        producer.push(7).expect("room");
        assert_eq!((consumer.retreat(), consumer.retreat(), consumer.retreat()), (Some(0), Some(3), None));
        assert!(consumer.seek(RecordIndex::new(2)));
        let (_, mut consumer) = ring.split();
        assert_eq!((consumer.retreat(), consumer.advance(), consumer.advance()), (None, Some(7), None));
    }

    #[test]
    fn a_record_is_read_by_its_number_while_it_is_held() {
        let held: Box<[Cell<u32>]> = (0..4).map(Cell::new).collect();
        let [head, reached, write] = [u32::MAX, 1, 2].map(RecordIndex::new);
        let mut ring = Ring::with_records(held, 2, 2, RecordSpan { head, reached, write }).expect("valid");
        let (_, consumer) = ring.split();
        for (index, record) in [(u32::MAX - 1, None), (u32::MAX, Some(3)), (0, Some(0)), (1, Some(1)), (2, None)] {
            assert_eq!(consumer.record(RecordIndex::new(index)), record, "{index}");
        }
    }

    #[test]
    fn the_empty_ring_stops_at_once_in_both_directions() {
        let mut ring = Ring::new(cells(4), 2, 2, RecordIndex::new(9)).expect("valid");
        let (_, mut consumer) = ring.split();
        assert_eq!(consumer.retreat(), None);
        assert_eq!(consumer.advance(), None);
        assert!(
            !consumer.seek(RecordIndex::new(10))
                && !consumer.seek(RecordIndex::new(8))
                && consumer.seek(RecordIndex::new(9))
        );
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
            let mut ring = Ring::new(cells(n as usize), keep, look_ahead, RecordIndex::new(start)).expect("valid");
            let (mut producer, mut consumer) = ring.split();
            let mut all: Vec<u32> = Vec::new();
            let (mut read, mut reached) = (0usize, 0usize);
            for operation in operations {
                match operation {
                    0 | 1 => {
                        let full = all.len() - reached == look_ahead as usize;
                        // the producer may lag in what it has observed, but here it always refreshes before it refuses
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
                prop_assert_eq!(consumer.read(), RecordIndex::new(start) + (read as u32));
                prop_assert_eq!(consumer.reached(), RecordIndex::new(start) + (reached as u32));
                prop_assert_eq!(consumer.head(), RecordIndex::new(start)
                    + (reached.saturating_sub(keep as usize) as u32));
                prop_assert_eq!(consumer.write(), RecordIndex::new(start) + (all.len() as u32));
            }
        }
    }

    /// Records in a test of two threads; under miri, which executes them one step at a time, fewer.
    const RECORDS: u32 = if cfg!(miri) { 400 } else { 100_000 };

    #[test]
    fn two_threads_forward_and_back_read_what_was_pushed() {
        let mut ring = Ring::new(cells(64), 40, 24, RecordIndex::new(u32::MAX - 100)).expect("valid");
        let (mut producer, mut consumer) = ring.split();
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for i in 0..RECORDS {
                    while producer.push(i).is_err() {
                        std::thread::yield_now();
                    }
                }
            });
            let mut back = VecDeque::new();
            let mut next = 0u32;
            while next < RECORDS {
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
                            assert_eq!(consumer.reached().since(consumer.head()), next.min(40));
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
