//! The channel of batches between a decoder and a planner.
//!
//! Runs `crates/controller/src/batch_channel.rs`: sending, waiting for space, exchanging, ending and cancelling. A
//! block is its number.
//!
//! Invariant: what was received is a beginning of what was sent, and all of it where nobody cancelled.

use crate::batch_channel::{Batch, BatchChannel, BatchReceiver, BatchSender};
use crate::sync::{Arc, thread};

/// Shape of a model.
#[derive(Clone, Copy, Debug)]
pub struct Blocks {
    /// Number of blocks that the decoder has.
    pub blocks: u32,
    /// Capacity of a batch.
    pub capacity: usize,
    /// Number of blocks after which the planner cancels.
    pub cancelled_after: Option<u32>,
}

#[derive(Debug)]
struct Numbers {
    numbers: Vec<u32>,
    capacity: usize,
}

impl Batch for Numbers {
    fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    fn has_space(&self) -> bool {
        self.numbers.len() < self.capacity
    }

    fn clear(&mut self) {
        self.numbers.clear();
    }
}

impl Blocks {
    /// Runs decoder and planner. Returns the number of batches.
    ///
    /// # Panics
    /// Where a block is missing, repeated or out of order, a batch is too long, or a batch is empty.
    #[must_use]
    pub fn run(self) -> u32 {
        let Self { blocks, capacity, cancelled_after } = self;
        let empty = || Numbers { numbers: Vec::new(), capacity };
        let channel = Arc::new(BatchChannel::new(empty()));
        let decoder = thread::spawn({
            let channel = Arc::clone(&channel);
            move || {
                let sender = BatchSender::new(&channel);
                (0..blocks).take_while(|number| sender.send(|batch| batch.numbers.push(*number))).count() as u32
            }
        });
        let (mut received, mut batches, mut batch) = (0, 0, empty());
        let receiver = BatchReceiver::new(&channel);
        let is_enough = |received| cancelled_after.is_some_and(|most| received >= most);
        let pause = |_| {
            thread::yield_now();
            Some(())
        };
        while !is_enough(received) && receiver.receive(&mut batch, pause).is_some() {
            assert!((1..=capacity).contains(&batch.numbers.len()), "{:?}", batch.numbers);
            for number in &batch.numbers {
                assert_eq!(*number, received, "in order, each once");
                received += 1;
            }
            batches += 1;
        }
        drop(receiver);
        let sent = decoder.join().expect("the decoder does not panic");
        assert!(received <= sent && (cancelled_after.is_some() || received == blocks), "{received} of {blocks}");
        batches
    }
}
