//! Waits of the program for an input (M66, PRB-12).
//!
//! Invariant: the machine rests at the place of the wait. The answer is given once; the instruction is sent to the card
//! behind it, so that a job that is resumed within the wait waits again.

use retrace_core::RecordIndex;
use retrace_gcode::WaitFor;
use retrace_journal::{InputAnswer, ProgramAnswer};
use retrace_link::MotionCard;

use super::Session;
use crate::event::{CardError, EventKind};
use crate::question::{InputQuestion, ReadInput};

/// A wait in progress, or answered.
#[derive(Clone, Copy, Debug)]
pub(super) struct InputWait {
    /// Number of its instruction.
    number: u32,
    /// Control periods since it began.
    periods: u64,
    /// Level of the input in the last period; none of an analog one.
    level: bool,
    is_answered: bool,
}

impl InputWait {
    /// The answer with what an analog input has shown, if it was read since the wait began.
    fn answer_analog(&mut self, reading: Option<u16>, report_periods: u64) -> Option<i32> {
        let is_of_this_place = self.periods >= report_periods;
        self.periods += 1;
        reading.filter(|_| is_of_this_place).map(i32::from)
    }

    /// The answer with the level of a period, if the wait ends in it.
    fn answer(&mut self, question: InputQuestion, level: bool) -> Option<i32> {
        let (rises, falls) = (level && !self.level, !level && self.level);
        let is_met = match question.wait_for {
            WaitFor::Immediate => true,
            WaitFor::Rise => rises,
            WaitFor::Fall => falls,
            WaitFor::High => level,
            WaitFor::Low => !level,
        };
        self.level = level;
        self.periods += 1;
        let is_over = self.periods > question.timeout_periods;
        is_met.then_some(i32::from(level)).or(is_over.then_some(-1))
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Whether the wait at this place is answered. Called in every control period in which the job is not held.
    pub(super) fn has_read_input(
        &mut self,
        question: InputQuestion,
        place: RecordIndex,
        line: u32,
    ) -> Result<bool, CardError> {
        let status = self.card.status();
        let level = matches!(question.input, ReadInput::Digital(input) if status.inputs >> input & 1 == 1);
        let reading = match question.input {
            ReadInput::Digital(_) => None,
            ReadInput::Analog { number, .. } => status.analog_inputs.get(usize::from(number)).copied().flatten(),
        };
        let number = self.streamer.instruction_number();
        let mut wait = match self.input_wait {
            Some(wait) if wait.number == number => wait,
            _ => {
                self.emit_at(line, EventKind::Switching("M66"));
                InputWait { number, periods: 0, level, is_answered: false }
            }
        };
        if !wait.is_answered
            && let Some(value) = match question.input {
                ReadInput::Digital(_) => wait.answer(question, level),
                ReadInput::Analog { report_periods, .. } => wait.answer_analog(reading, report_periods),
            }
        {
            wait.is_answered = true;
            self.probing.send(ProgramAnswer::Input(InputAnswer { block: 0, place: place.number(), value }))?;
        }
        self.input_wait = Some(wait);
        Ok(wait.is_answered)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_and_edges_end_a_wait_and_so_does_its_time() {
        let answers = |wait_for: WaitFor, timeout_periods: u64, levels: &[u8]| {
            let question = InputQuestion { input: ReadInput::Digital(0), wait_for, timeout_periods };
            let mut wait = InputWait { number: 1, periods: 0, level: levels[0] == 1, is_answered: false };
            let values = levels.iter().map(|&level| wait.answer(question, level == 1));
            values.enumerate().find_map(|(at, value)| Some((at, value?)))
        };
        assert_eq!(answers(WaitFor::Immediate, 0, &[1]), Some((0, 1)));
        assert_eq!(answers(WaitFor::Immediate, 0, &[0]), Some((0, 0)));
        // An edge before the wait is none.
        assert_eq!(answers(WaitFor::Rise, 9, &[1, 1, 0, 1]), Some((3, 1)));
        assert_eq!(answers(WaitFor::Fall, 9, &[0, 1, 1, 0]), Some((3, 0)));
        assert_eq!(answers(WaitFor::High, 9, &[0, 1]), Some((1, 1)));
        assert_eq!(answers(WaitFor::Low, 9, &[0, 1]), Some((0, 0)));
        assert_eq!(answers(WaitFor::High, 2, &[0, 0, 0, 1]), Some((2, -1)));
    }

    #[test]
    fn an_analog_input_is_read_at_rest_and_not_before() {
        let answer = |readings: &[Option<u16>]| {
            let mut wait = InputWait { number: 1, periods: 0, level: false, is_answered: false };
            let values = readings.iter().map(|&reading| wait.answer_analog(reading, 2));
            values.enumerate().find_map(|(at, value)| Some((at, value?)))
        };
        assert_eq!(answer(&[Some(7), Some(7), Some(9), Some(10)]), Some((2, 9)));
        // What is not known is waited for.
        assert_eq!(answer(&[None, None, None, Some(u16::MAX)]), Some((3, 65_535)));
        assert_eq!(answer(&[None; 9]), None);
    }
}
