//! The player: combines window, drive, pulses and switching; one call per control period.
//!
//! Invariant: `counts` equals `P(place)` at all times, where P is the sum of the records before a place (core,
//! `playback`), in addition to the counts at the beginning of the epoch. The cursor never passes the place of an
//! instruction that is not executed.

use retrace_core::drive::{Drive, RecordWindow};
use retrace_core::limits::RateLimits;
use retrace_core::playback::{emission, feed_share_between};
use retrace_core::{Distance, Place, Rate, RateTarget, Record, RecordIndex};
use retrace_link::{
    ANALOG_INPUTS, Alarm, AnalogInputs, CardSettings, CardStatus, CommandRefusal, CutterOffCause, HostCommand,
    Instruction, MAX_LAYER, OutputAction, OutputChange, Outputs, PathStart, channel,
};

use crate::layer::{LayerDrive, SheetFault};
use crate::permit::PermitConditions;
use crate::probe_drive::ProbeDrive;
use crate::switching::InstructionFault;
use crate::window::RecordStorage;
use crate::{
    ActionTable, CardWindow, CutterPermit, FOLLOWED_SPINDLES, HeightControl, HeightControllers, InstructionExecutor,
    OutputBank, OutputCounts, SpindleFollower,
};

mod cutters;
mod gearing;
mod height;
mod probing;
mod repeating;

/// Maximum number of output actions that a card holds.
const ACTIONS: usize = 256;

/// Reason why motion must not start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MotionBlock {
    None,
    /// A restart, until the repeated instruction of this number is complete.
    Restart {
        last: u32,
        /// Whether one of its repeated instructions was accepted.
        begun: bool,
    },
    /// A cutter went out where the program expects it to be on: the grace time ended, it was lost, or it was not
    /// started; until a restart.
    CutterOff,
}

/// Player of a card for `A` axes, a window of `W` records, and an average of the rate law of up to `M` periods.
///
/// It plays records and switches outputs as commanded. Alarms, inputs, homing and the watchdog belong to the
/// [`crate::Card`] around it.
#[derive(Clone, Debug)]
pub struct Player<const A: usize, const W: usize, const M: usize, S = [Record<A>; W]> {
    window: CardWindow<A, W, S>,
    drive: Drive<A, M>,
    actions: ActionTable<ACTIONS>,
    switching: InstructionExecutor,
    outputs: OutputBank,
    target: RateTarget,
    replay: bool,
    /// Whether the axes move off the path: homing.
    off_path: bool,
    /// Whether backlash is being taken up: the machine is at rest only when that is complete.
    taking_up_backlash: bool,
    /// Block of motion, until a restart is complete.
    block: MotionBlock,
    permit: CutterPermit,
    /// Height over the sheet, added to the path of the tool axis.
    layer: LayerDrive,
    /// Control of that height.
    height: HeightControllers,
    /// Latch of the probe.
    probe: ProbeDrive<A>,
    /// The spindle as it is measured, and the motion that follows it.
    followed: [SpindleFollower; FOLLOWED_SPINDLES],
    /// Alarm of an instruction that could not begin.
    start_alarm: Option<Alarm>,
    /// Active collision input: no cutter is started.
    collision: Option<u8>,
    /// Conditions of the last period, as far as the player knows them.
    conditions: PermitConditions,
    /// Speed along the path in the last period, as a share of the programmed feed in units of 2⁻⁴⁷.
    feed_share: u64,
    status: CardStatus<A>,
}

impl<const A: usize, const W: usize, const M: usize> Player<A, W, M> {
    /// Creates a player at rest at record `start`, all counts and outputs zero, with all output channels. Returns
    /// `None` if the rate law's average exceeds the card's memory, or the machine brakes too slowly.
    #[must_use]
    pub fn new(start: RecordIndex, limits: RateLimits<A>) -> Option<Self> {
        let drive = Drive::new(limits)?;
        Some(Self { drive, ..Self::unconfigured(start, OutputCounts::ALL)? })
    }

    /// Creates a player with so many outputs and without limits of a machine: nothing may be played on it.
    pub(crate) const fn unconfigured(start: RecordIndex, counts: OutputCounts) -> Option<Self> {
        // `?` is not allowed in a constant
        let Some(drive) = Drive::unconfigured() else { return None };
        Some(Self::rest(CardWindow::new(start), drive, start, counts))
    }
}

impl<const A: usize, const W: usize, const M: usize> Player<A, W, M, &'static mut [Record<A>]> {
    /// Creates a player as [`Player::unconfigured`] does, whose records are provided later.
    pub(crate) const fn unconfigured_without_records(counts: OutputCounts) -> Option<Self> {
        let Some(drive) = Drive::unconfigured() else { return None };
        let start = RecordIndex::new(0);
        Some(Self::rest(CardWindow::with_records(start, &mut []), drive, start, counts))
    }

    /// Sets the storage of the `W` records.
    pub(crate) fn lend_records(&mut self, records: &'static mut [Record<A>]) {
        self.window.lend_records(records);
    }
}

impl<const A: usize, const W: usize, const M: usize, S> Player<A, W, M, S> {
    const fn rest(window: CardWindow<A, W, S>, drive: Drive<A, M>, start: RecordIndex, counts: OutputCounts) -> Self {
        Self {
            window,
            drive,
            actions: ActionTable::new(),
            switching: InstructionExecutor::new(),
            outputs: OutputBank::new(counts),
            target: RateTarget::ZERO,
            replay: false,
            off_path: false,
            taking_up_backlash: false,
            block: MotionBlock::None,
            permit: CutterPermit::new(),
            layer: LayerDrive::new(),
            height: HeightControl::NONE,
            probe: ProbeDrive::new(),
            followed: [SpindleFollower::NONE; FOLLOWED_SPINDLES],
            start_alarm: None,
            collision: None,
            conditions: PermitConditions {
                denied: None,
                backward: false,
                moving: false,
                awaits_motion: false,
                keeps_cutter: false,
                is_unwatched: false,
                inputs: 0,
                place: Place::start_of(start),
            },
            feed_share: 0,
            status: CardStatus::at_rest(PathStart::at(start)),
        }
    }
}

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Player<A, W, M, S> {
    /// Creates a player as [`Player::unconfigured`] does, with its `W` records in `records`.
    pub(crate) fn unconfigured_with_records(records: S, counts: OutputCounts) -> Option<Self> {
        let start = RecordIndex::new(0);
        Some(Self::rest(CardWindow::with_records(start, records), Drive::unconfigured()?, start, counts))
    }

    /// Begins an epoch: the window is empty and instruction_begins with the record of `start`. Counts and outputs are
    /// unchanged, except cutting outputs, which are switched off. A pending instruction is cancelled, even while it is
    /// being executed: so a host can end one that waits forever.
    ///
    /// # Errors
    /// [`CommandRefusal::InMotion`] if the machine is in motion, [`CommandRefusal::Unsupported`] if the start is
    /// invalid or the rate law does not fit; nothing has changed then.
    pub(crate) fn reopen(&mut self, settings: &CardSettings<A>, most: u16) -> Result<(), CommandRefusal> {
        let CardSettings { start, limits, cutting, .. } = settings;
        if !self.status.at_rest {
            return Err(CommandRefusal::InMotion);
        }
        if !start.is_valid() {
            return Err(CommandRefusal::Unsupported);
        }
        self.drive = Drive::new(*limits).ok_or(CommandRefusal::Unsupported)?;
        self.open_layer(settings, most);
        self.window.restart(start.place.record, start.rests);
        self.actions.clear();
        self.permit.open(cutting, self.outputs.values_mut(), start.place);
        self.switching.reset(start.executed);
        (self.target, self.replay, self.block) = (RateTarget::ZERO, false, MotionBlock::None);
        self.probe = ProbeDrive::new();
        self.open_gear(settings);
        (self.status.probe, self.status.probe_edge) = (self.probe.latch(), None);
        let status = &mut self.status;
        (status.place, status.reached) = (start.place, start.reached);
        (status.rate, status.starved, status.line) = (Rate::ZERO, false, 0);
        status.increments = [0; A];
        self.update_status();
        Ok(())
    }

    /// Restores counts and output values.
    pub(crate) fn restore_state(&mut self, counts: [i64; A], outputs: &Outputs) {
        self.status.counts = counts;
        for (channel, &value) in (0u8..).zip(outputs) {
            self.outputs.set(OutputChange { channel, value });
        }
        self.switch_cutters_off(CutterOffCause::EpochOpened);
    }

    /// Returns the status of the last period.
    #[must_use]
    pub const fn status(&self) -> &CardStatus<A> {
        &self.status
    }

    /// Returns the status for the card around the player to complete.
    pub(crate) const fn status_mut(&mut self) -> &mut CardStatus<A> {
        &mut self.status
    }

    /// Whether the machine is at rest and no instruction is being executed.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.path_is_at_rest() && self.layer.at_rest() && !self.taking_up_backlash && !self.switching.is_busy()
    }

    /// Whether the next period would move the machine or begin an instruction, or continue either.
    pub(crate) fn is_about_to_act(&self) -> bool {
        let (place, window) = (self.status.place, self.record_window());
        let distance = match self.unblocked_target().signum() {
            0 => Distance::ZERO,
            _ if !self.has_record_under_cursor() => Distance::ZERO,
            1 => place.distance_to(Place::start_of(window.high())),
            _ => Place::start_of(window.low()).distance_to(place),
        };
        !self.is_at_rest() || distance > Distance::ZERO || self.is_due()
    }

    /// Whether the window is empty and no instruction is pending.
    pub(crate) fn is_empty(&self) -> bool {
        self.window.low() == self.window.high() && self.switching.waiting_place().is_none() && self.is_at_rest()
    }

    /// Handles an alarm: brakes on the path, cancels the pending instruction, and locks the outputs at their safe
    /// values.
    pub(crate) fn halt(&mut self, safe: &[OutputChange]) {
        self.target = RateTarget::ZERO;
        self.switching.cancel();
        self.halt_gear();
        self.outputs.lock_safe(safe);
        self.update_status();
    }

    /// Locks the outputs at their safe values in an epoch that begins with an alarm: nothing moves, and no rate is
    /// accepted before it is cleared.
    pub(crate) fn lock_outputs(&mut self, safe: &[OutputChange]) {
        self.outputs.lock_safe(safe);
        self.update_status();
    }

    /// Unlocks the outputs after the alarm is cleared. The target stays 0.
    pub(crate) const fn release(&mut self) {
        self.outputs.release();
    }

    /// Accepts a command from the host.
    ///
    /// # Errors
    /// Returns the reason for the rejection; nothing has changed then.
    pub fn accept(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal> {
        match command {
            HostCommand::Ahead { place, record } | HostCommand::Behind { place, record, .. }
                if !self.may_hold(place, &record) =>
            {
                return Err(CommandRefusal::Unsupported);
            }
            HostCommand::Ahead { place: n, record } => {
                self.window.push_ahead(n, record, self.stopping_place_behind())?
            }
            HostCommand::Behind { place: n, record, rests } => {
                self.window.push_behind(n, record, rests, self.stopping_place())?
            }
            HostCommand::Trim { high } => self.window.trim(high, self.stopping_place())?,
            HostCommand::Forget { low } => self.window.forget(low, self.stopping_place_behind())?,
            HostCommand::Action(action) => self.accept_action(action)?,
            HostCommand::Rate(target) => self.target = target,
            HostCommand::Replay { on } => self.replay = on,
            HostCommand::Instruction(instruction) => self.store_instruction(instruction)?,
            HostCommand::ManualOutput(change) => {
                self.outputs.set_manually(change)?;
                self.cancel_start(change);
            }
            HostCommand::ClearAlarm => {}
            HostCommand::Home(_) | HostCommand::SpeedCurve(_) => return Err(CommandRefusal::Unsupported),
            HostCommand::Restart { last } => self.block_until_repeated(last),
            HostCommand::Repeat(repeated) => self.repeat_instruction(repeated)?,
            HostCommand::ArmProbe(arming) => self.arm_probe(arming)?,
            HostCommand::FollowSpindle { on } => self.follow_by_hand(on)?,
            HostCommand::FreeTool => self.free_tool()?,
            HostCommand::ArmStretch(armed) => self.arm_stretch(&armed)?,
        }
        self.update_status();
        Ok(())
    }

    fn accept_action(&mut self, action: OutputAction) -> Result<(), CommandRefusal> {
        let moves_layer = action.channel == channel::HEIGHT && self.layer.axis().is_some();
        if !(moves_layer && action.after.unsigned_abs() <= MAX_LAYER || self.outputs.has_channel(action.channel)) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        self.actions.insert(action, self.window.low(), self.window.high())
    }

    /// Stores an instruction for its place, which becomes the end of the window: so nothing can pass it, whatever
    /// records are held.
    ///
    /// The place must not be behind the furthest place ever executed, where the order is lost, and the cursor must
    /// still be able to stop there.
    fn store_instruction(&mut self, instruction: Instruction) -> Result<(), CommandRefusal> {
        self.switching.check(&instruction, &self.outputs)?;
        if instruction.place.is_before(self.status.reached) {
            return Err(CommandRefusal::OutOfOrder);
        }
        let at = Place::start_of(instruction.place);
        // Only a place in the window shortens it.
        let is_beyond = !instruction.place.is_before(self.window.high());
        let can_brake = is_beyond || self.stopping_place().distance_to(at) >= Distance::ZERO;
        let runs_into = self.status.place.distance_to(at) > Distance::ZERO && self.planned_stop_at(instruction.place);
        if !(can_brake || runs_into) {
            return Err(CommandRefusal::InMotion);
        }
        self.switching.store(instruction, &self.outputs)?;
        self.begin_due_instruction();
        Ok(())
    }

    /// Whether motion is about to begin, or a restart is between two repeated instructions.
    fn awaits_motion(&self) -> bool {
        self.unblocked_target() != Rate::ZERO || matches!(self.block, MotionBlock::Restart { begun: true, .. })
    }

    /// Returns the requested rate, the faster of feed and rapid motion; 0 while motion is blocked, and behind the touch
    /// of a probe.
    fn unblocked_target(&self) -> Rate {
        let is_free = self.block == MotionBlock::None && !self.probe.has_touched();
        if is_free { self.probing_target(self.target).faster() } else { Rate::ZERO }
    }

    fn planned_stop_at(&self, place: RecordIndex) -> bool {
        let held = !place.is_before(self.window.low()) && !self.window.high().is_before(place);
        held && self.window.rests_at(place)
    }

    /// Whether the cursor is at rest on the place of the stored instruction, and motion beyond it is requested.
    fn is_due(&self) -> bool {
        let here = self.switching.waiting_place().is_some_and(|place| self.status.place == Place::start_of(place));
        here && self.path_is_at_rest()
            && !self.taking_up_backlash
            && self.unblocked_target() > Rate::ZERO
            && !self.switching.is_busy()
    }

    /// Whether the record under the cursor is held. At the beginning of an epoch inside a record it has not arrived
    /// yet.
    fn has_record_under_cursor(&self) -> bool {
        let place = self.status.place;
        place.fraction == 0 || self.window.record(place.record).is_some()
    }

    fn begin_due_instruction(&mut self) {
        if !self.is_due() {
            return;
        }
        let (changes, moves) = self.switching.waiting_changes();
        match self.alarm_of_start(changes, moves) {
            Some(alarm) => self.start_alarm = Some(alarm),
            None => {
                self.begin_height_control(moves);
                self.switching.begin(&mut self.outputs, &mut self.layer);
            }
        }
    }

    /// Returns the furthest place ahead that the cursor is at or cannot avoid reaching.
    fn stopping_place(&self) -> Place {
        match self.followed.first().and_then(|followed| followed.gear.reach()) {
            Some(end) => Place::start_of(end),
            None => self.status.place.moved(self.drive.stopping_distance().max(Distance::ZERO)),
        }
    }

    /// Returns the furthest place behind that the cursor is at or cannot avoid reaching.
    fn stopping_place_behind(&self) -> Place {
        match self.followed.first().and_then(|followed| followed.gear.reach_behind()) {
            Some(beginning) => Place::start_of(beginning),
            None => self.status.place.moved(self.drive.stopping_distance().min(Distance::ZERO)),
        }
    }

    /// Runs one control period. While an instruction is executed the machine is at rest.
    pub fn run_period(&mut self) -> &CardStatus<A> {
        if let Some(alarm) = self.play_period(0, &[None; ANALOG_INPUTS], false) {
            self.status.alarm.get_or_insert(alarm);
        }
        &self.status
    }

    /// Runs one control period, with these inputs active. `failed` means that the machine reports the instruction as
    /// failed.
    pub(crate) fn play_period(&mut self, active: u16, analog: &AnalogInputs, failed: bool) -> Option<Alarm> {
        self.status.inputs = active;
        let instruction_begins = self.is_due();
        self.begin_due_instruction();
        let from = self.status.place;
        let waits = self.unblocked_target() != Rate::ZERO && !self.has_record_under_cursor();
        // Also for an instruction without duration: the host sends the following records only after it is reported as
        // executed.
        let stays = instruction_begins || self.switching.is_busy() || self.layer_holds_path();
        let wanted = if stays || waits { Rate::ZERO } else { self.unblocked_target() };
        // The path comes to rest, and cutting outputs are switched off, before it runs backward.
        let turns = wanted < Rate::ZERO && self.permit.is_lit_forward_only(self.outputs.values());
        let (keeps, is_pulse) = (self.switching.keeps_cutter(), self.switching.is_pulse());
        let ran = !self.path_is_at_rest();
        let mut alarm = self.start_alarm.take();
        self.run_layer(active, analog);
        let spindle = self.followed.first_mut();
        match self.switching.run_period(active, failed, &mut self.outputs, &mut self.layer, spindle) {
            Some(InstructionFault::Alarm(fault)) => alarm = Some(fault),
            Some(InstructionFault::NotStarted) => self.block_start(CutterOffCause::NotStarted, from),
            Some(InstructionFault::NoSheet(SheetFault::NoSheet)) => self.block_start(CutterOffCause::NoSheet, from),
            Some(InstructionFault::NoSheet(SheetFault::Contact)) => {
                self.block_start(CutterOffCause::SheetContact, from)
            }
            None => {}
        }
        self.release_block();
        let step = match self.run_gear(from, if turns { 0 } else { wanted.signum() }) {
            Some((step, fault)) => {
                alarm = alarm.or(fault);
                step
            }
            None => {
                let target = self.requested_target(from);
                self.step_drive(from, if turns || wanted == Rate::ZERO { None } else { Some(target) })
            }
        };
        // The drive never leaves the window, so the records are held; if one were missing, the card would stop.
        let (to, increments) = match emission(from, step.to, |n| self.window.record(n)) {
            // at most eight records per period, so they fit 32 bits by far
            Some(increments) => (step.to, increments.map(|pulses| pulses as i32)),
            None if step.to == from => (from, [0; A]),
            None => {
                alarm = Some(Alarm::Defect);
                (from, [0; A])
            }
        };
        self.feed_share = if self.permit.beam_power().is_some() || self.controls_height() {
            feed_share_between(from, to, |n| self.window.record(n)).unwrap_or(0)
        } else {
            0
        };
        self.apply_actions(from, to);
        self.commit_period(to, increments, step.starved || waits);
        let rate = self.status.rate;
        let backward = rate < Rate::ZERO || rate == Rate::ZERO && wanted < Rate::ZERO;
        self.conditions = PermitConditions {
            backward,
            moving: ran || rate != Rate::ZERO,
            awaits_motion: self.awaits_motion(),
            keeps_cutter: keeps,
            is_unwatched: is_pulse || self.outputs.values()[usize::from(channel::UNWATCHED)] != 0,
            denied: None,
            inputs: active,
            place: from,
        };
        alarm
    }

    /// Runs a period in which the axes move off the path, homing; `going` means that they also do so in the next one.
    pub(crate) fn move_off_path(&mut self, increments: [i32; A], going: bool) {
        self.off_path = going;
        self.feed_share = 0;
        self.commit_period(self.status.place, increments, false);
        self.conditions = PermitConditions { place: self.status.place, ..PermitConditions::default() };
    }

    /// Sets whether backlash is being taken up.
    pub(crate) fn set_taking_up_backlash(&mut self, turning: bool) {
        self.taking_up_backlash = turning;
        self.status.at_rest = self.has_stopped();
    }

    /// Whether the axes are at rest.
    fn has_stopped(&self) -> bool {
        self.path_is_at_rest() && self.layer.at_rest() && !self.off_path && !self.taking_up_backlash
    }

    /// Prepares motion off the path.
    pub(crate) fn leave_path(&mut self) {
        self.off_path = true;
        self.update_status();
    }

    /// Sets the count of an axis at its current position.
    pub(crate) fn set_count(&mut self, axis: usize, count: i64) {
        if let Some(own) = self.status.counts.get_mut(axis) {
            *own = count;
        }
    }

    fn commit_period(&mut self, to: Place, increments: [i32; A], starved: bool) {
        let status = &mut self.status;
        status.period += 1;
        status.rate = status.place.distance_to(to).per_period();
        status.place = to;
        status.starved = starved;
        status.increments = increments;
        for (count, &increment) in status.counts.iter_mut().zip(&increments) {
            *count += i64::from(increment);
        }
        let under = if status.rate < Rate::ZERO { to.record } else { to.boundary_ahead() - 1 };
        if let Some(record) = self.window.record(under) {
            status.line = record.line;
        }
        let boundary = to.boundary_ahead();
        if status.reached.is_before(boundary) {
            status.reached = boundary;
        }
        self.update_status();
    }

    /// Executes the output actions between two places: always if they are passed for the first time, else only if they
    /// are replayed.
    fn apply_actions(&mut self, from: Place, to: Place) {
        let reached = self.status.reached;
        if from.distance_to(to) > Distance::ZERO {
            for action in self.actions.passed_forward(from, to) {
                let first_time = !action.place.is_before(reached);
                let lights = action.after != 0 && self.permit.fires(action.channel);
                if action.channel == channel::HEIGHT {
                    if first_time && self.permit.is_lit(self.outputs.values()) {
                        self.layer.begin_beside(action.after);
                    }
                } else if first_time && lights && self.block == MotionBlock::CutterOff {
                    // The machine brakes without its cutter: the restart lights it.
                } else if first_time {
                    self.outputs.set(OutputChange { channel: action.channel, value: action.after });
                } else if self.replay {
                    replay_change(
                        &self.permit,
                        &mut self.outputs,
                        OutputChange { channel: action.channel, value: action.after },
                    );
                }
            }
        } else if self.replay {
            for action in self.actions.passed_backward(from, to) {
                replay_change(
                    &self.permit,
                    &mut self.outputs,
                    OutputChange { channel: action.channel, value: action.before },
                );
            }
        }
    }

    fn update_status(&mut self) {
        let (at_rest, beam_power, spindle) = (self.has_stopped(), self.beam_power(), self.spindle_status());
        let status = &mut self.status;
        status.at_rest = at_rest;
        status.low = self.window.low();
        status.high = self.window.high();
        status.executed = self.switching.executed();
        status.repeated = self.switching.repeated();
        status.blocked = self.block != MotionBlock::None;
        status.outputs = *self.outputs.values();
        status.beam_power = beam_power;
        status.layer = self.layer.layer();
        for (state, control) in status.height.iter_mut().zip(&self.height) {
            *state = control.state();
        }
        status.spindle = spindle;
    }
}

/// Replays an action that is passed again: it switches a cutting output off, and switches it on only if that may be on
/// in reverse.
fn replay_change(permit: &CutterPermit, outputs: &mut OutputBank, change: OutputChange) {
    if change.value == 0 || !permit.is_forward_only(change.channel) {
        outputs.set(change);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use retrace_core::Flags;
    use retrace_core::limits::PulseLimits;
    use retrace_link::RepeatedInstruction;
    use retrace_link::{Instruction, OutputAction};

    fn player() -> Player<1, 64, 32> {
        let axis = PulseLimits { velocity: 30 << 32, acceleration: 8 << 32, jerk: 1 << 32 };
        Player::new(RecordIndex::new(0), RateLimits::new(13, 1 << 15, [axis]).expect("valid")).expect("fits")
    }

    fn fill(player: &mut Player<1, 64, 32>, records: impl IntoIterator<Item = (i16, Flags)>) {
        for (increment, flags) in records {
            let place = player.status().high;
            let record = Record { increments: [increment], flags, line: place.number() + 1, ..Record::default() };
            player.accept(HostCommand::Ahead { place, record }).expect("room");
        }
    }

    #[test]
    fn runs_to_the_planned_stop_in_as_many_periods_as_there_are_records() {
        let mut player = player();
        fill(&mut player, (1..=20).map(|n| (n, if n == 20 { Flags::REST } else { Flags::NONE })));
        player.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        for n in 1..=20u32 {
            let status = player.run_period();
            assert_eq!((status.increments[0], status.line), (n as i32, n));
        }
        assert!(player.status().at_rest);
        assert_eq!(player.status().counts, [210]);
        player.accept(HostCommand::rate(-Rate::ONE)).expect("a rate");
        for _ in 0..20 {
            player.run_period();
        }
        assert_eq!(
            (player.status().counts, player.status().place, player.status().reached),
            ([0], Place::start_of(RecordIndex::new(0)), RecordIndex::new(20))
        );
    }

    #[test]
    fn an_instruction_waits_for_the_motion_and_holds_it() {
        let mut player = player();
        fill(&mut player, [(5, Flags::NONE), (5, Flags::REST), (5, Flags::REST)]);
        player.accept(HostCommand::rate(Rate::ONE / 2)).expect("a rate");
        player.run_period();
        let instruction = Instruction { number: 1, place: RecordIndex::new(2), periods: 3, ..Instruction::default() };
        // kept while the motion is under way (it was refused then, before instructions carried their place), and the
        // road ends there
        player.accept(HostCommand::Instruction(instruction)).expect("a planned stop");
        while !player.run_period().at_rest {}
        assert_eq!((player.status().place, player.status().executed), (Place::start_of(RecordIndex::new(2)), 0));
        for done in [0, 0, 1] {
            let status = player.run_period();
            assert_eq!((status.executed, status.increments), (done, [0]));
        }
        assert_eq!(player.run_period().rate, Rate::ONE / 2);
    }

    #[test]
    fn an_instruction_that_cannot_be_executed_in_order_is_refused() {
        let mut player = player();
        fill(&mut player, (0..60).map(|n| (5, if n == 55 { Flags::REST } else { Flags::NONE })));
        player.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        for _ in 0..10 {
            player.run_period();
        }
        let at = |place| HostCommand::Instruction(Instruction { number: 1, place, ..Instruction::default() });
        assert_eq!(player.accept(at(RecordIndex::new(9))), Err(CommandRefusal::OutOfOrder));
        // some records are needed to stop, but for a planned stop
        let nearest =
            (10..55).find(|&place| player.accept(at(RecordIndex::new(place))).is_ok()).expect("there is room");
        assert!((16..40).contains(&nearest), "{nearest}");
        assert_eq!(player.accept(at(RecordIndex::new(nearest + 1))), Err(CommandRefusal::Busy));
        player.accept(HostCommand::rate(-Rate::ONE)).expect("a rate");
        for _ in 0..90 {
            player.run_period();
        }
        assert_eq!((player.status().place, player.status().executed), (Place::start_of(RecordIndex::new(0)), 0));
        player.accept(HostCommand::rate(Rate::ZERO)).expect("a rate");
        player.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        let mut executed_at = None;
        while player.status().executed == 0 {
            let status = player.run_period();
            executed_at = Some(status.place);
            assert!(
                Place::start_of(RecordIndex::new(nearest)).distance_to(status.place) <= Distance::ZERO
                    || status.executed == 1
            );
        }
        assert!(
            executed_at
                .is_some_and(|place| Place::start_of(RecordIndex::new(nearest)).distance_to(place) <= Distance::RECORD)
        );
    }

    #[test]
    fn a_hold_defers_an_instruction_that_has_come_to_its_place() {
        let mut player = player();
        let instruction = Instruction { number: 1, ..Instruction::default() };
        player.accept(HostCommand::Instruction(instruction)).expect("at its place");
        for _ in 0..5 {
            assert_eq!(player.run_period().executed, 0);
        }
        player.accept(HostCommand::rate(-Rate::ONE)).expect("a rate");
        assert_eq!(player.run_period().executed, 0);
        player.accept(HostCommand::rate(Rate::from_units(1))).expect("a rate");
        let status = player.run_period();
        assert_eq!((status.executed, status.starved), (1, false), "what follows is not late, it is not due yet");
        let second = Instruction { number: 2, ..Instruction::default() };
        player.accept(HostCommand::Instruction(second)).expect("at its place");
        assert_eq!(player.status().executed, 2, "where it may begin at once it does");
    }

    #[test]
    fn a_record_ahead_replaces_none_that_a_run_backward_needs_to_stop() {
        let axis = PulseLimits { velocity: 40 << 32, acceleration: 1 << 32, jerk: 1 << 32 };
        let limits = RateLimits::new(1, 64, [axis]).expect("valid");
        let mut player = Player::<1, 64, 1>::new(RecordIndex::new(0), limits).expect("fits");
        let record = Record { increments: [40], ..Record::default() };
        for n in 1..=60 {
            let place = RecordIndex::new(0) - n;
            player.accept(HostCommand::Behind { place, record, rests: false }).expect("room");
        }
        player.accept(HostCommand::rate(-Rate::ONE)).expect("a rate");
        while player.run_period().rate > -Rate::ONE {}
        // a stop needs more than twenty records, and a quarter of the window is sixteen
        let mut high = player.status().high;
        while player.accept(HostCommand::Ahead { place: high, record }).is_ok() {
            high += 1;
        }
        let mut rate = player.status().rate;
        while !player.run_period().at_rest {
            let change = player.status().rate - rate;
            assert!(change.units().abs() * 40 <= 1 << 32, "{change:?}");
            rate = player.status().rate;
        }
        assert_eq!(player.status().place, Place::start_of(player.status().low));
    }

    #[test]
    fn a_restart_blocks_motion_until_its_last_repeat_is_complete() {
        let mut player = player();
        fill(&mut player, (0..40).map(|n| (4, if n == 39 { Flags::REST } else { Flags::NONE })));
        player.accept(HostCommand::rate(Rate::ONE * 5 / 9)).expect("a rate");
        for _ in 0..20 {
            player.run_period();
        }
        player.accept(HostCommand::Restart { last: 2 }).expect("any time");
        let repeat = |number, periods| RepeatedInstruction {
            number,
            periods,
            changes: [OutputChange { channel: 3, value: number as i32 }; 4],
            count: 1,
            ..RepeatedInstruction::default()
        };
        assert_eq!(player.accept(HostCommand::Repeat(repeat(1, 3))), Err(CommandRefusal::InMotion));
        while !player.run_period().at_rest {}
        let place = player.status().place;
        assert!(place.fraction != 0 && player.status().blocked);
        assert_eq!(player.accept(HostCommand::Repeat(repeat(2, 3))), Err(CommandRefusal::Busy), "out of its order");
        player.accept(HostCommand::Repeat(repeat(1, 3))).expect("at rest");
        for repeated in [0, 0, 1, 1] {
            let status = player.run_period();
            assert_eq!((status.repeated, status.place, status.outputs[3]), (repeated, place, 1));
        }
        player.accept(HostCommand::Repeat(repeat(2, 0))).expect("at rest");
        assert_eq!((player.status().repeated, player.status().blocked), (2, false));
        assert!(player.run_period().place != place);
        player.accept(HostCommand::Restart { last: 2 }).expect("any time");
        assert!(!player.status().blocked, "it is complete already");
    }

    #[test]
    fn actions_fire_once_and_are_replayed_only_where_wanted() {
        let mut player = player();
        let action = OutputAction { place: RecordIndex::new(2), channel: 3, before: 0, after: 1 };
        player.accept(HostCommand::Action(action)).expect("room");
        assert_eq!(
            player.accept(HostCommand::Action(OutputAction { channel: 200, ..action })),
            Err(CommandRefusal::NoSuchChannel)
        );
        fill(&mut player, (0..4).map(|n| (1, if n == 3 { Flags::REST } else { Flags::NONE })));
        player.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        let outputs = |p: &mut Player<1, 64, 32>| -> Vec<i32> { (0..4).map(|_| p.run_period().outputs[3]).collect() };
        assert_eq!(outputs(&mut player), [0, 0, 1, 1]);
        player.accept(HostCommand::rate(-Rate::ONE)).expect("a rate");
        assert_eq!(outputs(&mut player), [1, 1, 1, 1]);
        player.accept(HostCommand::ManualOutput(OutputChange { channel: 3, value: 0 })).expect("a channel");
        player.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        assert_eq!(outputs(&mut player), [0, 0, 0, 0]);
        player.accept(HostCommand::Replay { on: true }).expect("a switch");
        player.accept(HostCommand::ManualOutput(OutputChange { channel: 3, value: 1 })).expect("a channel");
        player.accept(HostCommand::rate(-Rate::ONE)).expect("a rate");
        assert_eq!(outputs(&mut player), [1, 0, 0, 0]);
        player.accept(HostCommand::rate(Rate::ONE)).expect("a rate");
        assert_eq!(outputs(&mut player), [0, 0, 1, 1]);
    }

    proptest! {
        /// Any rates, any sliding of the window: the counts are the sum of the records before the place, always.
        #[test]
        fn counts_are_a_function_of_the_place(
            increments in prop::collection::vec(-30i16..30, 300),
            commands in prop::collection::vec((-2i64 << 32..2 << 32, 1u32..60), 1..40),
        ) {
            let mut player = player();
            let mut sums = vec![0i64];
            for &i in &increments { sums.push(sums[sums.len() - 1] + i64::from(i)); }
            for (target, periods) in commands {
                player.accept(HostCommand::rate(Rate::from_units(target))).expect("a rate");
                for _ in 0..periods {
                    let status = *player.status();
                    let record = |n: u32| Record { increments: [increments[n as usize]], ..Record::default() };
                    if target > 0 && (status.high.number() as usize) < increments.len() {
                        let _ = player.accept(HostCommand::Ahead { place: status.high,
                            record: record(status.high.number()) });
                    } else if target < 0 && status.low.number() > 0 {
                        let place = status.low - 1;
                        let _ = player.accept(HostCommand::Behind { place, record: record(place.number()),
                            rests: place == RecordIndex::new(0) });
                    }
                    player.run_period();
                    let status = player.status();
                    let n = status.place.record.number() as usize;
                    let under = increments.get(n).map_or(0,
                        |&i| retrace_core::playback::partial_increment(i, status.place.fraction));
                    prop_assert_eq!(status.counts[0], sums[n] + i64::from(under));
                }
            }
        }
    }
}
