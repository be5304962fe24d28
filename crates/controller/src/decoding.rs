//! Decoding in a thread of its own: blocks become steps, and these go over a belt of two batches to whoever plans.
//!
//! Invariant: the planning side never waits for more than the first block that there is; a batch goes to and fro, so that nothing is
//! allocated per block but a modal state that has changed; what is decoded ahead is bounded.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use retrace_gcode::{ActiveCodes, CanonStep};

use crate::job::{BlockDecoder, DecodedBlock};
use crate::plan_item::PlanEnd;

/// Steps after which the decoder waits until the batch is taken. A block has as many as it has.
const MAX_STEPS: usize = 2048;
/// So long a decoder with no room sleeps: less than a planner takes for a batch.
const NAP: Duration = Duration::from_micros(300);

/// Steps of whole blocks, in their order.
#[derive(Debug, Default)]
pub(crate) struct BlockBatch {
    /// The steps.
    pub(crate) steps: Vec<CanonStep>,
    /// Behind how many of the steps each block ends.
    pub(crate) ends: Vec<u32>,
    /// The modal state from a block of the batch on, wherever it changes.
    pub(crate) modes: Vec<(u32, Box<ActiveCodes>)>,
    /// How the program ended, behind the last step.
    pub(crate) ending: Option<PlanEnd>,
}

impl BlockBatch {
    fn with_room() -> Self {
        let (steps, ends) = (Vec::with_capacity(MAX_STEPS + 64), Vec::with_capacity(MAX_STEPS));
        Self { steps, ends, modes: Vec::with_capacity(MAX_STEPS), ending: None }
    }

    /// Empties it and keeps its room.
    pub(crate) fn clear(&mut self) {
        self.steps.clear();
        self.ends.clear();
        self.modes.clear();
        self.ending = None;
    }
}

/// The belt between decoder and planner.
#[derive(Debug)]
pub(crate) struct BatchChannel {
    batch: Mutex<BlockBatch>,
    /// The planner takes nothing any more.
    given_up: AtomicBool,
    /// The decoder gives nothing any more.
    ended: AtomicBool,
}

impl BatchChannel {
    /// An empty belt, and the batch that the planner begins with.
    pub(crate) fn new() -> (Self, BlockBatch) {
        let batch = Mutex::new(BlockBatch::with_room());
        (Self { batch, given_up: AtomicBool::new(false), ended: AtomicBool::new(false) }, BlockBatch::with_room())
    }

    /// Takes what there is for `batch`, which is given back to be filled; false, and nothing changed, where there is nothing.
    pub(crate) fn take(&self, batch: &mut BlockBatch) -> bool {
        // What is in a batch is whole blocks at all times, also where its holder panicked.
        let mut held = self.batch.lock().unwrap_or_else(PoisonError::into_inner);
        if held.ends.is_empty() && held.ending.is_none() {
            return false;
        }
        batch.clear();
        std::mem::swap(&mut *held, batch);
        true
    }

    /// Will nothing more come? To be asked before [`Belt::take`] finds nothing.
    pub(crate) fn ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }

    /// Nobody takes anything any more.
    pub(crate) fn give_up(&self) {
        self.given_up.store(true, Ordering::Relaxed);
    }

    /// Puts a block on the belt, and the modal state where it has changed; false where nobody takes it. Waits for room, with short naps: neither side wakes the other.
    fn put(&self, steps: &mut Vec<CanonStep>, changed: Option<Box<ActiveCodes>>, decoded: DecodedBlock) -> bool {
        while !self.given_up.load(Ordering::Relaxed) {
            let mut held = self.batch.lock().unwrap_or_else(PoisonError::into_inner);
            if held.steps.len() < MAX_STEPS && held.ends.len() < MAX_STEPS {
                held.steps.append(steps);
                if let Some(active) = changed {
                    let block = held.ends.len() as u32;
                    held.modes.push((block, active));
                }
                match decoded {
                    DecodedBlock::Block => {
                        let end = held.steps.len() as u32;
                        held.ends.push(end);
                    }
                    DecodedBlock::End => held.ending = Some(PlanEnd::Completed),
                    DecodedBlock::Refused(text) => held.ending = Some(PlanEnd::Refused(text)),
                }
                return true;
            }
            drop(held);
            thread::sleep(NAP);
        }
        false
    }
}

/// Says that nothing more comes, however the decoder ends.
struct BatchSender<'b>(&'b BatchChannel);

impl Drop for BatchSender<'_> {
    fn drop(&mut self) {
        self.0.ended.store(true, Ordering::Release);
    }
}

/// The decoding thread: block by block until the program, or the interest in it, ends.
pub(crate) fn decode(program: &mut impl BlockDecoder, belt: &BatchChannel) {
    let _ends = BatchSender(belt);
    let mut steps = Vec::with_capacity(64);
    let mut told = None;
    loop {
        let decoded = program.next_block(&mut steps);
        let is_last = decoded != DecodedBlock::Block;
        let active = program.active();
        let changed = if active == told { None } else { active.map(Box::new) };
        told = active;
        if !belt.put(&mut steps, changed, decoded) || is_last {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_gcode::Canon;

    struct Counts(u32);

    impl BlockDecoder for Counts {
        fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
            self.0 += 1;
            for _ in 0..self.0 % 3 {
                steps.push(CanonStep { line: self.0, number: None, canon: Canon::FloodOn });
            }
            if self.0 == 10_000 { DecodedBlock::Refused("why".into()) } else { DecodedBlock::Block }
        }
    }

    #[test]
    fn every_step_comes_once_with_its_block_and_the_end_behind_the_last() {
        let (belt, mut batch) = BatchChannel::new();
        let (mut lines, mut blocks) = (Vec::new(), 0);
        thread::scope(|scope| {
            scope.spawn(|| decode(&mut Counts(0), &belt));
            loop {
                if !belt.take(&mut batch) {
                    thread::yield_now();
                    continue;
                }
                let mut first = 0;
                for &end in &batch.ends {
                    blocks += 1;
                    assert!(batch.steps[first..end as usize].iter().all(|step| step.line == blocks));
                    first = end as usize;
                }
                lines.extend(batch.steps.iter().map(|step| step.line));
                assert!(batch.steps.len() < MAX_STEPS + 3 && batch.ends.len() <= MAX_STEPS);
                if let Some(ending) = &batch.ending {
                    assert_eq!(*ending, PlanEnd::Refused("why".into()));
                    break;
                }
            }
        });
        let all: Vec<u32> = (1..=10_000).flat_map(|n| (0..n % 3).map(move |_| n)).collect();
        assert_eq!((blocks, lines), (9999, all));
    }

    #[test]
    fn a_decoder_that_nobody_listens_to_ends() {
        let (belt, _) = BatchChannel::new();
        thread::scope(|scope| {
            let decoder = scope.spawn(|| decode(&mut Counts(0), &belt));
            belt.give_up();
            decoder.join().expect("it ends");
        });
        assert!(belt.ended());
    }
}
