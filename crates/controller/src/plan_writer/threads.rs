//! Geared stretches in the plan, and records that the planner of the program has not made (SPN-17).
//!
//! Invariant: the program's planner goes on from where such records end, to the pulse.

use retrace_config::EncoderConfig;
use retrace_core::Record;
use retrace_journal::{IndexEntry, ProgramAnswer, TapBegin};
use retrace_link::SpindleTask;

use super::{Cancelled, PlanWriteError, PlanWriter, SwitchInstruction};
use crate::question::Question;
use crate::tap_move::{RigidTap, TapQuestion};
use crate::thread_plan::ThreadStretch;

/// Code of a geared stretch, for messages.
const CODE: &str = "G33";

impl<const A: usize> PlanWriter<'_, A> {
    /// Sets whether the feed of the moves to come follows the measured speed of the spindle.
    pub fn set_feed_per_turn(&mut self, is_per_turn: bool) {
        self.is_per_turn = is_per_turn;
    }

    /// Plans a geared stretch: the motion comes to rest, waits for the spindle, and follows it.
    ///
    /// # Errors
    /// The reason why it is rejected; nothing has moved then.
    pub fn thread(&mut self, stretch: &ThreadStretch<A>, encoder: &EncoderConfig) -> Result<(), PlanWriteError> {
        let Some(machine) = self.machine else { return Err(PlanWriteError::Cancelled) };
        let line = stretch.line();
        for piece in &stretch.pieces {
            self.check_limits(&[piece.end_mm], piece.line)?;
        }
        self.rest()?;
        let plan = self.thread_planner.plan(stretch, machine, encoder, self.planner.commanded_mm());
        let plan = plan.map_err(|error| PlanWriteError::of_thread(error, line))?;
        let spindle = Some(SpindleTask::Gear(plan.gear));
        self.exclusive(SwitchInstruction { line, code: CODE, spindle, ..SwitchInstruction::default() })?;
        let moved = self.push_records(plan.records.into_iter())?;
        if !self.planner.displace(moved) {
            return Err(PlanWriteError::Cancelled);
        }
        self.write_mark();
        let barrier = SwitchInstruction { line, code: CODE, is_barrier: true, ..SwitchInstruction::default() };
        Ok(self.exclusive(barrier)?)
    }

    /// Plans a rigid tap: the motion comes to rest, the machine taps, and the path goes on from where it was.
    ///
    /// # Errors
    /// The reason why it is rejected; nothing has moved then.
    pub fn tap(&mut self, tap: &RigidTap<A>, encoder: &EncoderConfig) -> Result<(), PlanWriteError> {
        let (Some(machine), line) = (self.machine, tap.line) else { return Err(PlanWriteError::Cancelled) };
        self.check_limits(&[tap.depth_mm], line)?;
        self.rest()?;
        let begins = RigidTap { from_mm: self.planner.commanded_mm(), ..*tap };
        let Some(tap) = begins.counted(machine, self.next_mark.counts) else { return Ok(()) };
        let plan = tap.plan::<A>(machine, encoder).map_err(|error| PlanWriteError::of_thread(error, line))?;
        // One that an earlier run has answered does not begin.
        if self.answers.replayed.is_empty() {
            self.index.write(IndexEntry::Tap(TapBegin { place: self.ring.write().number(), line }));
        }
        let question = Question::Tap(TapQuestion { tap, gear: plan.gear });
        let ProgramAnswer::Tap(_) = self.ask(question, line)? else { return Err(PlanWriteError::AnswerMismatch) };
        // A hole is tapped once: nothing is reversed over it. The motion path goes on once it has this.
        let code = question.code();
        let barrier = SwitchInstruction { line, code, is_barrier: true, ..SwitchInstruction::default() };
        Ok(self.exclusive(barrier)?)
    }

    /// Writes records that the program's planner has not made, behind a stop. Returns their sum.
    pub(super) fn push_records(&mut self, records: impl Iterator<Item = Record<A>>) -> Result<[i64; A], Cancelled> {
        let mut moved = [0; A];
        for record in records {
            self.apply_due_override();
            for (sum, &increment) in moved.iter_mut().zip(&record.increments) {
                *sum += i64::from(increment);
            }
            self.push(record, self.block)?;
        }
        Ok(moved)
    }
}
