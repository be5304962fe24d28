//! The planning thread: takes decoded blocks off the channel and gives their moves and switching to the plan writer.
//!
//! Invariant: it ends when the program ends or planning is cancelled, whatever the decoder is doing.

use std::sync::Arc;
use std::sync::atomic::AtomicU32;
use std::sync::mpsc::Sender;
use std::thread;
use std::time::Duration;

use retrace_config::MachineConfig;
use retrace_gcode::{Axis, Canon, CanonStep};

use crate::batch_channel::BatchReceiver;
use crate::canon_error::CanonError;
use crate::canon_executor::CanonExecutor;
use crate::decoding::BlockBatch;
use crate::plan_item::{PlanEnd, PlanSummary};
use crate::plan_writer::{Cancelled, PlanWriter};
use crate::question::MachineResult;
use crate::start_line::{SkippedBlocks, StartPoint};

/// Plans until the program ends or planning is cancelled; in the first case, returns the summary. `start`: where to
/// begin, if not at the first block, and where the number of contours before is stored. `rests`: the blocks behind
/// which the path rests, because an earlier run ended there. `answers`: what probing moves have found, for the decoder.
pub(crate) fn plan<const A: usize>(
    machine: &MachineConfig,
    receiver: BatchReceiver<'_, BlockBatch>,
    batch: BlockBatch,
    (start, rests): (Option<(StartPoint, Arc<AtomicU32>)>, Vec<u64>),
    plan_writer: PlanWriter<'_, A>,
    answers: Sender<MachineResult>,
) -> Option<PlanSummary> {
    let skipped = start.map(|(start, contours)| (start, SkippedBlocks::new(*plan_writer.outputs(), machine, contours)));
    PlanningThread {
        machine,
        executor: CanonExecutor::new(machine).with_outputs(plan_writer.outputs()),
        skipped,
        plan_writer,
        answers,
        rests,
        blocks: 0,
        canonical: 0,
    }
    .run(&receiver, batch)
}

struct PlanningThread<'m, 'r, const A: usize> {
    machine: &'m MachineConfig,
    executor: CanonExecutor<'m>,
    /// Where to begin, and what the blocks before have switched.
    skipped: Option<(StartPoint, SkippedBlocks)>,
    plan_writer: PlanWriter<'r, A>,
    answers: Sender<MachineResult>,
    rests: Vec<u64>,
    blocks: u64,
    canonical: u64,
}

impl<const A: usize> PlanningThread<'_, '_, A> {
    fn run(mut self, receiver: &BatchReceiver<'_, BlockBatch>, mut batch: BlockBatch) -> Option<PlanSummary> {
        let ending = loop {
            self.next_batch(receiver, &mut batch)?;
            match self.write_batch(&mut batch) {
                Ok(()) => {}
                Err((CanonError::Cancelled, _)) => return None,
                Err((why, line)) => break PlanEnd::BlockError(format!("line {line}: {}", why.explain())),
            }
            if let Some(ending) = batch.ending.take() {
                match self.end_thread() {
                    Err((CanonError::Cancelled, _)) => return None,
                    Err((why, line)) => break PlanEnd::BlockError(format!("line {line}: {}", why.explain())),
                    Ok(()) => {}
                }
                break ending;
            }
        };
        if let PlanEnd::BlockError(_) = ending {
            self.plan_writer.record_early_end(self.blocks);
        }
        let commanded_mm = self.plan_writer.commanded_mm()[..self.machine.axes.len().min(A)].to_vec();
        let summary = PlanSummary { ending, blocks: self.blocks, canonical: self.canonical, commanded_mm };
        self.plan_writer.end(summary.clone()).ok()?;
        receiver.cancel();
        // A tool length may be entered as long as the job lasts.
        while self.plan_writer.mark_planned().is_ok() {
            thread::sleep(Duration::from_millis(1));
        }
        Some(self.correct_end(summary))
    }

    /// Corrects the end position to the machine's, if a tool length was entered behind the last move to a machine
    /// position.
    fn correct_end(&self, mut summary: PlanSummary) -> PlanSummary {
        if let Some((axis, mm)) = self.plan_writer.moved_by()
            && let Some(commanded_mm) = summary.commanded_mm.get_mut(axis)
        {
            *commanded_mm += mm;
        }
        summary
    }

    /// Waits for something to plan; `None` where nothing will come, or planning is cancelled.
    fn next_batch(&mut self, receiver: &BatchReceiver<'_, BlockBatch>, batch: &mut BlockBatch) -> Option<()> {
        receiver.receive(batch, |tries| {
            self.plan_writer.mark_planned().ok()?;
            match tries {
                0..20 => thread::yield_now(),
                20..200 => thread::sleep(Duration::from_micros(50)),
                _ => thread::sleep(Duration::from_millis(1)),
            }
            Some(())
        })
    }

    /// Gives a batch to the plan writer, block by block. Returns the error and its line where a step cannot be
    /// executed.
    fn write_batch(&mut self, batch: &mut BlockBatch) -> Result<(), (CanonError, u32)> {
        let mut first = 0;
        let mut modes = batch.modes.drain(..).peekable();
        for (block, &end) in (0u32..).zip(&batch.ends) {
            if !self.executor.continues_thread(&batch.steps[first..end as usize]) {
                self.end_thread()?;
            }
            if let Some((_, active)) = modes.next_if(|(from, _)| *from == block) {
                self.plan_writer.set_active_codes(active);
            }
            self.write_block(&batch.steps[first..end as usize])?;
            first = end as usize;
            self.blocks += 1;
            if self.rests.contains(&self.blocks) {
                self.end_thread()?;
                self.plan_writer.rest().map_err(|cancelled| (cancelled.into(), 0))?;
            }
        }
        // State behind the last block, which ends the program.
        modes.for_each(|(_, active)| self.plan_writer.set_active_codes(active));
        match &batch.steps[first..] {
            // A batch ends where the decoder happened to be: that begins no block.
            [] if self.blocks > 0 => Ok(()),
            steps => self.write_block(steps),
        }
    }

    /// Gives a thread that was collected to the plan writer, or only records it before the start line. Returns the
    /// error and the line in which it begins.
    fn end_thread(&mut self) -> Result<(), (CanonError, u32)> {
        let line = self.executor.thread_line();
        let result = match &mut self.skipped {
            Some((_, before)) => self.executor.end_thread::<A>(before),
            None => self.executor.end_thread(&mut self.plan_writer),
        };
        result.map_err(|why| (why, line))
    }

    /// Gives a block's steps to the plan writer; those before the start line are only recorded.
    fn write_block(&mut self, steps: &[CanonStep]) -> Result<(), (CanonError, u32)> {
        self.plan_writer.begin_block(self.blocks + 1);
        let ends_length = steps.iter().any(|step| self.executor.ends_entered_length(&step.canon));
        self.plan_writer.set_block_has_end(ends_length);
        for step in steps {
            let begins = self.skipped.as_ref().is_some_and(|(start, before)| before.reaches(*start, step.line));
            if begins {
                self.end_thread()?;
            }
            if begins && let Some((_, before)) = self.skipped.take() {
                let line = step.line;
                let position = self.executor.position();
                let restored = before.restore(&mut self.plan_writer, position, self.machine, line);
                if restored.map_err(|why| (why.into(), line))? {
                    self.executor.record_lift();
                }
            }
            if ends_length && self.skipped.is_none() && self.executor.ends_entered_length(&step.canon) {
                self.end_length(step.canon == Canon::MachineCoordinates)
                    .map_err(|cancelled| (cancelled.into(), step.line))?;
            }
            let result = match &mut self.skipped {
                Some(_) if matches!(step.canon, Canon::StraightProbe(..) | Canon::Wait(_)) => {
                    Err(CanonError::NotSupported("a start behind a question to the machine (G38, M66)"))
                }
                Some((_, before)) => self.executor.execute::<A>(&step.canon, step.line, before),
                None => self.executor.execute(&step.canon, step.line, &mut self.plan_writer),
            };
            result.map_err(|why| (why, step.line))?;
            if let Some(learned) = self.executor.take_learned() {
                // A decoder that has ended needs no answer.
                let _ = self.answers.send(learned);
            }
            self.canonical += u64::from(step.canon != Canon::MachineCoordinates);
        }
        if ends_length || self.blocks == 0 {
            self.pass_tool_length();
        }
        self.plan_writer.set_block_has_end(false);
        Ok(())
    }

    /// Ends a path that was moved along the tool axis because a tool length was entered.
    fn end_length(&mut self, is_move: bool) -> Result<(), Cancelled> {
        if let Some((axis, mm)) = self.plan_writer.end_length(is_move)? {
            self.executor.correct_length(Axis::ALL[self.machine.axes[axis].index()], mm);
        }
        Ok(())
    }

    fn pass_tool_length(&mut self) {
        let axis = self.machine.tool_axis().map(|tool| Axis::ALL[self.machine.axes[tool].index()]);
        self.plan_writer.set_tool_length(axis.and_then(|axis| self.executor.tool_length_mm(axis)));
    }
}
