//! Questions of the program in the plan, and the path behind their answers (PRB-6, PRB-11, PRB-12, PRB-14).
//!
//! Invariant: nothing behind a question is planned before its answer, and the answer is in the index before the records
//! behind it.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, TryRecvError};

use retrace_journal::{IndexEntry, ProgramAnswer};

use super::{PlanWriteError, PlanWriter, SwitchInstruction};
use crate::plan_item::ExclusiveKind;
use crate::probe_move::{ProbeMove, ProbeOutcome};
use crate::question::{InputQuestion, Question};
use retrace_gcode::Probing;

/// Answers of the machine.
#[derive(Debug, Default)]
pub(super) struct Answers {
    /// From the motion path.
    pub(super) receiver: Option<Receiver<ProgramAnswer>>,
    /// Of an earlier run, in order.
    pub(super) replayed: VecDeque<ProgramAnswer>,
}

impl<const A: usize> PlanWriter<'_, A> {
    /// Enables questions: answers come from the motion path, after those of an earlier run.
    #[must_use]
    pub(crate) fn with_answers(mut self, receiver: Receiver<ProgramAnswer>, replayed: &[ProgramAnswer]) -> Self {
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
        let ProgramAnswer::Probe(answer) = self.ask(Question::Probe(question), line)? else {
            return Err(PlanWriteError::AnswerMismatch);
        };
        let records = question.executed_records::<A>(machine, &answer.runs).ok_or(PlanWriteError::AnswerMismatch)?;
        let moved = self.push_records(records.into_iter().map(|record| retrace_core::Record { line, ..record }))?;
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

    /// Waits for an input: the motion comes to rest, and the machine is asked. Returns the level, 1 or 0, or −1 where
    /// the time was over.
    ///
    /// # Errors
    /// [`PlanWriteError::Cancelled`], or an answer in the journal that is none to this question.
    pub fn read_input(&mut self, question: InputQuestion, line: u32) -> Result<i32, PlanWriteError> {
        self.rest()?;
        match self.ask(Question::Input(question), line)? {
            ProgramAnswer::Input(answer) => Ok(answer.value),
            _ => Err(PlanWriteError::AnswerMismatch),
        }
    }

    /// Returns the answer to a question: that of an earlier run, or the machine's.
    pub(super) fn ask(&mut self, question: Question, line: u32) -> Result<ProgramAnswer, PlanWriteError> {
        let (at, code) = ((self.block, self.ring.write().number()), question.code());
        if let Some(answer) = self.answers.replayed.pop_front() {
            if answer.asked_at() != at {
                return Err(PlanWriteError::AnswerMismatch);
            }
            self.exclusive(SwitchInstruction { line, code, ..SwitchInstruction::default() })?;
            return Ok(answer);
        }
        let kind = match question {
            Question::Probe(_) | Question::Tap(_) => ExclusiveKind::OffPath,
            Question::Input(_) => ExclusiveKind::Input,
        };
        self.exclusive(SwitchInstruction { line, code, kind, question: Some(question), ..Default::default() })?;
        self.write_mark();
        let answer = self.wait_for(|writer| match writer.answers.receiver.as_ref().map(Receiver::try_recv) {
            Some(Ok(answer)) => Some(Some(answer)),
            Some(Err(TryRecvError::Empty)) => None,
            // The motion path has ended.
            Some(Err(TryRecvError::Disconnected)) | None => Some(None),
        })?;
        let answer = answer.ok_or(PlanWriteError::Cancelled)?.to_question_at(at);
        self.index.write(IndexEntry::Answer(Box::new(answer.clone())));
        Ok(answer)
    }
}
