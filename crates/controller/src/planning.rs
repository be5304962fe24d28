//! The planning thread: takes decoded blocks off the belt and gives their moves and switching to the feeder.
//!
//! Invariant: it ends when the program does, or nobody is there to plan for any more, whatever the decoder is doing.

use std::thread;
use std::time::Duration;

use retrace_gcode::{Axis, Canon, CanonStep};

use crate::canon_executor::{CanonError, CanonExecutor};
use crate::decoding::{BatchChannel, BlockBatch};
use crate::machine::MachineConfig;
use crate::plan_item::{PlanEnd, PlanSummary};
use crate::plan_writer::{Cancelled, PlanWriter};
use crate::start_line::SkippedBlocks;

/// Plans until the program, or the interest in it, ends: what the program came to, in the first case. `line`: where it begins, if not
/// at its first block. `rests`: the blocks behind which the path rests, because a run before ended there.
pub(crate) fn plan<const A: usize>(
    machine: &MachineConfig,
    belt: &BatchChannel,
    batch: BlockBatch,
    (line, rests): (Option<u32>, Vec<u64>),
    feeder: PlanWriter<'_, A>,
) -> Option<PlanSummary> {
    let skipped = line.map(|line| (line, SkippedBlocks::new(*feeder.outputs(), &machine.cutting_outputs)));
    let _gone = CancelPlanOnDrop(belt);
    PlanningThread { machine, track: CanonExecutor::new(machine), skipped, feeder, rests, blocks: 0, canonical: 0 }
        .run(belt, batch)
}

/// Tells the decoder that nobody takes anything any more, however planning ends.
struct CancelPlanOnDrop<'b>(&'b BatchChannel);

impl Drop for CancelPlanOnDrop<'_> {
    fn drop(&mut self) {
        self.0.give_up();
    }
}

struct PlanningThread<'m, 'r, const A: usize> {
    machine: &'m MachineConfig,
    track: CanonExecutor<'m>,
    /// The line to begin at, and what the blocks before it have switched.
    skipped: Option<(u32, SkippedBlocks)>,
    feeder: PlanWriter<'r, A>,
    rests: Vec<u64>,
    blocks: u64,
    canonical: u64,
}

impl<const A: usize> PlanningThread<'_, '_, A> {
    fn run(mut self, belt: &BatchChannel, mut batch: BlockBatch) -> Option<PlanSummary> {
        let ending = loop {
            self.wait(belt, &mut batch)?;
            match self.give_all(&mut batch) {
                Ok(()) => {}
                Err((CanonError::Cancelled, _)) => return None,
                Err((why, line)) => break PlanEnd::Refused(format!("line {line}: {}", why.explain())),
            }
            if let Some(ending) = batch.ending.take() {
                break ending;
            }
        };
        if let PlanEnd::Refused(_) = ending {
            self.feeder.rest_behind(self.blocks);
        }
        let commanded_mm = self.feeder.commanded_mm()[..self.machine.axes.len().min(A)].to_vec();
        let summary = PlanSummary { ending, blocks: self.blocks, canonical: self.canonical, commanded_mm };
        self.feeder.end(summary.clone()).ok()?;
        belt.give_up();
        // As long as the job lasts a tool length may be entered.
        while self.feeder.idle().is_ok() {
            thread::sleep(Duration::from_millis(1));
        }
        Some(self.moved(summary))
    }

    /// With the end position where the machine really is, if a tool length was entered behind the last move that says so.
    fn moved(&self, mut summary: PlanSummary) -> PlanSummary {
        if let Some((axis, mm)) = self.feeder.moved_by()
            && let Some(commanded_mm) = summary.commanded_mm.get_mut(axis)
        {
            *commanded_mm += mm;
        }
        summary
    }

    /// Waits for something to plan; `None` where nothing will come, or nobody wants it.
    fn wait(&mut self, belt: &BatchChannel, batch: &mut BlockBatch) -> Option<()> {
        for tries in 0u32.. {
            let ended = belt.ended();
            if belt.take(batch) {
                break;
            }
            if ended {
                return None;
            }
            self.feeder.idle().ok()?;
            match tries {
                0..20 => thread::yield_now(),
                20..200 => thread::sleep(Duration::from_micros(50)),
                _ => thread::sleep(Duration::from_millis(1)),
            }
        }
        Some(())
    }

    /// Gives a batch to the feeder, block by block; where a step cannot be run, why, and its line.
    fn give_all(&mut self, batch: &mut BlockBatch) -> Result<(), (CanonError, u32)> {
        let mut first = 0;
        let mut modes = batch.modes.drain(..).peekable();
        for (block, &end) in (0u32..).zip(&batch.ends) {
            if let Some((_, active)) = modes.next_if(|(from, _)| *from == block) {
                self.feeder.active(active);
            }
            self.give(&batch.steps[first..end as usize])?;
            first = end as usize;
            self.blocks += 1;
            if self.rests.contains(&self.blocks) {
                self.feeder.rest().map_err(|cancelled| (cancelled.into(), 0))?;
            }
        }
        // What the last block, which ends the program, has left.
        modes.for_each(|(_, active)| self.feeder.active(active));
        self.give(&batch.steps[first..])
    }

    /// Gives a block's steps to the feeder; those before the line to begin at are only remembered.
    fn give(&mut self, steps: &[CanonStep]) -> Result<(), (CanonError, u32)> {
        self.feeder.block(self.blocks + 1);
        let ends_length = steps.iter().any(|step| self.track.ends_entered_length(&step.canon));
        self.feeder.has_end_of_length(ends_length);
        for step in steps {
            if self.skipped.as_ref().is_some_and(|(line, _)| step.line >= *line)
                && let Some((line, before)) = self.skipped.take()
            {
                let position = self.track.position();
                before.restore(&mut self.feeder, position, self.machine, line).map_err(|why| (why.into(), line))?;
            }
            if ends_length && self.skipped.is_none() && self.track.ends_entered_length(&step.canon) {
                self.end_length(step.canon == Canon::MachineCoordinates)
                    .map_err(|cancelled| (cancelled.into(), step.line))?;
            }
            let result = match &mut self.skipped {
                Some((_, before)) => self.track.run::<A>(&step.canon, step.line, before),
                None => self.track.run(&step.canon, step.line, &mut self.feeder),
            };
            result.map_err(|why| (why, step.line))?;
            self.canonical += u64::from(step.canon != Canon::MachineCoordinates);
        }
        if ends_length || self.blocks == 0 {
            self.tell_tool_length();
        }
        self.feeder.has_end_of_length(false);
        Ok(())
    }

    /// A path that was moved along the tool axis, because a tool length was entered, ends here.
    fn end_length(&mut self, is_move: bool) -> Result<(), Cancelled> {
        if let Some((axis, mm)) = self.feeder.end_length(is_move)? {
            self.track.correct_length(Axis::ALL[self.machine.axes[axis].index()], mm);
        }
        Ok(())
    }

    fn tell_tool_length(&mut self) {
        let axis = self.machine.tool_axis().map(|tool| Axis::ALL[self.machine.axes[tool].index()]);
        self.feeder.set_tool_length(axis.and_then(|axis| self.track.tool_length_mm(axis)));
    }
}
