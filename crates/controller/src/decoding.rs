//! Decoding in its own thread: blocks become steps, which a channel of two batches passes to the planning thread.
//!
//! Invariant: the planning side never waits for more than the first block available. Batches are exchanged, so that
//! nothing is allocated per block except a modal state that has changed. The amount decoded ahead is bounded.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use retrace_gcode::{ActiveCodes, CanonStep};

use crate::block_decoder::{BlockDecoder, DecodedBlock};
use crate::plan_item::PlanEnd;

/// Number of steps after which the decoder waits until the batch is taken. A block may have any number.
const MAX_STEPS: usize = 2048;
/// Interval at which a decoder without space polls: less than a planner takes for a batch.
const POLL_INTERVAL: Duration = Duration::from_micros(300);

/// Steps of whole blocks, in order.
#[derive(Debug, Default)]
pub(crate) struct BlockBatch {
    /// The steps.
    pub(crate) steps: Vec<CanonStep>,
    /// Number of steps up to the end of each block.
    pub(crate) ends: Vec<u32>,
    /// The modal state from a block of the batch on, wherever it changes.
    pub(crate) modes: Vec<(u32, Box<ActiveCodes>)>,
    /// How the program ended, behind the last step.
    pub(crate) ending: Option<PlanEnd>,
}

impl BlockBatch {
    fn with_capacity() -> Self {
        let (steps, ends) = (Vec::with_capacity(MAX_STEPS + 64), Vec::with_capacity(MAX_STEPS));
        Self { steps, ends, modes: Vec::with_capacity(MAX_STEPS), ending: None }
    }

    /// Empties the batch and keeps its capacity.
    pub(crate) fn clear(&mut self) {
        self.steps.clear();
        self.ends.clear();
        self.modes.clear();
        self.ending = None;
    }
}

/// The channel between decoder and planner.
#[derive(Debug)]
pub(crate) struct BatchChannel {
    batch: Mutex<BlockBatch>,
    /// The planner takes nothing any more.
    cancelled: AtomicBool,
    /// The decoder sends nothing any more.
    ended: AtomicBool,
}

impl BatchChannel {
    /// Creates an empty channel, and the batch with which the planner begins.
    pub(crate) fn new() -> (Self, BlockBatch) {
        let batch = Mutex::new(BlockBatch::with_capacity());
        (Self { batch, cancelled: AtomicBool::new(false), ended: AtomicBool::new(false) }, BlockBatch::with_capacity())
    }

    /// Exchanges `batch` for the pending one, if that is not empty. Returns whether it did.
    pub(crate) fn take_batch(&self, batch: &mut BlockBatch) -> bool {
        // A batch contains whole blocks at all times, also where its holder panicked.
        let mut held = self.batch.lock().unwrap_or_else(PoisonError::into_inner);
        if held.ends.is_empty() && held.ending.is_none() {
            return false;
        }
        batch.clear();
        std::mem::swap(&mut *held, batch);
        true
    }

    /// Whether nothing more will be sent. To be called before [`BatchChannel::take_batch`] finds nothing.
    pub(crate) fn has_ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }

    /// Cancels the channel from the receiving end.
    pub(crate) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Sends a block, and the modal state where it has changed. Returns false where the channel is cancelled. Waits for
    /// space with short pauses: neither side wakes the other.
    fn send_block(&self, steps: &mut Vec<CanonStep>, changed: Option<Box<ActiveCodes>>, decoded: DecodedBlock) -> bool {
        while !self.cancelled.load(Ordering::Relaxed) {
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
                    DecodedBlock::BlockError(text) => held.ending = Some(PlanEnd::BlockError(text)),
                }
                return true;
            }
            drop(held);
            thread::sleep(POLL_INTERVAL);
        }
        false
    }
}

/// Marks the channel as ended, however the decoder ends.
struct BatchSender<'b>(&'b BatchChannel);

impl Drop for BatchSender<'_> {
    fn drop(&mut self) {
        self.0.ended.store(true, Ordering::Release);
    }
}

/// The decoding thread: decodes block by block until the program ends or is cancelled.
pub(crate) fn decode(program: &mut impl BlockDecoder, channel: &BatchChannel) {
    let _ends = BatchSender(channel);
    let mut steps = Vec::with_capacity(64);
    let mut last_sent = None;
    loop {
        let decoded = program.next_block(&mut steps);
        let is_last = decoded != DecodedBlock::Block;
        let active = program.active();
        let changed = if active == last_sent { None } else { active.map(Box::new) };
        last_sent = active;
        if !channel.send_block(&mut steps, changed, decoded) || is_last {
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
            if self.0 == 10_000 { DecodedBlock::BlockError("why".into()) } else { DecodedBlock::Block }
        }
    }

    #[test]
    fn every_step_comes_once_with_its_block_and_the_end_behind_the_last() {
        let (channel, mut batch) = BatchChannel::new();
        let (mut lines, mut blocks) = (Vec::new(), 0);
        thread::scope(|scope| {
            scope.spawn(|| decode(&mut Counts(0), &channel));
            loop {
                if !channel.take_batch(&mut batch) {
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
                    assert_eq!(*ending, PlanEnd::BlockError("why".into()));
                    break;
                }
            }
        });
        let all: Vec<u32> = (1..=10_000).flat_map(|n| (0..n % 3).map(move |_| n)).collect();
        assert_eq!((blocks, lines), (9999, all));
    }

    #[test]
    fn a_decoder_that_nobody_listens_to_ends() {
        let (channel, _) = BatchChannel::new();
        thread::scope(|scope| {
            let decoder = scope.spawn(|| decode(&mut Counts(0), &channel));
            channel.cancel();
            decoder.join().expect("it ends");
        });
        assert!(channel.has_ended());
    }
}
