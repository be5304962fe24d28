//! Ring of bytes between an interrupt and the main loop.
//!
//! Invariant: one side only pushes and stores `head`, the other only pops and stores `tail`; both count bytes and only
//! grow, and `head − tail` is at most `N`.

use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

/// Ring of up to `N` bytes; `N` is a power of two. One context pushes, one pops.
pub struct ByteRing<const N: usize> {
    bytes: [AtomicU8; N],
    /// Total bytes pushed.
    head: AtomicU32,
    /// Total bytes popped.
    tail: AtomicU32,
}

impl<const N: usize> ByteRing<N> {
    /// Creates an empty ring.
    #[must_use]
    pub const fn new() -> Self {
        // a power of two, so that positions continue where the counts wrap around
        const { assert!(N.is_power_of_two() && N <= 1 << 16) };
        Self { bytes: [const { AtomicU8::new(0) }; N], head: AtomicU32::new(0), tail: AtomicU32::new(0) }
    }

    /// Appends a byte. Returns false and changes nothing if the ring is full. For the pushing side only.
    pub fn push(&self, byte: u8) -> bool {
        let head = self.head.load(Ordering::Relaxed);
        // acquire: the byte in the cell was read before the cell was released
        if head.wrapping_sub(self.tail.load(Ordering::Acquire)) as usize >= N {
            return false;
        }
        self.bytes[head as usize % N].store(byte, Ordering::Relaxed);
        self.head.store(head.wrapping_add(1), Ordering::Release);
        true
    }

    /// Removes and returns the oldest byte. For the popping side only.
    pub fn pop(&self) -> Option<u8> {
        let tail = self.tail.load(Ordering::Relaxed);
        if tail == self.head.load(Ordering::Acquire) {
            return None;
        }
        let byte = self.bytes[tail as usize % N].load(Ordering::Relaxed);
        self.tail.store(tail.wrapping_add(1), Ordering::Release);
        Some(byte)
    }

    /// Whether the ring is empty. For the popping side only.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.tail.load(Ordering::Relaxed) == self.head.load(Ordering::Acquire)
    }
}

impl<const N: usize> Default for ByteRing<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    proptest! {
        /// Any sequence of pushes and pops does what a queue of limited length does.
        #[test]
        fn it_is_a_queue(steps in prop::collection::vec(prop::option::of(any::<u8>()), 0..400)) {
            let ring = ByteRing::<8>::new();
            // just before the counts wrap around
            ring.head.store(u32::MAX - 20, Ordering::Relaxed);
            ring.tail.store(u32::MAX - 20, Ordering::Relaxed);
            let mut model = VecDeque::new();
            for step in steps {
                match step {
                    Some(byte) => {
                        let room = model.len() < 8;
                        if room { model.push_back(byte); }
                        prop_assert_eq!(ring.push(byte), room);
                    }
                    None => prop_assert_eq!(ring.pop(), model.pop_front()),
                }
                prop_assert_eq!(ring.is_empty(), model.is_empty());
            }
        }
    }

    #[test]
    fn two_threads_lose_nothing_and_keep_the_order() {
        static RING: ByteRing<16> = ByteRing::new();
        const COUNT: u32 = 100_000;
        let producer = std::thread::spawn(|| {
            for n in 0..COUNT {
                while !RING.push((n % 251) as u8) {
                    std::thread::yield_now();
                }
            }
        });
        for n in 0..COUNT {
            let byte = loop {
                match RING.pop() {
                    Some(byte) => break byte,
                    None => std::thread::yield_now(),
                }
            };
            assert_eq!(u32::from(byte), n % 251);
        }
        producer.join().expect("the producer");
    }
}
