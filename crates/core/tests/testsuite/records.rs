//! Records, their flags, and their numbers in the ring.

use retrace_core::ring::{Cell, Ring, RingError};
use retrace_core::ring_indices::ConsumerIndices;
use retrace_core::{Flags, RecordIndex};

#[test]
fn flags_are_united_not_exchanged() {
    for (a, b) in (0..8).flat_map(|a| (0..8).map(move |b| (a, b))) {
        let united = Flags::from_bits(a).with(Flags::from_bits(b));
        assert_eq!(united.bits(), a | b);
    }
}

#[test]
fn a_producer_knows_the_number_of_its_next_record() {
    for start in [0, 1, 7, u32::MAX] {
        let start = RecordIndex::new(start);
        let cells: Box<[Cell<u32>]> = (0..8).map(|_| Cell::default()).collect();
        let mut ring = Ring::new(cells, 2, 4, start).expect("valid");
        let (mut producer, _) = ring.split();
        for pushed in 0..3 {
            assert_eq!(producer.write(), start + pushed);
            producer.push(pushed).expect("room");
        }
    }
}

/// Forward run ends at the furthest place, not before it and not behind.
#[test]
fn the_cursor_is_at_reached_there_alone() {
    for start in [0, 5, u32::MAX - 1] {
        for read in 0..=4u32 {
            let [head, read, reached, write] = [0, read, 2, 4].map(|n| start.wrapping_add(n));
            let Some(indices) = ConsumerIndices::at(head, read, reached, write, 4) else { continue };
            assert_eq!(indices.at_reached(), read == reached, "{read} of {reached}");
        }
        let before = ConsumerIndices::at(start, start.wrapping_add(1), start.wrapping_add(2), start.wrapping_add(4), 4);
        assert!(before.is_some_and(|indices| !indices.at_reached()));
    }
}

/// Each reason for which a ring is refused has a text of its own.
#[test]
fn a_refused_ring_has_its_reason_in_words() {
    let reasons = [RingError::NotAPowerOfTwo, RingError::TooSmall, RingError::InvalidSpan].map(|e| e.to_string());
    for (reason, part) in reasons.iter().zip(["power of two", "fewer cells", "not in order"]) {
        assert!(reason.contains(part), "{reason}");
    }
}
