//! Models of the ring between two threads: one pushes, the other moves forward and backward over the retained records
//! (REV-2 … REV-7).
//!
//! Compiled in the loom and the shuttle crate over each one's own `sync`. Record number k, from 0, holds k, so reading
//! anything else means that a cell was read before the other side was done with it.
//!
//! Invariant: a tape is run inside one execution of an engine and ends with everything pushed and everything read.

use retrace_core::RecordIndex;
use std::fmt;

use crate::ring::{Cell, Consumer, Producer, Ring};
use crate::sync::thread;

/// Shape of a model.
#[derive(Clone, Copy, Debug)]
pub struct Tape {
    /// Number of records retained behind the furthest place.
    pub keep: u32,
    /// Number of records planned beyond it; with `keep` a power of two, the number of cells.
    pub look_ahead: u32,
    /// Place number of the first record.
    pub start: u32,
    /// Number of records.
    pub records: u32,
    /// Number of records that are staged before they are published.
    pub staged: u32,
    /// Number of records after which the consumer goes back as far as the history allows, and forward again.
    pub turn: u32,
}

/// Outcome of one execution: how often each side found nothing to do.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Outcome {
    /// Pushes refused because the look-ahead was full.
    pub refused: u32,
    /// Number of times that the consumer was at the end of the planned records.
    pub starved: u32,
}

impl Outcome {
    /// The outcome with each count limited to `most`.
    #[must_use]
    pub fn capped(self, most: u32) -> Self {
        Self { refused: self.refused.min(most), starved: self.starved.min(most) }
    }
}

impl fmt::Debug for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "refused {} starved {}", self.refused, self.starved)
    }
}

impl Tape {
    /// Runs the two threads with a consumer that moves by [`Consumer::advance`] and [`Consumer::retreat`].
    ///
    /// # Panics
    /// Where anything is read that was not pushed, or the history is not as specified.
    #[must_use]
    pub fn walk(self) -> Outcome {
        self.run(|consumer| self.walk_through(consumer))
    }

    /// Runs the two threads with a consumer that reads records by place and follows the card's cursor, as the
    /// controller does.
    ///
    /// # Panics
    /// Where anything is read that was not pushed, or the history is not as specified.
    #[must_use]
    pub fn follow(self) -> Outcome {
        self.run(|consumer| self.follow_through(consumer))
    }

    /// Runs the two threads with a consumer that asks for every place around the end of the planned records, as it was
    /// last observed, and before the history. The planner may be writing each of these cells at that time.
    ///
    /// # Panics
    /// Where anything is read that was not pushed.
    #[must_use]
    pub fn ask(self) -> Outcome {
        self.run(|consumer| self.ask_through(consumer))
    }

    fn run(self, consume: impl FnOnce(&mut Consumer<'static, u32>) -> u32) -> Outcome {
        let cells: Box<[Cell<u32>]> = (0..self.keep + self.look_ahead).map(|_| Cell::new(u32::MAX)).collect();
        let ring =
            Ring::new(cells, self.keep, self.look_ahead, RecordIndex::new(self.start)).expect("the shape is valid");
        // The ends borrow the ring and a thread borrows for ever, so each execution leaks a few hundred bytes.
        let (mut producer, mut consumer) = Box::leak(Box::new(ring)).split();
        let planner = thread::spawn(move || push_all(&mut producer, self));
        let starved = consume(&mut consumer);
        let refused = planner.join().expect("the planner does not panic");
        Outcome { refused, starved }
    }

    fn walk_through(self, consumer: &mut Consumer<'_, u32>) -> u32 {
        let (mut next, mut starved) = (0, 0);
        while next < self.records {
            let Some(record) = consumer.advance() else {
                starved += 1;
                thread::yield_now();
                continue;
            };
            assert_eq!(record, next);
            next += 1;
            if next % self.turn == 0 || next == self.records {
                let kept = next.min(self.keep);
                for back in 0..kept {
                    assert_eq!(consumer.retreat(), Some(next - 1 - back));
                }
                assert_eq!(consumer.retreat(), None, "history is what is kept and no more");
                for again in next - kept..next {
                    assert_eq!(consumer.advance(), Some(again));
                }
            }
        }
        starved
    }

    fn follow_through(self, consumer: &mut Consumer<'_, u32>) -> u32 {
        let (mut reached, mut starved) = (0, 0);
        while reached < self.records {
            let planned = consumer.write().since(RecordIndex::new(self.start));
            if planned == reached {
                starved += 1;
                thread::yield_now();
                continue;
            }
            // every record ahead is sent, and all but the last of them executed before the next report of the card
            self.check(consumer, reached, planned);
            reached = (planned - 1).max(reached + 1);
            assert!(consumer.seek(RecordIndex::new(self.start.wrapping_add(reached))));
            let oldest = reached - reached.min(self.keep);
            self.check(consumer, oldest, planned);
            if oldest > 0 {
                assert_eq!(
                    consumer.record(RecordIndex::new(self.start.wrapping_add(oldest - 1))),
                    None,
                    "what is let go is gone"
                );
            }
            if reached % self.turn == 0 {
                assert!(consumer.seek(RecordIndex::new(self.start.wrapping_add(oldest))));
                self.check(consumer, oldest, planned);
                assert!(consumer.seek(RecordIndex::new(self.start.wrapping_add(reached))));
            }
        }
        starved
    }

    fn ask_through(self, consumer: &mut Consumer<'_, u32>) -> u32 {
        let (mut next, mut starved) = (0, 0);
        let around = self.keep + self.look_ahead;
        while next < self.records {
            let planned = consumer.write().since(RecordIndex::new(self.start));
            let oldest = next - next.min(self.keep);
            // Beyond and before what is held. No answer is judged here (row `ring-holds` does that): the engine finds
            // out whether a cell is touched at all.
            for number in (planned..planned + around).chain(oldest.saturating_sub(around)..oldest) {
                let _ = consumer.record(RecordIndex::new(self.start.wrapping_add(number)));
            }
            match consumer.advance() {
                Some(record) => {
                    assert_eq!(record, next);
                    next += 1;
                }
                None => {
                    starved += 1;
                    thread::yield_now();
                }
            }
        }
        starved
    }

    /// Checks that every record of `from … to`, counted from the first, is what was pushed there.
    fn check(self, consumer: &Consumer<'_, u32>, from: u32, to: u32) {
        for number in from..to {
            assert_eq!(consumer.record(RecordIndex::new(self.start.wrapping_add(number))), Some(number));
        }
    }
}

fn push_all(producer: &mut Producer<'_, u32>, tape: Tape) -> u32 {
    let mut refused = 0;
    for number in 0..tape.records {
        while producer.stage(number).is_err() {
            if tape.staged > 1 {
                producer.publish();
            }
            refused += 1;
            thread::yield_now();
        }
        if (number + 1) % tape.staged == 0 || number + 1 == tape.records {
            producer.publish();
        }
    }
    refused
}
