//! The executor of exclusive switching instructions (GMC-1, GMC-4 in the acknowledged form), and of those that a restart repeats.
//!
//! Invariant: one instruction in hand at a time, in the order of their numbers; it is kept until the cursor rests on its place, and
//! `executed` names the last one that is complete. Nothing else counts as ready, and nothing passes the place of one that is not.

use retrace_link::{Alarm, Await, Instruction, Refusal, RepeatedInstruction};

use crate::OutputBank;

/// How far the instruction in hand has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// It waits for the cursor to come to its place.
    Kept,
    /// It is being executed, for so many control periods.
    Running(u32),
    /// An alarm has ended it. It holds its place still, until it is sent again.
    GivenUp,
}

/// The instruction in hand.
#[derive(Clone, Copy, Debug)]
struct InHand {
    instruction: Instruction,
    stage: Stage,
}

/// The repeated instruction that is being executed, for so many control periods.
#[derive(Clone, Copy, Debug)]
struct RepeatInHand {
    instruction: RepeatedInstruction,
    passed: u32,
}

/// The instruction in hand, the repeated one, and how far the order of both has come.
#[derive(Clone, Debug, Default)]
pub struct Switching {
    in_hand: Option<InHand>,
    executed: u32,
    repeat: Option<RepeatInHand>,
    repeated: u32,
}

/// What a control period of an instruction leads to.
enum Progress {
    Goes,
    Complete,
    TimedOut,
}

/// `passed` control periods of an instruction that takes `periods` and waits for `until`, with these inputs active.
fn progress(passed: u32, periods: u32, until: Option<Await>, active: u16) -> Progress {
    if passed < periods {
        return Progress::Goes;
    }
    let Some(until) = until else { return Progress::Complete };
    let is_active = u32::from(active) >> (until.input & 31) & 1 == 1;
    if is_active == until.active {
        Progress::Complete
    } else if until.at_most != 0 && passed >= periods.saturating_add(until.at_most) {
        Progress::TimedOut
    } else {
        Progress::Goes
    }
}

impl Switching {
    /// Nothing in hand, nothing executed.
    #[must_use]
    pub const fn new() -> Self {
        Self { in_hand: None, executed: 0, repeat: None, repeated: 0 }
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
        self.repeat.is_some() || matches!(self.in_hand, Some(InHand { stage: Stage::Running(_), .. }))
    }

    /// Is an instruction being executed during which standing is not counted: a repeated one, or one that says so?
    #[must_use]
    pub const fn keeps_cutter(&self) -> bool {
        let by_itself = match self.in_hand {
            Some(InHand { instruction, stage: Stage::Running(_) }) => instruction.keeps_cutter,
            _ => false,
        };
        self.repeat.is_some() || by_itself
    }

    /// The place of the instruction that is kept for it.
    #[must_use]
    pub const fn kept_for(&self) -> Option<u32> {
        match self.in_hand {
            Some(InHand { instruction, stage: Stage::Kept }) => Some(instruction.place),
            _ => None,
        }
    }

    /// The place that nothing may pass: that of the instruction in hand, also where an alarm has ended it.
    #[must_use]
    pub const fn barrier(&self) -> Option<u32> {
        match self.in_hand {
            Some(InHand { instruction, .. }) => Some(instruction.place),
            None => None,
        }
    }

    /// May this one be kept?
    ///
    /// # Errors
    /// [`Refusal::Busy`] where another is kept or executed, or the number is not the next; a channel that is not there.
    pub fn check(&self, instruction: &Instruction, outputs: &OutputBank) -> Result<(), Refusal> {
        if self.busy() || self.kept_for().is_some() || instruction.number != self.executed.wrapping_add(1) {
            return Err(Refusal::Busy);
        }
        if !instruction.changes().iter().all(|change| outputs.has(change.channel)) {
            return Err(Refusal::NoSuchChannel);
        }
        Ok(())
    }

    /// Keeps an instruction until its place is come to.
    ///
    /// # Errors
    /// As [`Switching::check`].
    pub fn keep(&mut self, instruction: Instruction, outputs: &OutputBank) -> Result<(), Refusal> {
        self.check(&instruction, outputs)?;
        self.in_hand = Some(InHand { instruction, stage: Stage::Kept });
        Ok(())
    }

    /// The place of the kept instruction is come to: its changes take place at once.
    pub fn begin(&mut self, outputs: &mut OutputBank) {
        let Some(InHand { instruction, stage: Stage::Kept }) = self.in_hand else { return };
        for &change in instruction.changes() {
            outputs.set(change);
        }
        if instruction.periods == 0 && instruction.until.is_none() {
            self.complete(&instruction);
        } else {
            self.in_hand = Some(InHand { instruction, stage: Stage::Running(0) });
        }
    }

    /// Begins a repeated instruction: its changes take place at once.
    ///
    /// # Errors
    /// [`Refusal::Busy`] while an instruction is being executed, or where the number is not the next; a channel that is not there.
    pub fn repeat(&mut self, instruction: RepeatedInstruction, outputs: &mut OutputBank) -> Result<(), Refusal> {
        if self.busy() || instruction.number != self.repeated.wrapping_add(1) {
            return Err(Refusal::Busy);
        }
        if !instruction.changes().iter().all(|change| outputs.has(change.channel)) {
            return Err(Refusal::NoSuchChannel);
        }
        for &change in instruction.changes() {
            outputs.set(change);
        }
        if instruction.periods == 0 && instruction.until.is_none() {
            self.repeated = instruction.number;
        } else {
            self.repeat = Some(RepeatInHand { instruction, passed: 0 });
        }
        Ok(())
    }

    /// One control period passes, with these inputs active. `failed`: the machine says that the instruction has failed.
    ///
    /// An instruction that failed or took too long is given up; the reason is returned, with its number in its own sequence.
    pub fn period(&mut self, active: u16, failed: bool) -> Option<Alarm> {
        if let Some(RepeatInHand { instruction, passed }) = self.repeat {
            return self.repeat_period(instruction, passed.saturating_add(1), active, failed);
        }
        let Some(InHand { instruction, stage: Stage::Running(passed) }) = self.in_hand else { return None };
        let passed = passed.saturating_add(1);
        self.in_hand = Some(InHand { instruction, stage: Stage::Running(passed) });
        let number = instruction.number;
        if failed {
            self.give_up();
            return Some(Alarm::Failed { instruction: number });
        }
        match progress(passed, instruction.periods, instruction.until, active) {
            Progress::Goes => {}
            Progress::Complete => self.complete(&instruction),
            Progress::TimedOut => {
                self.give_up();
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
            Progress::Goes => self.repeat = Some(RepeatInHand { instruction, passed }),
            Progress::Complete => self.repeated = number,
            Progress::TimedOut => return Some(Alarm::TimedOut { instruction: number }),
        }
        None
    }

    /// What is in hand is given up: it is not executed, its number stays the next one, and nothing passes its place before it was sent
    /// again.
    pub const fn give_up(&mut self) {
        self.repeat = None;
        if let Some(in_hand) = &mut self.in_hand {
            in_hand.stage = Stage::GivenUp;
        }
    }

    /// A new epoch: nothing in hand, and the numbers go on behind `executed`.
    pub const fn restart(&mut self, executed: u32) {
        (self.in_hand, self.executed) = (None, executed);
        (self.repeat, self.repeated) = (None, 0);
    }

    const fn complete(&mut self, instruction: &Instruction) {
        (self.in_hand, self.executed) = (None, instruction.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_link::{Await, Change, channel};

    fn instruction(number: u32, periods: u32, until: Option<Await>) -> Instruction {
        let mut instruction = Instruction { number, periods, until, count: 1, ..Instruction::default() };
        instruction.changes[0] = Change { channel: channel::SPINDLE, value: number as i32 };
        instruction
    }

    #[test]
    fn takes_its_time_and_keeps_the_order() {
        let (mut switching, mut outputs) = (Switching::default(), OutputBank::new(64));
        let spindle = |outputs: &OutputBank| outputs.values()[usize::from(channel::SPINDLE)];
        assert_eq!(switching.keep(instruction(2, 0, None), &outputs), Err(Refusal::Busy));
        switching.keep(instruction(1, 2, None), &outputs).expect("the next number");
        assert_eq!((switching.period(0, false), spindle(&outputs), switching.busy()), (None, 0, false));
        switching.begin(&mut outputs);
        assert_eq!((spindle(&outputs), switching.busy()), (1, true));
        switching.period(0, false);
        assert_eq!((switching.executed(), switching.keep(instruction(2, 0, None), &outputs)), (0, Err(Refusal::Busy)));
        switching.period(0, false);
        assert_eq!(switching.executed(), 1);
        switching.keep(instruction(2, 0, None), &outputs).expect("the next number");
        switching.begin(&mut outputs);
        assert_eq!((switching.executed(), spindle(&outputs)), (2, 2));
    }

    #[test]
    fn a_channel_that_is_not_there_is_refused_before_anything_is_switched() {
        let (mut switching, outputs) = (Switching::default(), OutputBank::new(4));
        let mut bad = instruction(1, 0, None);
        bad.count = 2;
        bad.changes[1] = Change { channel: 4, value: 1 };
        assert_eq!(switching.keep(bad, &outputs), Err(Refusal::NoSuchChannel));
        assert_eq!((switching.kept_for(), switching.executed()), (None, 0));
    }

    /// Periods after which an instruction ends, and how, where the input becomes active in period `at`.
    fn ending(periods: u32, at_most: u32, at: u32) -> (u32, Option<Alarm>) {
        let (mut switching, mut outputs) = (Switching::default(), OutputBank::new(64));
        let until = Some(Await { input: 5, active: true, at_most });
        switching.keep(instruction(1, periods, until), &outputs).expect("the next number");
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
        let (mut switching, mut outputs) = (Switching::default(), OutputBank::new(64));
        switching.keep(instruction(1, 5, None), &outputs).expect("the next number");
        assert_eq!(switching.period(0, true), None);
        switching.begin(&mut outputs);
        assert_eq!(switching.period(0, true), Some(Alarm::Failed { instruction: 1 }));
        assert_eq!((switching.executed(), switching.busy(), switching.kept_for()), (0, false, None));
        assert_eq!(switching.barrier(), Some(0), "its place is held");
        switching.keep(instruction(1, 5, None), &outputs).expect("its number stays the next");
    }
}
