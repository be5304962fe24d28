//! The record ring between planning and motion: history | cursor | look-ahead (REV-2 … REV-7, design idea 2).
//!
//! Four positions, `head ≤ read ≤ reached ≤ write`, all wrapping u32 place numbers: `head` is the oldest record kept, `read`
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

use crate::place::before;
use crate::sync::{AtomicU32, Ordering, UnsafeCell};

/// One cell of a ring's storage.
#[derive(Debug, Default)]
pub struct Cell<R>(UnsafeCell<R>);

// SAFETY: the content is private to this module, which reaches it only through the one `Producer` and the one `Consumer` of a
// ring, and these never touch the same cell at a time (module invariant; model: verification, loom).
unsafe impl<R: Send> Sync for Cell<R> {}

/// Storage and shared positions of a ring; [`Ring::split`] gives its two ends.
#[derive(Debug)]
pub struct Ring<S> {
    cells: S,
    keep: u32,
    look_ahead: u32,
    start: u32,
    floor: AtomicU32,
    write: AtomicU32,
}

/// Why a ring cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RingError {
    /// The number of cells is not a power of two, or above 2³⁰.
    NotAPowerOfTwo,
    /// `keep + look_ahead` is more than there are cells, or `look_ahead` is zero.
    TooSmall,
}

impl<R, S: Deref<Target = [Cell<R>]>> Ring<S> {
    /// A ring over `cells` (a power of two of them, at most 2³⁰) that keeps `keep` records behind `reached` and lets at most
    /// `look_ahead` records be planned beyond it. Its first record will have the place number `start`.
    pub fn new(cells: S, keep: u32, look_ahead: u32, start: u32) -> Result<Self, RingError> {
        let n = cells.len();
        if !n.is_power_of_two() || n > 1 << 30 {
            return Err(RingError::NotAPowerOfTwo);
        }
        if look_ahead == 0 || keep as u64 + look_ahead as u64 > n as u64 {
            return Err(RingError::TooSmall);
        }
        let floor = AtomicU32::new(start.wrapping_sub(keep));
        Ok(Self { cells, keep, look_ahead, start, floor, write: AtomicU32::new(start) })
    }

    /// The two ends; one pair at a time.
    pub fn split(&mut self) -> (Producer<'_, R>, Consumer<'_, R>) {
        let write = self.write.load(Ordering::Relaxed);
        let floor = self.floor.load(Ordering::Relaxed);
        let reached = floor.wrapping_add(self.keep);
        let head = if before(floor, self.start) { self.start } else { floor };
        let shared = Shared { cells: &self.cells, floor: &self.floor, write: &self.write };
        (
            Producer { shared, room: self.keep + self.look_ahead, floor, write },
            Consumer { shared, keep: self.keep, head, read: reached, reached, write },
        )
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
    room: u32,
    /// As last seen; the shared word only grows, so an old value is on the safe side.
    floor: u32,
    write: u32,
}

impl<R: Copy> Producer<'_, R> {
    /// Appends a record; gives it back where the look-ahead is full.
    #[inline]
    pub fn push(&mut self, record: R) -> Result<(), R> {
        if self.write.wrapping_sub(self.floor) >= self.room {
            self.floor = self.shared.floor.load(Ordering::Acquire);
            if self.write.wrapping_sub(self.floor) >= self.room {
                return Err(record);
            }
        }
        // SAFETY: `write − floor < keep + look_ahead ≤ cells`, so this cell is none of `floor … write`, the only ones that
        // the consumer may read before the store below; the Acquire above orders its last reads of it before this write.
        self.shared.cell(self.write).with_mut(|p| unsafe { *p = record });
        self.write = self.write.wrapping_add(1);
        self.shared.write.store(self.write, Ordering::Release);
        Ok(())
    }

    /// The place number that the next record will have.
    #[must_use]
    pub fn write(&self) -> u32 {
        self.write
    }
}

/// The motion path's end: reads anywhere in `head … write`, moves the cursor, and lets history go.
#[derive(Debug)]
pub struct Consumer<'a, R> {
    shared: Shared<'a, R>,
    keep: u32,
    head: u32,
    read: u32,
    reached: u32,
    /// As last seen; the shared word only grows.
    write: u32,
}

impl<R: Copy> Consumer<'_, R> {
    /// Oldest record kept.
    #[must_use]
    pub fn head(&self) -> u32 {
        self.head
    }

    /// The cursor: the record that would be read next going forward.
    #[must_use]
    pub fn read(&self) -> u32 {
        self.read
    }

    /// The furthest place ever executed; the source's W.
    #[must_use]
    pub fn reached(&self) -> u32 {
        self.reached
    }

    /// The end of what is planned, looked up anew.
    #[inline]
    pub fn write(&mut self) -> u32 {
        self.write = self.shared.write.load(Ordering::Acquire);
        self.write
    }

    /// The record at `place`, if it lies in `head … write` as last seen by [`Consumer::write`] or [`Consumer::forward`].
    #[inline]
    #[must_use]
    pub fn record(&self, place: u32) -> Option<R> {
        if place.wrapping_sub(self.head) >= self.write.wrapping_sub(self.head) {
            return None;
        }
        // SAFETY: `head ≤ place < write`: written before the Release store that `write` was loaded from (Acquire), and not
        // written again before `floor` has passed it, which only `settle` does, through `&mut self`.
        Some(self.shared.cell(place).with(|p| unsafe { *p }))
    }

    /// Reads the record under the cursor and moves it forward (REV-5, REV-7); `None` at `write`.
    #[inline]
    pub fn forward(&mut self) -> Option<R> {
        if self.read == self.write {
            self.write();
        }
        let record = self.record(self.read)?;
        self.settle(self.read.wrapping_add(1));
        Some(record)
    }

    /// Moves the cursor back and reads the record it passes (REV-6); `None` at `head`.
    #[inline]
    pub fn backward(&mut self) -> Option<R> {
        if self.read == self.head {
            return None;
        }
        let record = self.record(self.read.wrapping_sub(1))?;
        self.read = self.read.wrapping_sub(1);
        Some(record)
    }

    /// Puts the cursor on `place`, as the card reports it; false, and nothing changed, where that is not in `head … write`.
    #[inline]
    pub fn follow(&mut self, place: u32) -> bool {
        let held = place.wrapping_sub(self.head) <= self.write.wrapping_sub(self.head);
        if held {
            self.settle(place);
        }
        held
    }

    /// The cursor stands at `read`, within `head … write`: `reached` follows it forward, and `floor` and `head` follow `reached`.
    #[inline]
    fn settle(&mut self, read: u32) {
        self.read = read;
        if before(self.reached, read) {
            self.reached = read;
            let floor = read.wrapping_sub(self.keep);
            if before(self.head, floor) {
                self.head = floor;
            }
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
    }

    #[test]
    fn the_empty_ring_stops_at_once_in_both_directions() {
        let mut ring = Ring::new(cells(4), 2, 2, 9).expect("valid");
        let (_, mut consumer) = ring.split();
        assert_eq!(consumer.backward(), None);
        assert_eq!(consumer.forward(), None);
        assert!(!consumer.follow(10) && !consumer.follow(8) && consumer.follow(9));
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
                        prop_assert_eq!(producer.push(all.len() as u32).is_err(), full);
                        if !full { all.push(all.len() as u32); }
                    }
                    2 => {
                        let want = all.get(read).copied();
                        prop_assert_eq!(consumer.forward(), want);
                        if want.is_some() { read += 1; reached = reached.max(read); }
                    }
                    _ => {
                        let oldest = reached.saturating_sub(keep as usize);
                        let want = if read > oldest { read -= 1; Some(all[read]) } else { None };
                        prop_assert_eq!(consumer.backward(), want);
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
                match consumer.forward() {
                    None => std::thread::yield_now(),
                    Some(v) => {
                        assert_eq!(v, next);
                        back.push_back(v);
                        next += 1;
                        if next.is_multiple_of(37) {
                            while let Some(v) = consumer.backward() {
                                assert_eq!(Some(v), back.pop_back());
                            }
                            assert_eq!(consumer.reached().wrapping_sub(consumer.head()), next.min(40));
                            for v in next - next.min(40)..next {
                                assert_eq!(consumer.forward(), Some(v));
                                back.push_back(v);
                            }
                        }
                    }
                }
            }
        });
    }
}
