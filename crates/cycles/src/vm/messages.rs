//! Messages, warnings and alarms.
//!
//! Invariant: a number from 62000 to 62999 is a warning and the run continues; any other ends it.

use super::{Step, Value, VmRun, VmTrap};
use crate::alarm::alarm_text;
use crate::code::Op;
use crate::cycle::CycleId;
use crate::error_codes::ErrorCode;
use crate::host::Message;
use std::fmt::Write;

impl VmRun<'_> {
    /// Executes an instruction that builds or sends a message.
    pub(super) fn message_op(&mut self, op: Op, cycle: CycleId, line: u32) -> Step {
        match op {
            Op::Clear => self.vm.message.clear(),
            Op::Join => match self.pop() {
                // Six decimals are enough for display; writing to a string does not fail.
                Value::Number(number) => {
                    let rounded = (number * 1e6).round() / 1e6;
                    let shown = if rounded.is_finite() { rounded } else { number };
                    let _ = write!(self.vm.message, "{shown}");
                }
                text => {
                    let text = self.text(text);
                    self.vm.message.push_str(text);
                }
            },
            Op::Show => self.host.message(&Message { warning: None, text: &self.vm.message, cycle, line }),
            _ => {
                let written = self.number().clamp(0.0, f64::from(u32::MAX)) as u32;
                let number = alarm_text(written).map_or(written, |text| text.number);
                if !(62_000..63_000).contains(&written) {
                    let text = self.vm.message.clone();
                    return Err(Box::new(VmTrap::Alarm(ErrorCode::CycleAlarm, Some(number), text)));
                }
                let message = Message { warning: Some(number), text: &self.vm.message, cycle, line };
                self.host.message(&message);
            }
        }
        Ok(())
    }
}
