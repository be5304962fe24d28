//! Decoding in its own thread: blocks become steps, which a channel of two batches ([`crate::batch_channel`]) passes to
//! the planning thread.
//!
//! Invariant: the planning side never waits for more than the first block available. Batches are exchanged, so that
//! nothing is allocated per block except a modal state that has changed. The amount decoded ahead is bounded.

use std::sync::mpsc::Receiver;

use retrace_gcode::{ActiveCodes, Canon, CanonStep};

use crate::batch_channel::{Batch, BatchChannel, BatchSender};
use crate::block_decoder::{BlockDecoder, DecodedBlock};
use crate::plan_item::PlanEnd;
use crate::question::MachineResult;

/// Number of steps after which the decoder waits until the batch is taken. A block may have any number.
const MAX_STEPS: usize = 2048;

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

    /// Creates an empty channel, and the batch with which the planner begins.
    pub(crate) fn channel() -> (BatchChannel<Self>, Self) {
        (BatchChannel::new(Self::with_capacity()), Self::with_capacity())
    }

    /// Adds a block, and the modal state where it has changed.
    fn add(&mut self, steps: &mut Vec<CanonStep>, changed: Option<Box<ActiveCodes>>, decoded: DecodedBlock) {
        self.steps.append(steps);
        if let Some(active) = changed {
            let block = self.ends.len() as u32;
            self.modes.push((block, active));
        }
        match decoded {
            DecodedBlock::Block => {
                let end = self.steps.len() as u32;
                self.ends.push(end);
            }
            DecodedBlock::End => self.ending = Some(PlanEnd::Completed),
            DecodedBlock::BlockError(text) => self.ending = Some(PlanEnd::BlockError(text)),
        }
    }
}

impl Batch for BlockBatch {
    fn is_empty(&self) -> bool {
        self.ends.is_empty() && self.ending.is_none()
    }

    fn has_space(&self) -> bool {
        self.steps.len() < MAX_STEPS && self.ends.len() < MAX_STEPS
    }

    fn clear(&mut self) {
        self.steps.clear();
        self.ends.clear();
        self.modes.clear();
        self.ending = None;
    }
}

/// The decoding thread: decodes block by block until the program ends or is cancelled.
///
/// Behind a question to the machine it waits for what `answers` brings: nothing behind the question is decoded
/// (PRB-11).
pub(crate) fn decode(
    program: &mut dyn BlockDecoder,
    sender: &BatchSender<'_, BlockBatch>,
    answers: &Receiver<MachineResult>,
) {
    let mut steps = Vec::with_capacity(64);
    let mut last_sent = None;
    loop {
        let decoded = program.next_block(&mut steps);
        let is_last = decoded != DecodedBlock::Block;
        let active = program.active();
        let changed = if active == last_sent { None } else { active.map(Box::new) };
        last_sent = active;
        let asks = steps.iter().any(|step| matches!(step.canon, Canon::StraightProbe(..) | Canon::Wait(_)));
        if !sender.send(|batch| batch.add(&mut steps, changed, decoded)) || is_last {
            return;
        }
        if asks {
            let Ok(result) = answers.recv() else { return };
            program.resolve(&result);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch_channel::BatchReceiver;
    use std::thread;

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
        let (channel, mut batch) = BlockBatch::channel();
        let receiver = BatchReceiver::new(&channel);
        let (mut lines, mut blocks) = (Vec::new(), 0);
        thread::scope(|scope| {
            scope.spawn(|| decode(&mut Counts(0), &BatchSender::new(&channel), &std::sync::mpsc::channel().1));
            loop {
                if !receiver.try_receive(&mut batch) {
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
        let (channel, _) = BlockBatch::channel();
        thread::scope(|scope| {
            let decoder =
                scope.spawn(|| decode(&mut Counts(0), &BatchSender::new(&channel), &std::sync::mpsc::channel().1));
            drop(BatchReceiver::new(&channel));
            decoder.join().expect("it ends");
        });
        assert!(channel.has_ended());
    }
}
