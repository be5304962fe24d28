//! Executor of exclusive switching instructions (GMC-1, GMC-4 in the acknowledged form), and of those that a restart
//! repeats.
//!
//! Invariant: at most one instruction is pending, in the order of their numbers; it is stored until the cursor is at
//! rest on its place, and `executed` is the number of the last complete one. Nothing else counts as ready, and nothing
//! passes the place of an instruction that is not executed.

use retrace_core::RecordIndex;
use retrace_link::{Alarm, CommandRefusal, InputWait, Instruction, RepeatedInstruction};

use crate::OutputBank;

/// Stage of the pending instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum InstructionStage {
    /// It waits until the cursor reaches its place.
    Waiting,
    /// It has been executed for so many control periods.
    Running(u32),
    /// An alarm has cancelled it. It blocks its place until it is sent again.
    Cancelled,
}

/// Pending instruction.
#[derive(Clone, Copy, Debug)]
struct PendingInstruction {
    instruction: Instruction,
    stage: InstructionStage,
}

/// Repeated instruction that has been executed for `passed` control periods.
#[derive(Clone, Copy, Debug)]
struct PendingRepeat {
    instruction: RepeatedInstruction,
    passed: u32,
}

/// State of the pending instruction, the repeated one, and the numbers of the last complete ones.
#[derive(Clone, Debug, Default)]
pub struct InstructionExecutor {
    pending: Option<PendingInstruction>,
    executed: u32,
    repeat: Option<PendingRepeat>,
    repeated: u32,
}

/// Result of a control period of an instruction.
enum InstructionProgress {
    Running,
    Complete,
    TimedOut,
}

/// Returns the progress after `passed` control periods of an instruction that takes `periods` and waits for `until`,
/// with these inputs active.
fn progress(passed: u32, periods: u32, until: Option<InputWait>, active: u16) -> InstructionProgress {
    if passed < periods {
        return InstructionProgress::Running;
    }
    let Some(until) = until else { return InstructionProgress::Complete };
    let is_active = u32::from(active) >> (until.input & 31) & 1 == 1;
    if is_active == until.active {
        InstructionProgress::Complete
    } else if until.timeout_periods != 0 && passed >= periods.saturating_add(until.timeout_periods) {
        InstructionProgress::TimedOut
    } else {
        InstructionProgress::Running
    }
}

impl InstructionExecutor {
    /// Creates an executor without instructions.
    #[must_use]
    pub const fn new() -> Self {
        Self { pending: None, executed: 0, repeat: None, repeated: 0 }
    }

    /// Returns the number of the last complete instruction; when an epoch begins, the number in its start.
    #[must_use]
    pub const fn executed(&self) -> u32 {
        self.executed
    }

    /// Returns the number of the last complete repeated instruction; 0 when an epoch begins.
    #[must_use]
    pub const fn repeated(&self) -> u32 {
        self.repeated
    }

    /// Whether an instruction is being executed, including a repeated one.
    #[must_use]
    pub const fn is_busy(&self) -> bool {
        self.repeat.is_some()
            || matches!(self.pending, Some(PendingInstruction { stage: InstructionStage::Running(_), .. }))
    }

    /// Whether an instruction is being executed during which time at rest is not counted: a repeated one, or one with
    /// that flag.
    #[must_use]
    pub const fn keeps_cutter(&self) -> bool {
        let by_itself = match self.pending {
            Some(PendingInstruction { instruction, stage: InstructionStage::Running(_) }) => instruction.keeps_cutter,
            _ => false,
        };
        self.repeat.is_some() || by_itself
    }

    /// Returns the place of the instruction that waits for it.
    #[must_use]
    pub const fn waiting_place(&self) -> Option<RecordIndex> {
        match self.pending {
            Some(PendingInstruction { instruction, stage: InstructionStage::Waiting }) => Some(instruction.place),
            _ => None,
        }
    }

    /// Returns the place that nothing may pass: that of the pending instruction, also after an alarm has cancelled it.
    #[must_use]
    pub const fn barrier(&self) -> Option<RecordIndex> {
        match self.pending {
            Some(PendingInstruction { instruction, .. }) => Some(instruction.place),
            None => None,
        }
    }

    /// Checks that this instruction can be stored.
    ///
    /// # Errors
    /// [`CommandRefusal::Busy`] if another is stored or executed, or the number is not the next one;
    /// [`CommandRefusal::NoSuchChannel`] for a channel that does not exist.
    pub fn check(&self, instruction: &Instruction, outputs: &OutputBank) -> Result<(), CommandRefusal> {
        if self.is_busy() || self.waiting_place().is_some() || instruction.number != self.executed.wrapping_add(1) {
            return Err(CommandRefusal::Busy);
        }
        if !instruction.changes().iter().all(|change| outputs.has_channel(change.channel)) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        Ok(())
    }

    /// Stores an instruction until its place is reached.
    ///
    /// # Errors
    /// As [`InstructionExecutor::check`].
    pub fn store(&mut self, instruction: Instruction, outputs: &OutputBank) -> Result<(), CommandRefusal> {
        self.check(&instruction, outputs)?;
        self.pending = Some(PendingInstruction { instruction, stage: InstructionStage::Waiting });
        Ok(())
    }

    /// Begins the stored instruction at its place: its changes are made at once.
    pub fn begin(&mut self, outputs: &mut OutputBank) {
        let Some(PendingInstruction { instruction, stage: InstructionStage::Waiting }) = self.pending else { return };
        for &change in instruction.changes() {
            outputs.set(change);
        }
        if instruction.periods == 0 && instruction.until.is_none() {
            self.complete(&instruction);
        } else {
            self.pending = Some(PendingInstruction { instruction, stage: InstructionStage::Running(0) });
        }
    }

    /// Begins a repeated instruction: its changes are made at once.
    ///
    /// # Errors
    /// [`CommandRefusal::Busy`] while an instruction is being executed, or if the number is not the next one;
    /// [`CommandRefusal::NoSuchChannel`] for a channel that does not exist.
    pub fn repeat(&mut self, instruction: RepeatedInstruction, outputs: &mut OutputBank) -> Result<(), CommandRefusal> {
        if self.is_busy() || instruction.number != self.repeated.wrapping_add(1) {
            return Err(CommandRefusal::Busy);
        }
        if !instruction.changes().iter().all(|change| outputs.has_channel(change.channel)) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        for &change in instruction.changes() {
            outputs.set(change);
        }
        if instruction.periods == 0 && instruction.until.is_none() {
            self.repeated = instruction.number;
        } else {
            self.repeat = Some(PendingRepeat { instruction, passed: 0 });
        }
        Ok(())
    }

    /// Runs one control period with these inputs active. `failed` means that the machine reports the instruction as
    /// failed.
    ///
    /// An instruction that failed or timed out is cancelled, and the alarm is returned, with the number in its own
    /// sequence.
    pub fn run_period(&mut self, active: u16, failed: bool) -> Option<Alarm> {
        if let Some(PendingRepeat { instruction, passed }) = self.repeat {
            return self.repeat_period(instruction, passed.saturating_add(1), active, failed);
        }
        let Some(PendingInstruction { instruction, stage: InstructionStage::Running(passed) }) = self.pending else {
            return None;
        };
        let passed = passed.saturating_add(1);
        self.pending = Some(PendingInstruction { instruction, stage: InstructionStage::Running(passed) });
        let number = instruction.number;
        if failed {
            self.cancel();
            return Some(Alarm::Failed { instruction: number });
        }
        match progress(passed, instruction.periods, instruction.until, active) {
            InstructionProgress::Running => {}
            InstructionProgress::Complete => self.complete(&instruction),
            InstructionProgress::TimedOut => {
                self.cancel();
                return Some(Alarm::TimedOut { instruction: number });
            }
        }
        None
    }

    fn repeat_period(
        &mut self,
        instruction: RepeatedInstruction,
        passed: u32,
        active: u16,
        failed: bool,
    ) -> Option<Alarm> {
        self.repeat = None;
        let number = instruction.number;
        if failed {
            return Some(Alarm::Failed { instruction: number });
        }
        match progress(passed, instruction.periods, instruction.until, active) {
            InstructionProgress::Running => self.repeat = Some(PendingRepeat { instruction, passed }),
            InstructionProgress::Complete => self.repeated = number,
            InstructionProgress::TimedOut => return Some(Alarm::TimedOut { instruction: number }),
        }
        None
    }

    /// Cancels the pending instructions: they are not executed, the number stays the next one, and nothing passes the
    /// place until the instruction is sent again.
    pub const fn cancel(&mut self) {
        self.repeat = None;
        if let Some(pending) = &mut self.pending {
            pending.stage = InstructionStage::Cancelled;
        }
    }

    /// Begins an epoch: nothing is pending, and the numbers continue after `executed`.
    pub const fn reset(&mut self, executed: u32) {
        (self.pending, self.executed) = (None, executed);
        (self.repeat, self.repeated) = (None, 0);
    }

    const fn complete(&mut self, instruction: &Instruction) {
        (self.pending, self.executed) = (None, instruction.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_link::{InputWait, OutputChange, channel};

    fn instruction(number: u32, periods: u32, until: Option<InputWait>) -> Instruction {
        let mut instruction = Instruction { number, periods, until, count: 1, ..Instruction::default() };
        instruction.changes[0] = OutputChange { channel: channel::SPINDLE, value: number as i32 };
        instruction
    }

    #[test]
    fn takes_its_time_and_keeps_the_order() {
        let (mut switching, mut outputs) = (InstructionExecutor::default(), OutputBank::new(64));
        let spindle = |outputs: &OutputBank| outputs.values()[usize::from(channel::SPINDLE)];
        assert_eq!(switching.store(instruction(2, 0, None), &outputs), Err(CommandRefusal::Busy));
        switching.store(instruction(1, 2, None), &outputs).expect("the next number");
        assert_eq!((switching.run_period(0, false), spindle(&outputs), switching.is_busy()), (None, 0, false));
        switching.begin(&mut outputs);
        assert_eq!((spindle(&outputs), switching.is_busy()), (1, true));
        switching.run_period(0, false);
        assert_eq!(
            (switching.executed(), switching.store(instruction(2, 0, None), &outputs)),
            (0, Err(CommandRefusal::Busy))
        );
        switching.run_period(0, false);
        assert_eq!(switching.executed(), 1);
        switching.store(instruction(2, 0, None), &outputs).expect("the next number");
        switching.begin(&mut outputs);
        assert_eq!((switching.executed(), spindle(&outputs)), (2, 2));
    }

    #[test]
    fn a_channel_that_is_not_there_is_refused_before_anything_is_switched() {
        let (mut switching, outputs) = (InstructionExecutor::default(), OutputBank::new(4));
        let mut bad = instruction(1, 0, None);
        bad.count = 2;
        bad.changes[1] = OutputChange { channel: 4, value: 1 };
        assert_eq!(switching.store(bad, &outputs), Err(CommandRefusal::NoSuchChannel));
        assert_eq!((switching.waiting_place(), switching.executed()), (None, 0));
    }

    /// Periods after which an instruction ends, and how, where the input becomes active in period `at`.
    fn ending(periods: u32, at_most: u32, at: u32) -> (u32, Option<Alarm>) {
        let (mut switching, mut outputs) = (InstructionExecutor::default(), OutputBank::new(64));
        let until = Some(InputWait { input: 5, active: true, timeout_periods: at_most });
        switching.store(instruction(1, periods, until), &outputs).expect("the next number");
        switching.begin(&mut outputs);
        for n in 1..100 {
            let alarm = switching.run_period(u16::from(n >= at) << 5, false);
            if alarm.is_some() || switching.executed() == 1 {
                assert!(!switching.is_busy());
                return (n, alarm);
            }
        }
        (100, None)
    }

    #[test]
    fn waits_for_its_input_and_gives_up_in_time() {
        let late = Some(Alarm::TimedOut { instruction: 1 });
        assert_eq!(ending(0, 0, 1), (1, None));
        assert_eq!(ending(7, 3, 1), (7, None));
        assert_eq!(ending(7, 3, 9), (9, None));
        assert_eq!(ending(7, 3, 10), (10, None));
        assert_eq!(ending(7, 3, 11), (10, late));
        assert_eq!(ending(0, 1, 2), (1, late));
        assert_eq!(ending(7, 0, 90), (90, None));
        assert_eq!(ending(u32::MAX, u32::MAX, 1), (100, None));
    }

    #[test]
    fn a_failure_that_the_machine_reports_ends_it_unexecuted() {
        let (mut switching, mut outputs) = (InstructionExecutor::default(), OutputBank::new(64));
        switching.store(instruction(1, 5, None), &outputs).expect("the next number");
        assert_eq!(switching.run_period(0, true), None);
        switching.begin(&mut outputs);
        assert_eq!(switching.run_period(0, true), Some(Alarm::Failed { instruction: 1 }));
        assert_eq!((switching.executed(), switching.is_busy(), switching.waiting_place()), (0, false, None));
        assert_eq!(switching.barrier(), Some(RecordIndex::new(0)), "its place is held");
        switching.store(instruction(1, 5, None), &outputs).expect("its number stays the next");
    }
}
