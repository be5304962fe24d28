//! The executor of exclusive switching instructions (GMC-1, GMC-4 in the acknowledged form), and of those that a restart repeats.
//!
//! Invariant: one instruction in hand at a time, in the order of their numbers; it is kept until the cursor rests on its place, and
//! `executed` names the last one that is complete. Nothing else counts as ready, and nothing passes the place of one that is not.

use retrace_link::{Alarm, CommandRefusal, InputWait, Instruction, RepeatedInstruction};

use crate::OutputBank;

/// How far the instruction in hand has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum InstructionStage {
    /// It waits for the cursor to come to its place.
    Waiting,
    /// It is being executed, for so many control periods.
    Running(u32),
    /// An alarm has ended it. It holds its place still, until it is sent again.
    Cancelled,
}

/// The instruction in hand.
#[derive(Clone, Copy, Debug)]
struct PendingInstruction {
    instruction: Instruction,
    stage: InstructionStage,
}

/// The repeated instruction that is being executed, for so many control periods.
#[derive(Clone, Copy, Debug)]
struct PendingRepeat {
    instruction: RepeatedInstruction,
    passed: u32,
}

/// The instruction in hand, the repeated one, and how far the order of both has come.
#[derive(Clone, Debug, Default)]
pub struct InstructionExecutor {
    pending: Option<PendingInstruction>,
    executed: u32,
    repeat: Option<PendingRepeat>,
    repeated: u32,
}

/// What a control period of an instruction leads to.
enum InstructionProgress {
    Goes,
    Complete,
    TimedOut,
}

/// `passed` control periods of an instruction that takes `periods` and waits for `until`, with these inputs active.
fn progress(passed: u32, periods: u32, until: Option<InputWait>, active: u16) -> InstructionProgress {
    if passed < periods {
        return InstructionProgress::Goes;
    }
    let Some(until) = until else { return InstructionProgress::Complete };
    let is_active = u32::from(active) >> (until.input & 31) & 1 == 1;
    if is_active == until.active {
        InstructionProgress::Complete
    } else if until.timeout_periods != 0 && passed >= periods.saturating_add(until.timeout_periods) {
        InstructionProgress::TimedOut
    } else {
        InstructionProgress::Goes
    }
}

impl InstructionExecutor {
    /// Nothing in hand, nothing executed.
    #[must_use]
    pub const fn new() -> Self {
        Self { pending: None, executed: 0, repeat: None, repeated: 0 }
    }

    /// Number of the last complete instruction; where an epoch begins, what it began with.
    #[must_use]
    pub const fn executed(&self) -> u32 {
        self.executed
    }

    /// Number of the last complete repeated instruction; 0 where an epoch begins.
    #[must_use]
    pub const fn repeated(&self) -> u32 {
        self.repeated
    }

    /// Is an instruction being executed, a repeated one included?
    #[must_use]
    pub const fn busy(&self) -> bool {
        self.repeat.is_some()
            || matches!(self.pending, Some(PendingInstruction { stage: InstructionStage::Running(_), .. }))
    }

    /// Is an instruction being executed during which standing is not counted: a repeated one, or one that says so?
    #[must_use]
    pub const fn keeps_cutter(&self) -> bool {
        let by_itself = match self.pending {
            Some(PendingInstruction { instruction, stage: InstructionStage::Running(_) }) => instruction.keeps_cutter,
            _ => false,
        };
        self.repeat.is_some() || by_itself
    }

    /// The place of the instruction that is kept for it.
    #[must_use]
    pub const fn waits_for_place(&self) -> Option<u32> {
        match self.pending {
            Some(PendingInstruction { instruction, stage: InstructionStage::Waiting }) => Some(instruction.place),
            _ => None,
        }
    }

    /// The place that nothing may pass: that of the instruction in hand, also where an alarm has ended it.
    #[must_use]
    pub const fn barrier(&self) -> Option<u32> {
        match self.pending {
            Some(PendingInstruction { instruction, .. }) => Some(instruction.place),
            None => None,
        }
    }

    /// May this one be kept?
    ///
    /// # Errors
    /// [`Refusal::Busy`] where another is kept or executed, or the number is not the next; a channel that is not there.
    pub fn check(&self, instruction: &Instruction, outputs: &OutputBank) -> Result<(), CommandRefusal> {
        if self.busy() || self.waits_for_place().is_some() || instruction.number != self.executed.wrapping_add(1) {
            return Err(CommandRefusal::Busy);
        }
        if !instruction.changes().iter().all(|change| outputs.has(change.channel)) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        Ok(())
    }

    /// Keeps an instruction until its place is come to.
    ///
    /// # Errors
    /// As [`Switching::check`].
    pub fn store(&mut self, instruction: Instruction, outputs: &OutputBank) -> Result<(), CommandRefusal> {
        self.check(&instruction, outputs)?;
        self.pending = Some(PendingInstruction { instruction, stage: InstructionStage::Waiting });
        Ok(())
    }

    /// The place of the kept instruction is come to: its changes take place at once.
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

    /// Begins a repeated instruction: its changes take place at once.
    ///
    /// # Errors
    /// [`Refusal::Busy`] while an instruction is being executed, or where the number is not the next; a channel that is not there.
    pub fn repeat(&mut self, instruction: RepeatedInstruction, outputs: &mut OutputBank) -> Result<(), CommandRefusal> {
        if self.busy() || instruction.number != self.repeated.wrapping_add(1) {
            return Err(CommandRefusal::Busy);
        }
        if !instruction.changes().iter().all(|change| outputs.has(change.channel)) {
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

    /// One control period passes, with these inputs active. `failed`: the machine says that the instruction has failed.
    ///
    /// An instruction that failed or took too long is given up; the reason is returned, with its number in its own sequence.
    pub fn period(&mut self, active: u16, failed: bool) -> Option<Alarm> {
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
            InstructionProgress::Goes => {}
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
            InstructionProgress::Goes => self.repeat = Some(PendingRepeat { instruction, passed }),
            InstructionProgress::Complete => self.repeated = number,
            InstructionProgress::TimedOut => return Some(Alarm::TimedOut { instruction: number }),
        }
        None
    }

    /// What is in hand is given up: it is not executed, its number stays the next one, and nothing passes its place before it was sent
    /// again.
    pub const fn cancel(&mut self) {
        self.repeat = None;
        if let Some(in_hand) = &mut self.pending {
            in_hand.stage = InstructionStage::Cancelled;
        }
    }

    /// A new epoch: nothing in hand, and the numbers go on behind `executed`.
    pub const fn restart(&mut self, executed: u32) {
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
        assert_eq!((switching.period(0, false), spindle(&outputs), switching.busy()), (None, 0, false));
        switching.begin(&mut outputs);
        assert_eq!((spindle(&outputs), switching.busy()), (1, true));
        switching.period(0, false);
        assert_eq!(
            (switching.executed(), switching.store(instruction(2, 0, None), &outputs)),
            (0, Err(CommandRefusal::Busy))
        );
        switching.period(0, false);
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
        assert_eq!((switching.waits_for_place(), switching.executed()), (None, 0));
    }

    /// Periods after which an instruction ends, and how, where the input becomes active in period `at`.
    fn ending(periods: u32, at_most: u32, at: u32) -> (u32, Option<Alarm>) {
        let (mut switching, mut outputs) = (InstructionExecutor::default(), OutputBank::new(64));
        let until = Some(InputWait { input: 5, active: true, timeout_periods: at_most });
        switching.store(instruction(1, periods, until), &outputs).expect("the next number");
        switching.begin(&mut outputs);
        for n in 1..100 {
            let alarm = switching.period(u16::from(n >= at) << 5, false);
            if alarm.is_some() || switching.executed() == 1 {
                assert!(!switching.busy());
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
        assert_eq!(switching.period(0, true), None);
        switching.begin(&mut outputs);
        assert_eq!(switching.period(0, true), Some(Alarm::Failed { instruction: 1 }));
        assert_eq!((switching.executed(), switching.busy(), switching.waits_for_place()), (0, false, None));
        assert_eq!(switching.barrier(), Some(0), "its place is held");
        switching.store(instruction(1, 5, None), &outputs).expect("its number stays the next");
    }
}
