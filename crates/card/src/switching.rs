//! Executor of exclusive switching instructions (GMC-1, GMC-4 in the acknowledged form), and of those that a restart
//! repeats.
//!
//! Invariant: at most one instruction is pending, in the order of their numbers; it is stored until the cursor is at
//! rest on its place, and `executed` is the number of the last complete one. Nothing else counts as ready, and nothing
//! passes the place of an instruction that is not executed.

use retrace_core::RecordIndex;
use retrace_link::{
    Alarm, CommandRefusal, InputWait, Instruction, LayerMove, OutputChange, RepeatedInstruction, SpindleTask, channel,
};

use crate::layer::{LayerDrive, LayerProgress, SheetFault};
use crate::spindle_monitor::SpindleMonitor;
use crate::{OutputBank, SpindleFollower};

/// Stage of the pending instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum InstructionStage {
    /// It waits until the cursor reaches its place.
    Waiting,
    /// It is being executed.
    Running(Execution),
    /// An alarm has cancelled it, or its cutter was not started. It blocks its place until it is sent again.
    Cancelled,
}

/// Pending instruction.
#[derive(Clone, Copy, Debug)]
struct PendingInstruction {
    instruction: Instruction,
    stage: InstructionStage,
}

/// Repeated instruction that is being executed.
#[derive(Clone, Copy, Debug)]
struct PendingRepeat {
    instruction: RepeatedInstruction,
    execution: Execution,
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum InstructionProgress {
    Running,
    /// The outputs of a cutter are switched off before the next attempt.
    SwitchOff,
    /// The next attempt begins.
    SwitchOn,
    Complete,
    TimedOut,
    /// The spindle is not at speed, or its index not known, in time.
    NotAtSpeed,
    NotStarted,
    /// The sheet was not found; nothing is switched.
    NoSheet(SheetFault),
}

/// Reason why an instruction ended unexecuted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionFault {
    /// The machine stops with this alarm.
    Alarm(Alarm),
    /// A cutter was not proven in any of its attempts: its outputs are off, and the instruction is to be sent again.
    NotStarted,
    /// The sheet was not found: nothing was switched, and the instruction is to be sent again.
    NoSheet(SheetFault),
}

/// Part of an execution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ExecutionPart {
    /// The sheet is sensed, and the tool brought over it; nothing is switched yet.
    Sensing,
    /// The duration, then the wait for the input.
    Switching,
    /// The outputs of a cutter are off until the next attempt.
    BetweenAttempts,
    /// The cutter is proven: the pierce.
    Piercing,
    /// The layer moves behind the switching.
    MovingLayer,
}

/// Progress of an instruction that is being executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Execution {
    part: ExecutionPart,
    /// Control periods of this part.
    passed: u32,
    /// Control periods in a row for which the input has been as awaited.
    stable: u16,
    /// Attempts that failed.
    failed_attempts: u8,
}

impl Execution {
    const BEGUN: Self = Self { part: ExecutionPart::Switching, passed: 0, stable: 0, failed_attempts: 0 };

    /// Begins an execution: its changes are made at once, unless the sheet is sensed before.
    fn begin(
        changes: &[OutputChange],
        moves: Option<LayerMove>,
        outputs: &mut OutputBank,
        layer: &mut LayerDrive,
    ) -> Self {
        if layer.begin_before(moves) {
            return Self { part: ExecutionPart::Sensing, ..Self::BEGUN };
        }
        apply_changes(changes, outputs);
        Self::BEGUN
    }

    /// Runs one control period of an instruction with its moves of the layer.
    fn run_with_layer(
        &mut self,
        (periods, until, moves): (u32, Option<InputWait>, Option<LayerMove>),
        active: u16,
        layer: &mut LayerDrive,
    ) -> InstructionProgress {
        match (self.part, layer.progress()) {
            (ExecutionPart::Sensing, LayerProgress::Failed(fault)) => return InstructionProgress::NoSheet(fault),
            (ExecutionPart::Sensing, LayerProgress::Complete) => {
                self.begin_part(ExecutionPart::Switching);
                return InstructionProgress::SwitchOn;
            }
            (ExecutionPart::MovingLayer, LayerProgress::Complete) => return InstructionProgress::Complete,
            (ExecutionPart::Sensing | ExecutionPart::MovingLayer, _) => return InstructionProgress::Running,
            _ => {}
        }
        match self.run_period(periods, until, active) {
            InstructionProgress::Complete if layer.begin_behind(moves) => {
                self.begin_part(ExecutionPart::MovingLayer);
                InstructionProgress::Running
            }
            progress => progress,
        }
    }

    fn begin_part(&mut self, part: ExecutionPart) {
        (self.part, self.passed, self.stable) = (part, 0, 0);
    }

    /// Runs one control period of an instruction that takes `periods` and waits for `until`, with these inputs active.
    fn run_period(&mut self, periods: u32, until: Option<InputWait>, active: u16) -> InstructionProgress {
        self.passed = self.passed.saturating_add(1);
        let Some(until) = until else {
            return if self.passed < periods { InstructionProgress::Running } else { InstructionProgress::Complete };
        };
        let Some(ignition) = until.ignition else {
            return self.wait(periods, &until, 1, active);
        };
        match self.part {
            ExecutionPart::Switching => match self.wait(periods, &until, ignition.stable_periods, active) {
                InstructionProgress::Complete if ignition.delay_periods > 0 => {
                    self.begin_part(ExecutionPart::Piercing);
                    InstructionProgress::Running
                }
                InstructionProgress::TimedOut => {
                    self.failed_attempts = self.failed_attempts.saturating_add(1);
                    self.begin_part(ExecutionPart::BetweenAttempts);
                    let is_last = self.failed_attempts >= ignition.attempts;
                    if is_last { InstructionProgress::NotStarted } else { InstructionProgress::SwitchOff }
                }
                other => other,
            },
            ExecutionPart::BetweenAttempts if self.passed < u32::from(ignition.retry_periods) => {
                InstructionProgress::Running
            }
            ExecutionPart::BetweenAttempts => {
                self.begin_part(ExecutionPart::Switching);
                InstructionProgress::SwitchOn
            }
            ExecutionPart::Piercing if self.passed < ignition.delay_periods => InstructionProgress::Running,
            ExecutionPart::Piercing => InstructionProgress::Complete,
            ExecutionPart::Sensing | ExecutionPart::MovingLayer => InstructionProgress::Running,
        }
    }

    /// Waits for the duration, and then for the input.
    fn wait(&mut self, periods: u32, until: &InputWait, stable_periods: u16, active: u16) -> InstructionProgress {
        let is_active = u32::from(active) >> (until.input & 31) & 1 == 1;
        self.stable = if is_active == until.active { self.stable.saturating_add(1) } else { 0 };
        if self.passed < periods {
            InstructionProgress::Running
        } else if self.stable >= stable_periods.max(1) {
            InstructionProgress::Complete
        } else if until.timeout_periods != 0 && self.passed >= periods.saturating_add(until.timeout_periods) {
            InstructionProgress::TimedOut
        } else {
            InstructionProgress::Running
        }
    }
}

/// Whether a repeated instruction has switched the spindle on, or changed its speed: nothing moves before it is reached
/// (SPN-6).
fn awaits_speed(instruction: &RepeatedInstruction, outputs: &OutputBank) -> bool {
    let concerns = |change: &OutputChange| matches!(change.channel, channel::SPINDLE | channel::SPEED);
    let value = |number: u8| outputs.values()[usize::from(number)];
    let turns = value(channel::SPINDLE) != 0 && value(channel::SPEED) > 0;
    turns && !instruction.is_pulse && instruction.changes().iter().any(concerns)
}

/// Waits for the speed of a spindle with an encoder. `passed`: control periods of an instruction that takes `periods`.
fn run_speed_wait(spindle: &SpindleMonitor, passed: u32, periods: u32) -> InstructionProgress {
    let Some(settings) = spindle.settings() else { return InstructionProgress::Complete };
    match spindle.is_at_speed() {
        true => InstructionProgress::Complete,
        false if passed > periods.saturating_add(settings.timeout_periods) => InstructionProgress::NotAtSpeed,
        false => InstructionProgress::Running,
    }
}

/// Waits for the spindle, and prepares the gear of a stretch behind the instruction. `passed`: control periods of the
/// instruction.
fn run_spindle_task(
    task: SpindleTask,
    instruction: &Instruction,
    passed: u32,
    spindle: Option<&mut SpindleFollower>,
) -> InstructionProgress {
    let Some(SpindleFollower { monitor: spindle, gear }) = spindle else { return InstructionProgress::NotAtSpeed };
    let Some(settings) = spindle.settings() else { return InstructionProgress::NotAtSpeed };
    let is_ready = spindle.is_at_speed() && (task == SpindleTask::AtSpeed || spindle.zero_angle().is_some());
    if !is_ready {
        let is_late = passed > instruction.periods.saturating_add(settings.timeout_periods);
        return if is_late { InstructionProgress::NotAtSpeed } else { InstructionProgress::Running };
    }
    match task {
        SpindleTask::AtSpeed => InstructionProgress::Complete,
        SpindleTask::Gear(start) if gear.arm(instruction.place, start, spindle) => InstructionProgress::Complete,
        SpindleTask::Gear(_) => InstructionProgress::NotAtSpeed,
    }
}

fn apply_changes(changes: &[OutputChange], outputs: &mut OutputBank) {
    for &change in changes {
        outputs.set(change);
    }
}

fn switch_off(changes: &[OutputChange], outputs: &mut OutputBank) {
    for &change in changes.iter().filter(|change| change.value != 0) {
        outputs.set(OutputChange { value: 0, ..change });
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

    /// Whether an instruction of the program is being executed, not a repeated one.
    #[must_use]
    pub(crate) const fn is_program_running(&self) -> bool {
        self.repeat.is_none()
            && matches!(self.pending, Some(PendingInstruction { stage: InstructionStage::Running(_), .. }))
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

    /// Begins the stored instruction at its place: its changes are made at once, unless the sheet is sensed before.
    pub fn begin(&mut self, outputs: &mut OutputBank, layer: &mut LayerDrive) {
        let Some(PendingInstruction { instruction, stage: InstructionStage::Waiting }) = self.pending else { return };
        let execution = Execution::begin(instruction.changes(), instruction.layer, outputs, layer);
        let awaits = instruction.until.is_some() || instruction.layer.is_some() || instruction.spindle.is_some();
        if instruction.periods == 0 && !awaits {
            self.complete(&instruction);
        } else {
            self.pending = Some(PendingInstruction { instruction, stage: InstructionStage::Running(execution) });
        }
    }

    /// Begins a repeated instruction: its changes are made at once, unless the sheet is sensed before. `has_encoder`:
    /// the speed of the spindle is known.
    ///
    /// # Errors
    /// [`CommandRefusal::Busy`] while an instruction is being executed, or if the number is not the next one;
    /// [`CommandRefusal::NoSuchChannel`] for a channel that does not exist.
    pub fn repeat(
        &mut self,
        instruction: RepeatedInstruction,
        outputs: &mut OutputBank,
        layer: &mut LayerDrive,
        has_encoder: bool,
    ) -> Result<(), CommandRefusal> {
        if self.is_busy() || instruction.number != self.repeated.wrapping_add(1) {
            return Err(CommandRefusal::Busy);
        }
        if !instruction.changes().iter().all(|change| outputs.has_channel(change.channel)) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        if instruction.is_pulse && instruction.periods == 0 {
            self.repeated = instruction.number;
            return Ok(());
        }
        layer.forget_kept_sheet();
        let execution = Execution::begin(instruction.changes(), instruction.layer, outputs, layer);
        let awaits_speed = has_encoder && awaits_speed(&instruction, outputs);
        if instruction.periods == 0 && instruction.until.is_none() && instruction.layer.is_none() && !awaits_speed {
            self.repeated = instruction.number;
        } else {
            self.repeat = Some(PendingRepeat { instruction, execution });
        }
        Ok(())
    }

    /// Runs one control period with these inputs active. `failed` means that the machine reports the instruction as
    /// failed.
    ///
    /// An instruction that failed or timed out is cancelled, and the alarm is returned, with the number in its own
    /// sequence. A cutter that is not proven is switched off and on again, as often as its instruction allows.
    pub fn run_period(
        &mut self,
        active: u16,
        failed: bool,
        outputs: &mut OutputBank,
        layer: &mut LayerDrive,
        spindle: Option<&mut SpindleFollower>,
    ) -> Option<InstructionFault> {
        if let Some(PendingRepeat { instruction, execution }) = self.repeat {
            return self.run_repeat_period(&instruction, execution, (active, failed), outputs, layer, spindle);
        }
        let Some(PendingInstruction { instruction, stage: InstructionStage::Running(mut execution) }) = self.pending
        else {
            return None;
        };
        let number = instruction.number;
        if failed {
            self.cancel();
            return Some(InstructionFault::Alarm(Alarm::Failed { instruction: number }));
        }
        let timing = (instruction.periods, instruction.until, instruction.layer);
        let mut progress = execution.run_with_layer(timing, active, layer);
        if progress == InstructionProgress::Complete
            && let Some(task) = instruction.spindle
        {
            progress = run_spindle_task(task, &instruction, execution.passed, spindle);
        }
        self.pending = Some(PendingInstruction { instruction, stage: InstructionStage::Running(execution) });
        match progress {
            InstructionProgress::Running => {}
            InstructionProgress::SwitchOff => switch_off(instruction.changes(), outputs),
            InstructionProgress::SwitchOn => apply_changes(instruction.changes(), outputs),
            InstructionProgress::Complete => self.complete(&instruction),
            InstructionProgress::TimedOut => {
                self.cancel();
                return Some(InstructionFault::Alarm(Alarm::TimedOut { instruction: number }));
            }
            InstructionProgress::NotAtSpeed => {
                self.cancel();
                return Some(InstructionFault::Alarm(Alarm::NotAtSpeed));
            }
            InstructionProgress::NotStarted => {
                switch_off(instruction.changes(), outputs);
                self.cancel_running();
                return Some(InstructionFault::NotStarted);
            }
            InstructionProgress::NoSheet(fault) => {
                self.cancel_running();
                return Some(InstructionFault::NoSheet(fault));
            }
        }
        None
    }

    fn run_repeat_period(
        &mut self,
        instruction: &RepeatedInstruction,
        mut execution: Execution,
        (active, failed): (u16, bool),
        outputs: &mut OutputBank,
        layer: &mut LayerDrive,
        spindle: Option<&mut SpindleFollower>,
    ) -> Option<InstructionFault> {
        self.repeat = None;
        let number = instruction.number;
        if failed {
            return Some(InstructionFault::Alarm(Alarm::Failed { instruction: number }));
        }
        let timing = (instruction.periods, instruction.until, instruction.layer);
        let mut progress = execution.run_with_layer(timing, active, layer);
        if progress == InstructionProgress::Complete
            && awaits_speed(instruction, outputs)
            && let Some(spindle) = spindle
        {
            progress = run_speed_wait(&spindle.monitor, execution.passed, instruction.periods);
        }
        match progress {
            InstructionProgress::Complete => {
                self.repeated = number;
                if instruction.is_pulse {
                    switch_off(instruction.changes(), outputs);
                }
                return None;
            }
            InstructionProgress::TimedOut => {
                return Some(InstructionFault::Alarm(Alarm::TimedOut { instruction: number }));
            }
            InstructionProgress::NotAtSpeed => return Some(InstructionFault::Alarm(Alarm::NotAtSpeed)),
            InstructionProgress::NotStarted => {
                switch_off(instruction.changes(), outputs);
                return Some(InstructionFault::NotStarted);
            }
            InstructionProgress::NoSheet(fault) => return Some(InstructionFault::NoSheet(fault)),
            InstructionProgress::SwitchOff => switch_off(instruction.changes(), outputs),
            InstructionProgress::SwitchOn => apply_changes(instruction.changes(), outputs),
            InstructionProgress::Running => {}
        }
        self.repeat = Some(PendingRepeat { instruction: *instruction, execution });
        None
    }

    /// Whether a test pulse is being executed.
    #[must_use]
    pub fn is_pulse(&self) -> bool {
        self.repeat.as_ref().is_some_and(|repeat| repeat.instruction.is_pulse)
    }

    /// Ends the test pulse before its time: it is complete.
    pub(crate) fn end_pulse(&mut self, outputs: &mut OutputBank) {
        if let Some(PendingRepeat { instruction, .. }) = self.repeat.take() {
            switch_off(instruction.changes(), outputs);
            self.repeated = instruction.number;
        }
    }

    /// Cancels the instruction that is being executed, because its cutter was lost or not started. One that waits for
    /// its place still does.
    pub const fn cancel_running(&mut self) {
        self.repeat = None;
        if let Some(PendingInstruction { stage: stage @ InstructionStage::Running(_), .. }) = &mut self.pending {
            *stage = InstructionStage::Cancelled;
        }
    }

    /// Whether an instruction switches this channel on that is being executed or waits for its place.
    #[must_use]
    pub(crate) fn switches_on(&self, channel: u8) -> bool {
        let is_on = |changes: &[OutputChange]| changes.iter().any(|c| c.channel == channel && c.value != 0);
        let pending = self.pending.as_ref().filter(|pending| pending.stage != InstructionStage::Cancelled);
        pending.is_some_and(|pending| is_on(pending.instruction.changes()))
            || self.repeat.as_ref().is_some_and(|repeat| is_on(repeat.instruction.changes()))
    }

    /// Whether a repeated instruction senses the sheet and lights nothing: a sense test.
    pub(crate) fn is_sense_test(&self) -> bool {
        let senses = |of: &RepeatedInstruction| of.count == 0 && matches!(of.layer, Some(LayerMove::Start { .. }));
        self.repeat.as_ref().is_some_and(|repeat| senses(&repeat.instruction))
    }

    /// Returns the changes that the waiting instruction makes, and its moves of the layer.
    pub(crate) fn waiting_changes(&self) -> (&[OutputChange], Option<LayerMove>) {
        match &self.pending {
            Some(PendingInstruction { instruction, stage: InstructionStage::Waiting }) => {
                (instruction.changes(), instruction.layer)
            }
            _ => (&[], None),
        }
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
    use crate::OutputCounts;
    use retrace_link::{InputWait, OutputChange, channel};

    fn instruction(number: u32, periods: u32, until: Option<InputWait>) -> Instruction {
        let mut instruction = Instruction { number, periods, until, count: 1, ..Instruction::default() };
        instruction.changes[0] = OutputChange { channel: channel::SPINDLE, value: number as i32 };
        instruction
    }

    #[test]
    fn takes_its_time_and_keeps_the_order() {
        let (mut switching, mut outputs) = (InstructionExecutor::default(), OutputBank::new(OutputCounts::ALL));
        let spindle = |outputs: &OutputBank| outputs.values()[usize::from(channel::SPINDLE)];
        assert_eq!(switching.store(instruction(2, 0, None), &outputs), Err(CommandRefusal::Busy));
        switching.store(instruction(1, 2, None), &outputs).expect("the next number");
        assert_eq!(
            (
                switching.run_period(0, false, &mut outputs, &mut LayerDrive::new(), None),
                spindle(&outputs),
                switching.is_busy()
            ),
            (None, 0, false)
        );
        switching.begin(&mut outputs, &mut LayerDrive::new());
        assert_eq!((spindle(&outputs), switching.is_busy()), (1, true));
        switching.run_period(0, false, &mut outputs, &mut LayerDrive::new(), None);
        assert_eq!(
            (switching.executed(), switching.store(instruction(2, 0, None), &outputs)),
            (0, Err(CommandRefusal::Busy))
        );
        switching.run_period(0, false, &mut outputs, &mut LayerDrive::new(), None);
        assert_eq!(switching.executed(), 1);
        switching.store(instruction(2, 0, None), &outputs).expect("the next number");
        switching.begin(&mut outputs, &mut LayerDrive::new());
        assert_eq!((switching.executed(), spindle(&outputs)), (2, 2));
    }

    #[test]
    fn a_channel_that_is_not_there_is_refused_before_anything_is_switched() {
        let (mut switching, outputs) =
            (InstructionExecutor::default(), OutputBank::new(OutputCounts { digital: 4, ..OutputCounts::ALL }));
        let mut bad = instruction(1, 0, None);
        bad.count = 2;
        bad.changes[1] = OutputChange { channel: 4, value: 1 };
        assert_eq!(switching.store(bad, &outputs), Err(CommandRefusal::NoSuchChannel));
        assert_eq!((switching.waiting_place(), switching.executed()), (None, 0));
    }

    /// Periods after which an instruction ends, and how, where the input becomes active in period `at`.
    fn ending(periods: u32, at_most: u32, at: u32) -> (u32, Option<Alarm>) {
        let (mut switching, mut outputs) = (InstructionExecutor::default(), OutputBank::new(OutputCounts::ALL));
        let until = Some(InputWait::new(5, true, at_most));
        switching.store(instruction(1, periods, until), &outputs).expect("the next number");
        switching.begin(&mut outputs, &mut LayerDrive::new());
        for n in 1..100 {
            let alarm = match switching.run_period(
                u16::from(n >= at) << 5,
                false,
                &mut outputs,
                &mut LayerDrive::new(),
                None,
            ) {
                Some(InstructionFault::Alarm(alarm)) => Some(alarm),
                None => None,
                Some(InstructionFault::NotStarted | InstructionFault::NoSheet(_)) => panic!("no cutter"),
            };
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
        let (mut switching, mut outputs) = (InstructionExecutor::default(), OutputBank::new(OutputCounts::ALL));
        switching.store(instruction(1, 5, None), &outputs).expect("the next number");
        assert_eq!(switching.run_period(0, true, &mut outputs, &mut LayerDrive::new(), None), None);
        switching.begin(&mut outputs, &mut LayerDrive::new());
        assert_eq!(
            switching.run_period(0, true, &mut outputs, &mut LayerDrive::new(), None),
            Some(InstructionFault::Alarm(Alarm::Failed { instruction: 1 }))
        );
        assert_eq!((switching.executed(), switching.is_busy(), switching.waiting_place()), (0, false, None));
        assert_eq!(switching.barrier(), Some(RecordIndex::new(0)), "its place is held");
        switching.store(instruction(1, 5, None), &outputs).expect("its number stays the next");
    }
}
