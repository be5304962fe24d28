//! Cells of a ring on the heap, for hosts (feature `alloc`).
//!
//! Invariant: no cell is written here, so that the operating system provides its memory when the ring first writes it:
//! a history of half an hour costs what was played, and not 32 MiB at once.

extern crate alloc;

use alloc::alloc::{Layout, alloc_zeroed, handle_alloc_error};
use alloc::boxed::Box;
use core::ptr::slice_from_raw_parts_mut;

use crate::Record;
use crate::ring::Cell;

/// Returns `count` cells whose content no consumer sees before a producer has written it.
///
/// # Panics
/// Where they are larger than any memory.
#[must_use]
pub fn unwritten_cells<const A: usize>(count: usize) -> Box<[Cell<Record<A>>]> {
    let layout = Layout::array::<Cell<Record<A>>>(count).expect("a ring is smaller than the memory");
    if layout.size() == 0 {
        return Box::default();
    }
    // SAFETY: the layout is not empty. A record consists of integers, so that zeros in every byte are a record, and a
    // cell holds nothing else. The memory is the box's alone, of the layout with which it will be freed.
    unsafe {
        let memory = alloc_zeroed(layout);
        if memory.is_null() {
            handle_alloc_error(layout);
        }
        Box::from_raw(slice_from_raw_parts_mut(memory.cast(), count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RecordIndex;
    use crate::ring::Ring;

    #[test]
    fn a_ring_over_them_returns_what_was_pushed() {
        assert_eq!(unwritten_cells::<3>(0).len(), 0);
        let start = RecordIndex::new(u32::MAX);
        let mut ring = Ring::new(unwritten_cells::<3>(8), 4, 4, start).expect("a ring");
        let (mut producer, mut consumer) = ring.split();
        for line in 1..4 {
            assert!(producer.push(Record { line, ..Record::default() }).is_ok());
        }
        assert_eq!(consumer.write(), start + 3);
        let lines = (0..3).map(|n| consumer.record(start + n).map(|record| record.line));
        assert_eq!(lines.collect::<Vec<_>>(), [Some(1), Some(2), Some(3)]);
    }
}
