//! Analog outputs, M67 and M68 (PRB-13), and analog inputs, M66 E (PRB-12).
//!
//! Invariant: an amount out of the range of its output is refused where the program is checked, before anything moves.

use retrace_config::{CodeSwitching, InReverse};
use retrace_gcode::WaitFor;

use super::switching::CutStart;
use super::{CanonError, CanonExecutor};
use crate::PlanWriteError;
use crate::motion_sink::MotionSink;
use crate::question::{InputQuestion, MachineResult, ReadInput};

impl CanonExecutor<'_> {
    /// M67 sets an analog output in passing, at its place; M68 sets it at rest. Where outputs are replayed, both are
    /// undone in reverse.
    pub(super) fn set_analog_output<const A: usize>(
        &self,
        code: &'static str,
        number: i32,
        amount: f64,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let output = self.machine.card.analog_output(number).ok_or(CanonError::NoAnalogOutput(code, number))?;
        // An amount that is unknown to a check.
        if amount.is_nan() {
            return Ok(());
        }
        let change = output.change_to(amount);
        let change = change.ok_or_else(|| CanonError::AnalogRange(code, amount, output.clone()))?;
        if code == "M67" {
            sink.action(change, line);
            return Ok(());
        }
        let switching = CodeSwitching { in_reverse: InReverse::Undone, ..CodeSwitching::AT_REST };
        self.exclusive((code, line), &[change], switching, CutStart::default(), sink)
    }

    /// M66 E: the program learns the amount at this place, in the unit of the input.
    pub(super) fn read_analog_input<const A: usize>(
        &mut self,
        number: i32,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let of = self.machine.card.analog_input(number).ok_or(CanonError::NoAnalogInput(number))?;
        let input = ReadInput::Analog { number: of.number, report_periods: self.machine.card.report_periods() };
        let reading =
            sink.read_input(InputQuestion { input, wait_for: WaitFor::Immediate, timeout_periods: 0 }, line)?;
        let reading = reading.map(|reading| u16::try_from(reading).map_err(|_| PlanWriteError::AnswerMismatch));
        self.learned = reading.transpose()?.map(|reading| MachineResult::Input(of.amount(reading)));
        Ok(())
    }
}
