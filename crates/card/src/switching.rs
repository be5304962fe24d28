//! The executor of exclusive switching instructions, and the outputs (GMC-1, GMC-4 in the acknowledged form).
//!
//! Invariant: one instruction at a time, in the order of their numbers; `executed` names the last one that is complete, and
//! nothing else counts as ready.

use retrace_link::{Change, Instruction, Outputs, Refusal, channel};

/// Outputs, and the instruction being executed.
#[derive(Clone, Debug)]
pub struct Switching {
    outputs: Outputs,
    running: Option<Instruction>,
    left: u32,
    executed: u32,
}

impl Default for Switching {
    fn default() -> Self {
        Self { outputs: [0; channel::COUNT], running: None, left: 0, executed: 0 }
    }
}

impl Switching {
    /// The outputs as they are.
    #[must_use]
    pub fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// Number of the last complete instruction.
    #[must_use]
    pub fn executed(&self) -> u32 {
        self.executed
    }

    /// Is an instruction being executed?
    #[must_use]
    pub fn busy(&self) -> bool {
        self.running.is_some()
    }

    /// Sets an output.
    pub fn set(&mut self, change: Change) -> Result<(), Refusal> {
        *self.outputs.get_mut(usize::from(change.channel)).ok_or(Refusal::NoSuchChannel)? = change.value;
        Ok(())
    }

    /// Begins an instruction: its changes take place at once, it is complete after its periods.
    pub fn begin(&mut self, instruction: Instruction) -> Result<(), Refusal> {
        if self.busy() || instruction.number != self.executed.wrapping_add(1) {
            return Err(Refusal::Busy);
        }
        if instruction.changes().iter().any(|c| usize::from(c.channel) >= channel::COUNT) {
            return Err(Refusal::NoSuchChannel);
        }
        for &change in instruction.changes() {
            self.set(change)?;
        }
        self.left = instruction.periods;
        if self.left == 0 {
            self.executed = instruction.number;
        } else {
            self.running = Some(instruction);
        }
        Ok(())
    }

    /// One control period passes.
    pub fn period(&mut self) {
        if let Some(instruction) = self.running {
            self.left -= 1;
            if self.left == 0 {
                self.executed = instruction.number;
                self.running = None;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn takes_its_time_and_keeps_the_order() {
        let mut switching = Switching::default();
        let change = Change { channel: channel::SPINDLE, value: 1 };
        let mut first = Instruction { number: 1, count: 1, periods: 2, ..Instruction::default() };
        first.changes[0] = change;
        let second = Instruction { number: 2, ..Instruction::default() };
        assert_eq!(switching.begin(second), Err(Refusal::Busy));
        switching.begin(first).expect("the next number");
        assert_eq!(switching.outputs()[usize::from(channel::SPINDLE)], 1);
        switching.period();
        assert_eq!((switching.executed(), switching.begin(second)), (0, Err(Refusal::Busy)));
        switching.period();
        assert_eq!(switching.executed(), 1);
        switching.begin(second).expect("the next number");
        assert_eq!(switching.executed(), 2);
    }

    #[test]
    fn a_channel_that_is_not_there_is_refused_before_anything_is_switched() {
        let mut switching = Switching::default();
        let mut bad = Instruction { number: 1, count: 2, ..Instruction::default() };
        bad.changes[0] = Change { channel: 0, value: 1 };
        bad.changes[1] = Change { channel: 200, value: 1 };
        assert_eq!(switching.begin(bad), Err(Refusal::NoSuchChannel));
        assert_eq!((switching.outputs()[0], switching.executed()), (0, 0));
    }
}
