//! Probing moves in the plan: the question to the machine, and the path behind its answer (PRB-6, PRB-11, PRB-14).
//!
//! Invariant: nothing behind a question is planned before its answer, and the answer is in the index before the records
//! behind it.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, TryRecvError};

use retrace_journal::{IndexEntry, ProbeAnswer, ProgramAnswer};

use super::{PlanWriteError, PlanWriter, SwitchInstruction};
use crate::plan_item::ExclusiveKind;
use crate::probe_move::{ProbeMove, ProbeOutcome};
use retrace_gcode::Probing;

/// Answers of the machine.
#[derive(Debug, Default)]
pub(super) struct Answers {
    /// From the motion path.
    pub(super) receiver: Option<Receiver<ProbeAnswer>>,
    /// Of an earlier run, in order.
    pub(super) replayed: VecDeque<ProgramAnswer>,
}

impl<const A: usize> PlanWriter<'_, A> {
    /// Enables probing: answers come from the motion path, after those of an earlier run.
    #[must_use]
    pub(crate) fn with_answers(mut self, receiver: Receiver<ProbeAnswer>, replayed: &[ProgramAnswer]) -> Self {
        self.answers = Answers { receiver: Some(receiver), replayed: replayed.iter().cloned().collect() };
        self
    }

    /// Plans a probing move: the motion comes to rest, the machine is asked, and the path goes on from its answer.
    ///
    /// # Errors
    /// The reason why the move is rejected; nothing has moved then.
    pub fn probe(
        &mut self,
        end_mm: [f64; A],
        feed_mm_s: f64,
        probing: Probing,
        line: u32,
    ) -> Result<ProbeOutcome<A>, PlanWriteError> {
        let Some(machine) = self.machine else { return Err(PlanWriteError::Cancelled) };
        self.check_limits(&[end_mm], line)?;
        self.rest()?;
        let (from, at) = (self.next_mark.counts, self.planner.commanded_mm());
        let mut to = from;
        for (index, axis) in machine.axes.iter().enumerate().take(A) {
            if end_mm[index] != at[index] {
                to[index] = axis.pulses_of(end_mm[index]);
            }
        }
        let feed_nm_per_s = ((feed_mm_s * 1e6).round() as u64).max(1);
        let question = ProbeMove { from, to, feed_nm_per_s, probing };
        let answer = self.ask(question, line)?;
        let records = question.executed_records::<A>(machine, &answer.runs).ok_or(PlanWriteError::AnswerMismatch)?;
        let mut moved = [0; A];
        for record in records {
            if let Some(planned) = self.overrides.due_at(self.ring.write()) {
                self.index.write(IndexEntry::Override { place: self.ring.write(), planned });
                self.planner.set_feed_override(f64::from(planned));
            }
            for (sum, &increment) in moved.iter_mut().zip(&record.increments) {
                *sum += i64::from(increment);
            }
            self.push(retrace_core::Record { line, ..record }, self.block)?;
        }
        let agrees =
            (0..machine.axes.len().min(A)).all(|axis| answer.rest.get(axis) == Some(&(from[axis] + moved[axis])));
        if !agrees || !self.planner.displace(moved) {
            return Err(PlanWriteError::AnswerMismatch);
        }
        self.write_mark();
        let mut touch_mm = end_mm;
        if answer.touched {
            for ((mm, axis), &touch) in touch_mm.iter_mut().zip(&machine.axes).zip(&answer.touch) {
                *mm = axis.mm_of(touch);
            }
        }
        Ok(ProbeOutcome { touch_mm, rest_mm: self.planner.commanded_mm(), touched: answer.touched })
    }

    /// Returns the answer to a question: that of an earlier run, or the machine's.
    fn ask(&mut self, question: ProbeMove, line: u32) -> Result<ProbeAnswer, PlanWriteError> {
        let (block, place, code) = (self.block, self.ring.write().number(), question.code());
        if let Some(ProgramAnswer::Probe(answer)) = self.answers.replayed.pop_front() {
            if (answer.block, answer.place) != (block, place) {
                return Err(PlanWriteError::AnswerMismatch);
            }
            self.exclusive(SwitchInstruction { line, code, ..SwitchInstruction::default() })?;
            return Ok(answer);
        }
        let probe = Some(question);
        self.exclusive(SwitchInstruction { line, code, kind: ExclusiveKind::Probe, probe, ..Default::default() })?;
        self.write_mark();
        let answer = self.wait_for(|writer| match writer.answers.receiver.as_ref().map(Receiver::try_recv) {
            Some(Ok(answer)) => Some(Some(answer)),
            Some(Err(TryRecvError::Empty)) => None,
            // The motion path has ended.
            Some(Err(TryRecvError::Disconnected)) | None => Some(None),
        })?;
        let Some(answer) = answer else { return Err(PlanWriteError::Cancelled) };
        let answer = ProbeAnswer { block, place, ..answer };
        self.index.write(IndexEntry::Answer(Box::new(ProgramAnswer::Probe(answer.clone()))));
        Ok(answer)
    }
}
