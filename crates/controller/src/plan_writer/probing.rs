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

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;
    use std::sync::mpsc::sync_channel;
    use std::sync::{Arc, Mutex};

    use proptest::prelude::*;
    use retrace_config::MachineConfig;
    use retrace_core::ring::{Cell, Ring};
    use retrace_core::{Record, RecordIndex};
    use retrace_gcode::WaitFor;
    use retrace_journal::{IndexWriter, InputAnswer, TapAnswer};
    use retrace_motion::{FeedRate, PathMode, Planner};

    use super::*;
    use crate::plan_item::PathItem;
    use crate::question::ReadInput;

    const ROOM: u32 = 1 << 14;

    /// A move to X in millimetres, or an input that is read.
    #[derive(Clone, Copy, Debug)]
    enum Step {
        Move(i8),
        Read(u8),
    }

    /// Keeps the answers that the planner records.
    #[derive(Clone, Default)]
    struct Kept(Arc<Mutex<Vec<ProgramAnswer>>>);

    impl IndexWriter for Kept {
        fn write(&mut self, entry: IndexEntry) {
            if let IndexEntry::Answer(answer) = entry {
                self.0.lock().expect("one thread").push(*answer);
            }
        }
    }

    /// What the program has learned by a plan, and its end; how often the machine was asked, and what was recorded.
    struct Planned {
        learned: Vec<i32>,
        end: Result<(), PlanWriteError>,
        asked: usize,
        recorded: Vec<ProgramAnswer>,
    }

    /// Plans the steps with the answers of an earlier run; behind them the machine answers with `live`.
    fn plan(steps: &[Step], replayed: &[ProgramAnswer], live: &[i32]) -> Planned {
        let machine = MachineConfig::built_in().expect("valid");
        let cells: Box<[Cell<Record<3>>]> = (0..ROOM).map(|_| Cell::default()).collect();
        let mut ring = Ring::new(cells, 0, ROOM, RecordIndex::new(0)).expect("fits");
        let (producer, _consumer) = ring.split();
        let (items, received) = sync_channel(1024);
        let (answers, receiver) = sync_channel(live.len());
        for &value in live {
            answers.send(ProgramAnswer::Input(InputAnswer { block: 0, place: 0, value })).expect("room");
        }
        drop(answers);
        let planner = Planner::new(machine.limits(), [0.0; 3]).expect("valid");
        let (cancel, kept) = (AtomicBool::new(false), Kept::default());
        let mut writer = PlanWriter::new(planner, producer, items, [0; retrace_link::channel::COUNT], &cancel)
            .with_index(Box::new(kept.clone()), &[0; 3])
            .with_answers(receiver, replayed);
        let mut learned = Vec::new();
        let end = (1u32..).zip(steps).try_for_each(|(line, &step)| {
            writer.begin_block(u64::from(line));
            match step {
                Step::Move(x) => {
                    writer.straight([f64::from(x), 0.0, 0.0], FeedRate::PerSecond(80.0), PathMode::ExactPath, line)
                }
                Step::Read(number) => {
                    let input = ReadInput::Digital(number);
                    let question = InputQuestion { input, wait_for: WaitFor::Immediate, timeout_periods: 0 };
                    writer.read_input(question, line).map(|value| learned.push(value))
                }
            }
        });
        drop(writer);
        let asks = |item: &PathItem| matches!(item, PathItem::Exclusive(of) if of.question.is_some());
        let asked = received.try_iter().filter(asks).count();
        let recorded = std::mem::take(&mut *kept.0.lock().expect("one thread"));
        Planned { learned, end, asked, recorded }
    }

    fn steps() -> impl Strategy<Value = Vec<Step>> {
        let step = prop_oneof![(-9i8..10).prop_map(Step::Move), (0u8..8).prop_map(Step::Read)];
        prop::collection::vec(step, 1..14)
    }

    proptest! {
        /// Planned again with the answers in the journal, or the first of them, the program asks the same questions,
        /// the machine is asked only those behind, and the journal has all answers again where it had none.
        #[test]
        fn a_plan_with_its_answers_asks_the_same_questions(
            steps in steps(), live in prop::collection::vec(-1i32..2, 14), kept in any::<prop::sample::Index>(),
        ) {
            let first = plan(&steps, &[], &live);
            let questions = steps.iter().filter(|step| matches!(step, Step::Read(_))).count();
            prop_assert!(first.end.is_ok(), "{:?}", first.end);
            prop_assert_eq!((first.asked, first.recorded.len()), (questions, questions));
            let kept = kept.index(questions + 1);
            let again = plan(&steps, &first.recorded[..kept], &live[kept..]);
            prop_assert!(again.end.is_ok(), "{:?}", again.end);
            prop_assert_eq!(&again.learned, &first.learned);
            prop_assert_eq!(again.asked, questions - kept);
            prop_assert_eq!(&again.recorded[..], &first.recorded[kept..]);
        }

        /// An answer that is missing, at another place, of another block, of another kind, or before its turn is
        /// refused at its question, and nothing behind it is planned.
        #[test]
        fn an_answer_to_another_question_is_refused(
            steps in steps(), changed in any::<prop::sample::Index>(), kind in 0..5,
        ) {
            let first = plan(&steps, &[], &[0; 14]);
            prop_assume!(first.recorded.len() > 1);
            let mut answers = first.recorded;
            let at = changed.index(answers.len() - 1);
            let ProgramAnswer::Input(answer) = answers[at].clone() else { unreachable!("inputs only") };
            match kind {
                0 => { answers.remove(at); }
                1 => answers.swap(at, at + 1),
                2 => answers[at] = ProgramAnswer::Input(InputAnswer { place: answer.place + 1, ..answer }),
                3 => answers[at] = ProgramAnswer::Input(InputAnswer { block: answer.block + 1, ..answer }),
                _ => {
                    let (block, place) = (answer.block, answer.place);
                    answers[at] = ProgramAnswer::Tap(TapAnswer { block, place, turned: 1 });
                }
            }
            let again = plan(&steps, &answers, &[0; 14]);
            prop_assert!(matches!(again.end, Err(PlanWriteError::AnswerMismatch)), "{:?}", again.end);
            prop_assert_eq!((again.learned.len(), again.asked), (at, 0));
        }
    }
}
