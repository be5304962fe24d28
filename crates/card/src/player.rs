//! The player: window, drive, pulses and switching put together; one call a control period.
//!
//! Invariant: `counts` is `P(place)` at all times, P being the sum of the records before a place (core, `playback`), on top of what
//! they were where the epoch began. The cursor never passes the place of an instruction that is not executed.

use retrace_core::drive::{Drive, RecordWindow};
use retrace_core::limits::RateLimits;
use retrace_core::place::is_before;
use retrace_core::playback::emission;
use retrace_core::{Place, RapidCap, RateTarget, Record, Travel};
use retrace_link::{
    Alarm, CardStatus, CommandRefusal, CutterOffCause, CuttingSettings, HostCommand, Instruction, OutputAction,
    OutputChange, Outputs, PathStart, RepeatedInstruction, channel,
};

use crate::permit::PermitConditions;
use crate::window::RecordStorage;
use crate::{ActionTable, CardWindow, CutterPermit, InstructionExecutor, OutputBank};

/// Most output actions that a card holds at a time.
const ACTIONS: usize = 256;

/// What keeps the motion from starting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum MotionBlock {
    None,
    /// A restart, until the repeated instruction of this number is complete.
    Restart {
        last: u32,
        /// One of its repeated instructions was taken.
        begun: bool,
    },
    /// The grace ran out with a cutting output on, until a restart.
    Standing,
}

/// A card's player for `A` axes, a window of `W` records, and an average of the rate law of up to `M` periods.
///
/// It plays what it is given and switches where it is told to. Alarms, inputs, homing and the watchdog are the [`crate::Card`]'s around it.
#[derive(Clone, Debug)]
pub struct Player<const A: usize, const W: usize, const M: usize, S = [Record<A>; W]> {
    window: CardWindow<A, W, S>,
    drive: Drive<A, M>,
    actions: ActionTable<ACTIONS>,
    switching: InstructionExecutor,
    outputs: OutputBank,
    target: RateTarget,
    replay: bool,
    /// The axes move beside the path: homing.
    off_path: bool,
    /// Play is being taken up: what is driven stands only when that is done.
    taking_up_backlash: bool,
    /// Motion is blocked until a restart is complete.
    block: MotionBlock,
    permit: CutterPermit,
    /// What the last period was like, as far as the player knows.
    conditions: PermitConditions,
    status: CardStatus<A>,
}

impl<const A: usize, const W: usize, const M: usize> Player<A, W, M> {
    /// A card at rest at record `start`, all counts and outputs zero, with all output channels. `None` where the rate law's average is
    /// longer than the card's memory, or the machine brakes too slowly.
    #[must_use]
    pub fn new(start: u32, limits: RateLimits<A>) -> Option<Self> {
        let drive = Drive::new(limits)?;
        Some(Self { drive, ..Self::idle(start, channel::DIGITAL as u8)? })
    }

    /// The same with so many digital outputs, and no rate law yet: nothing is to be played on it.
    pub(crate) const fn idle(start: u32, digital: u8) -> Option<Self> {
        // no `?` in a constant
        let Some(drive) = Drive::unconfigured() else { return None };
        Some(Self::with_window(CardWindow::new(start), drive, start, digital))
    }
}

impl<const A: usize, const W: usize, const M: usize> Player<A, W, M, &'static mut [Record<A>]> {
    /// The same, whose records are to be lent.
    pub(crate) const fn idle_without_records(digital: u8) -> Option<Self> {
        let Some(drive) = Drive::unconfigured() else { return None };
        Some(Self::with_window(CardWindow::with_records(0, &mut []), drive, 0, digital))
    }

    /// Where the records are to stand: `W` of them.
    pub(crate) fn lend(&mut self, records: &'static mut [Record<A>]) {
        self.window.lend(records);
    }
}

impl<const A: usize, const W: usize, const M: usize, S> Player<A, W, M, S> {
    const fn with_window(window: CardWindow<A, W, S>, drive: Drive<A, M>, start: u32, digital: u8) -> Self {
        Self {
            window,
            drive,
            actions: ActionTable::new(),
            switching: InstructionExecutor::new(),
            outputs: OutputBank::new(digital),
            target: RateTarget::ZERO,
            replay: false,
            off_path: false,
            taking_up_backlash: false,
            block: MotionBlock::None,
            permit: CutterPermit::new(),
            conditions: PermitConditions { denied: None, backward: false, moving: false, awaits: false, keeps: false },
            status: CardStatus::at_rest(PathStart::at(start)),
        }
    }
}

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Player<A, W, M, S> {
    /// Begins an epoch: nothing on the window, which begins with the record of `start`; counts and outputs stay as they are, but for
    /// cutting outputs, which are switched off. An
    /// instruction in hand is given up, also one that is being executed: so a host may end one that waits for ever.
    ///
    /// # Errors
    /// [`Refusal::InMotion`] where the motion does not stand, [`Refusal::Unfit`] where the start is none or the rate law does not fit;
    /// nothing has changed then.
    pub(crate) fn reopen(
        &mut self,
        start: PathStart,
        limits: RateLimits<A>,
        cutting: &CuttingSettings,
    ) -> Result<(), CommandRefusal> {
        if !self.status.at_rest {
            return Err(CommandRefusal::InMotion);
        }
        if !start.is_valid() {
            return Err(CommandRefusal::Unfit);
        }
        self.drive = Drive::new(limits).ok_or(CommandRefusal::Unfit)?;
        self.window.restart(start.place.record, start.rests);
        self.actions.clear();
        self.permit.open(cutting, self.outputs.values_mut());
        self.switching.restart(start.executed);
        (self.target, self.replay, self.block) = (RateTarget::ZERO, false, MotionBlock::None);
        let status = &mut self.status;
        (status.place, status.reached) = (start.place, start.reached);
        (status.rate, status.starved, status.line) = (0, false, 0);
        status.increments = [0; A];
        self.mirror();
        Ok(())
    }

    /// The axes stand at these counts, and the outputs have these values.
    pub(crate) fn stand_at(&mut self, counts: [i64; A], outputs: &Outputs) {
        self.status.counts = counts;
        for (channel, &value) in (0u8..).zip(outputs) {
            self.outputs.set(OutputChange { channel, value });
        }
        self.put_out(CutterOffCause::EpochOpened);
    }

    /// Switches the cutting outputs off.
    pub(crate) fn put_out(&mut self, cause: CutterOffCause) {
        self.permit.put_out(self.outputs.values_mut(), cause);
        self.mirror();
    }

    /// Switches off every cutting output whose permit is missing, at the end of a period. `denied`: why none may be on whatever the
    /// path does.
    pub(crate) fn apply_permit(&mut self, denied: Option<CutterOffCause>) {
        let conditions = PermitConditions { denied, ..self.conditions };
        let outcome = self.permit.period(self.outputs.values_mut(), &conditions);
        self.status.cutter_off = outcome.off;
        if outcome.blocks {
            self.block = MotionBlock::Standing;
        }
        self.mirror();
    }

    /// Is a cutting output on?
    pub(crate) fn is_lit(&self) -> bool {
        self.permit.is_lit(self.outputs.values())
    }

    /// The last period's report.
    #[must_use]
    pub const fn status(&self) -> &CardStatus<A> {
        &self.status
    }

    /// What the card around the player has to say in the report.
    pub(crate) const fn report(&mut self) -> &mut CardStatus<A> {
        &mut self.status
    }

    /// Does the motion stand, and is no instruction being executed?
    pub(crate) fn is_at_rest(&self) -> bool {
        self.drive.at_rest() && !self.taking_up_backlash && !self.switching.busy()
    }

    /// Would the next period move the machine or begin an instruction, or go on with either?
    pub(crate) fn is_about_to_act(&self) -> bool {
        let (place, road) = (self.status.place, self.record_window());
        let way = match self.unblocked_target().signum() {
            0 => 0,
            _ if !self.has_record_under_cursor() => 0,
            1 => place.distance_to(Place::start_of(road.high())),
            _ => Place::start_of(road.low()).distance_to(place),
        };
        !self.is_at_rest() || way > 0 || self.is_due()
    }

    /// Is nothing on the window and nothing in hand?
    pub(crate) fn is_empty(&self) -> bool {
        self.window.low() == self.window.high() && self.switching.waits_for_place().is_none() && self.is_at_rest()
    }

    /// An alarm: brakes on the path, gives up the instruction in hand, makes the outputs safe and keeps them so.
    pub(crate) fn halt(&mut self, safe: &[OutputChange]) {
        self.target = RateTarget::ZERO;
        self.switching.cancel();
        self.outputs.keep_safe(safe);
        self.mirror();
    }

    /// The alarm is cleared. The target stays 0.
    pub(crate) const fn release(&mut self) {
        self.outputs.release();
    }

    /// Takes a word from the host.
    ///
    /// # Errors
    /// A [`Refusal`]; nothing has changed then.
    pub fn accept(&mut self, word: HostCommand<A>) -> Result<(), CommandRefusal> {
        let place = self.status.place;
        match word {
            HostCommand::Ahead { place: n, record } => self.window.push_ahead(n, record, place)?,
            HostCommand::Behind { place: n, record, rests } => {
                self.window.push_behind(n, record, rests, self.bound())?
            }
            HostCommand::Trim { high } => self.window.trim(high, self.bound())?,
            HostCommand::Forget { low } => self.window.forget(low, self.bound_behind())?,
            HostCommand::Action(action) => self.accept_action(action)?,
            HostCommand::Rate(target) => self.target = target,
            HostCommand::Replay { on } => self.replay = on,
            HostCommand::Instruction(instruction) => self.store_instruction(instruction)?,
            HostCommand::ManualOutput(change) => self.outputs.set_by_hand(change)?,
            HostCommand::ClearAlarm => {}
            HostCommand::Home(_) => return Err(CommandRefusal::Unfit),
            HostCommand::Restart { last } => self.restart(last),
            HostCommand::Repeat(repeated) => self.repeat(repeated)?,
        }
        self.mirror();
        Ok(())
    }

    fn accept_action(&mut self, action: OutputAction) -> Result<(), CommandRefusal> {
        if !self.outputs.has(action.channel) {
            return Err(CommandRefusal::NoSuchChannel);
        }
        self.actions.insert(action, self.window.low(), self.window.high())
    }

    /// Keeps an instruction for its place, which becomes the end of the road: so nothing can pass it, whatever records there are.
    ///
    /// It must not lie behind the furthest place ever executed, where its order is lost, and the cursor must still be able to stop there.
    fn store_instruction(&mut self, instruction: Instruction) -> Result<(), CommandRefusal> {
        self.switching.check(&instruction, &self.outputs)?;
        if is_before(instruction.place, self.status.reached) {
            return Err(CommandRefusal::OutOfOrder);
        }
        let at = Place::start_of(instruction.place);
        // Only a place on the window makes the road shorter than it is.
        let is_beyond = !is_before(instruction.place, self.window.high());
        let can_brake = is_beyond || self.bound().distance_to(at) >= 0;
        let runs_into = self.status.place.distance_to(at) > 0 && self.planned_stop_at(instruction.place);
        if !(can_brake || runs_into) {
            return Err(CommandRefusal::InMotion);
        }
        self.switching.store(instruction, &self.outputs)?;
        self.begin_due_instruction();
        Ok(())
    }

    /// May this change be made by hand? A cutting output is not lit where it would be put out at once.
    pub(crate) fn may_switch(&self, change: OutputChange, denied: Option<CutterOffCause>) -> bool {
        let status = &self.status;
        let now = PermitConditions {
            denied,
            backward: status.rate < 0 || status.at_rest && self.unblocked_target() < 0,
            moving: !status.at_rest,
            awaits: self.awaits(),
            keeps: self.switching.keeps_cutter(),
        };
        change.value == 0 || self.permit.may_light(change.channel, &now)
    }

    /// Blocks motion until the repeated instruction `last` is complete; releases the block where it is complete already.
    fn restart(&mut self, last: u32) {
        self.block = MotionBlock::Restart { last, begun: false };
        self.release_block();
    }

    /// Executes switching again, where the machine stands.
    fn repeat(&mut self, repeated: RepeatedInstruction) -> Result<(), CommandRefusal> {
        if !self.has_stopped() {
            return Err(CommandRefusal::InMotion);
        }
        self.switching.repeat(repeated, &mut self.outputs)?;
        if let MotionBlock::Restart { begun, .. } = &mut self.block {
            *begun = true;
        }
        self.release_block();
        Ok(())
    }

    /// Releases the block where its last repeated instruction is complete.
    fn release_block(&mut self) {
        if let MotionBlock::Restart { last, .. } = self.block
            && last.wrapping_sub(self.switching.repeated()) as i32 <= 0
        {
            self.block = MotionBlock::None;
        }
    }

    /// Is motion about to begin, or is a restart between two repeated instructions?
    fn awaits(&self) -> bool {
        self.unblocked_target() != 0 || matches!(self.block, MotionBlock::Restart { begun: true, .. })
    }

    /// The rate asked for, of feed and rapid motion the faster, as far as the block lets it pass.
    fn unblocked_target(&self) -> Travel {
        if self.block == MotionBlock::None { self.target.faster() } else { 0 }
    }

    fn planned_stop_at(&self, place: u32) -> bool {
        let held = !is_before(place, self.window.low()) && !is_before(self.window.high(), place);
        held && self.window.rests_at(place)
    }

    /// Is the cursor at rest on the place of the kept instruction, and wants to go on?
    fn is_due(&self) -> bool {
        let here = self.switching.waits_for_place().is_some_and(|place| self.status.place == Place::start_of(place));
        here && self.drive.at_rest()
            && !self.taking_up_backlash
            && self.unblocked_target() > 0
            && !self.switching.busy()
    }

    /// Is the record there that the cursor stands in? At the beginning of an epoch inside of a record it is not at first.
    fn has_record_under_cursor(&self) -> bool {
        let place = self.status.place;
        place.fraction == 0 || self.window.record(place.record).is_some()
    }

    fn begin_due_instruction(&mut self) {
        if self.is_due() {
            self.switching.begin(&mut self.outputs);
        }
    }

    /// The furthest place ahead that the cursor stands at or is bound to run to.
    fn bound(&self) -> Place {
        self.status.place.moved(self.drive.stopping_distance().max(0))
    }

    /// The furthest place behind that the cursor stands at or is bound to run to.
    fn bound_behind(&self) -> Place {
        self.status.place.moved(self.drive.stopping_distance().min(0))
    }

    fn record_window(&self) -> PlayedWindow<'_, CardWindow<A, W, S>> {
        PlayedWindow::new(&self.window, self.switching.barrier())
    }

    /// Lets one control period pass. While an instruction is executed the motion stands.
    pub fn period(&mut self) -> &CardStatus<A> {
        if let Some(alarm) = self.play(0, false) {
            self.status.alarm.get_or_insert(alarm);
        }
        &self.status
    }

    /// Lets one control period pass, with these inputs active; `failed`: the machine says that the instruction has failed.
    pub(crate) fn play(&mut self, active: u16, failed: bool) -> Option<Alarm> {
        let begins = self.is_due();
        self.begin_due_instruction();
        let from = self.status.place;
        let waits = self.unblocked_target() != 0 && !self.has_record_under_cursor();
        // Also where it takes no time: the host sends what follows only when it has heard that it is executed.
        let wanted = if begins || self.switching.busy() || waits { 0 } else { self.unblocked_target() };
        // The path comes to rest, and cutting outputs go off, before it runs backward.
        let turns = wanted < 0 && self.permit.is_lit_forward_only(self.outputs.values());
        let keeps = self.switching.keeps_cutter();
        let ran = !self.drive.at_rest();
        let mut alarm = self.switching.period(active, failed);
        self.release_block();
        let road = PlayedWindow::new(&self.window, self.switching.barrier());
        let target = if turns || wanted == 0 { 0 } else { self.drive.within_overrides(from, self.target, &road) };
        let step = self.drive.step(from, target, &road);
        // The drive never leaves the window, so the records are there; were one missing, the card would stand still.
        let (to, increments) = match emission(from, step.to, |n| self.window.record(n)) {
            // at most eight records a period, so they fit 32 bits by far
            Some(increments) => (step.to, increments.map(|pulses| pulses as i32)),
            None if step.to == from => (from, [0; A]),
            None => {
                alarm = Some(Alarm::Defect);
                (from, [0; A])
            }
        };
        self.switch_in_passing(from, to);
        self.commit_period(to, increments, step.starved || waits);
        let rate = self.status.rate;
        let backward = rate < 0 || rate == 0 && wanted < 0;
        self.conditions =
            PermitConditions { backward, moving: ran || rate != 0, awaits: self.awaits(), keeps, denied: None };
        alarm
    }

    /// A period in which the axes move beside the path, homing; `going`: they do so in the next one too.
    pub(crate) fn move_off_path(&mut self, increments: [i32; A], going: bool) {
        self.off_path = going;
        self.commit_period(self.status.place, increments, false);
        self.conditions = PermitConditions::default();
    }

    /// Is play being taken up?
    pub(crate) fn take_up_backlash(&mut self, turning: bool) {
        self.taking_up_backlash = turning;
        self.status.at_rest = self.has_stopped();
    }

    /// Do the axes stand?
    fn has_stopped(&self) -> bool {
        self.drive.at_rest() && !self.off_path && !self.taking_up_backlash
    }

    /// The axes are about to move beside the path.
    pub(crate) fn leave_path(&mut self) {
        self.off_path = true;
        self.mirror();
    }

    /// An axis stands at this count from now on.
    pub(crate) fn set_count(&mut self, axis: usize, count: i64) {
        if let Some(own) = self.status.counts.get_mut(axis) {
            *own = count;
        }
    }

    fn commit_period(&mut self, to: Place, increments: [i32; A], short: bool) {
        let status = &mut self.status;
        status.period += 1;
        status.rate = status.place.distance_to(to);
        status.place = to;
        status.starved = short;
        status.increments = increments;
        for (count, &increment) in status.counts.iter_mut().zip(&increments) {
            *count += i64::from(increment);
        }
        let under = if status.rate < 0 { to.record } else { to.boundary_ahead().wrapping_sub(1) };
        if let Some(record) = self.window.record(under) {
            status.line = record.line;
        }
        let boundary = to.boundary_ahead();
        if is_before(status.reached, boundary) {
            status.reached = boundary;
        }
        self.mirror();
    }

    /// Output actions between two places: always where they are passed for the first time, else where they are replayed.
    fn switch_in_passing(&mut self, from: Place, to: Place) {
        let reached = self.status.reached;
        if from.distance_to(to) > 0 {
            for action in self.actions.left_forward(from, to) {
                let first_time = !is_before(action.place, reached);
                if first_time {
                    self.outputs.set(OutputChange { channel: action.channel, value: action.after });
                } else if self.replay {
                    replay(
                        &self.permit,
                        &mut self.outputs,
                        OutputChange { channel: action.channel, value: action.after },
                    );
                }
            }
        } else if self.replay {
            for action in self.actions.undone_backward(from, to) {
                replay(&self.permit, &mut self.outputs, OutputChange { channel: action.channel, value: action.before });
            }
        }
    }

    fn mirror(&mut self) {
        let at_rest = self.has_stopped();
        let status = &mut self.status;
        status.at_rest = at_rest;
        status.low = self.window.low();
        status.high = self.window.high();
        status.executed = self.switching.executed();
        status.repeated = self.switching.repeated();
        status.blocked = self.block != MotionBlock::None;
        status.outputs = *self.outputs.values();
    }
}

/// An action that is passed again: it puts a cutting output out, and lights it only where that may be on in reverse.
fn replay(permit: &CutterPermit, outputs: &mut OutputBank, change: OutputChange) {
    if change.value == 0 || !permit.is_forward_only(change.channel) {
        outputs.set(change);
    }
}

/// A road that ends at a place, where the one below is longer.
struct PlayedWindow<'w, R> {
    road: &'w R,
    high: u32,
}

impl<'w, R> PlayedWindow<'w, R> {
    fn new<const A: usize>(road: &'w R, end: Option<u32>) -> Self
    where
        R: RecordWindow<A>,
    {
        let high = end.filter(|&end| is_before(end, road.high())).unwrap_or(road.high());
        Self { road, high }
    }
}

impl<const A: usize, R: RecordWindow<A>> RecordWindow<A> for PlayedWindow<'_, R> {
    fn low(&self) -> u32 {
        self.road.low()
    }

    fn high(&self) -> u32 {
        self.high
    }

    fn rests_at(&self, place: u32) -> bool {
        self.road.rests_at(place)
    }

    fn cap(&self, place: u32) -> RapidCap {
        self.road.cap(place)
    }

    fn increments(&self, place: u32) -> [i16; A] {
        self.road.increments(place)
    }

    fn is_rapid(&self, place: u32) -> bool {
        self.road.is_rapid(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use retrace_core::limits::PulseLimits;
    use retrace_core::{Flags, ONE};
    use retrace_link::{Instruction, OutputAction};

    fn player() -> Player<1, 64, 32> {
        let axis = PulseLimits { velocity: 30 << 32, acceleration: 8 << 32, jerk: 1 << 32 };
        Player::new(0, RateLimits::new(13, 1 << 15, [axis]).expect("valid")).expect("fits")
    }

    fn fill(player: &mut Player<1, 64, 32>, records: impl IntoIterator<Item = (i16, Flags)>) {
        for (increment, flags) in records {
            let place = player.status().high;
            let record = Record { increments: [increment], flags, line: place + 1, ..Record::default() };
            player.accept(HostCommand::Ahead { place, record }).expect("room");
        }
    }

    #[test]
    fn runs_to_the_planned_stop_in_as_many_periods_as_there_are_records() {
        let mut player = player();
        fill(&mut player, (1..=20).map(|n| (n, if n == 20 { Flags::REST } else { Flags::NONE })));
        player.accept(HostCommand::rate(ONE)).expect("a rate");
        for n in 1..=20u32 {
            let status = player.period();
            assert_eq!((status.increments[0], status.line), (n as i32, n));
        }
        assert!(player.status().at_rest);
        assert_eq!(player.status().counts, [210]);
        player.accept(HostCommand::rate(-ONE)).expect("a rate");
        for _ in 0..20 {
            player.period();
        }
        assert_eq!(
            (player.status().counts, player.status().place, player.status().reached),
            ([0], Place::start_of(0), 20)
        );
    }

    #[test]
    fn an_instruction_waits_for_the_motion_and_holds_it() {
        let mut player = player();
        fill(&mut player, [(5, Flags::NONE), (5, Flags::REST), (5, Flags::REST)]);
        player.accept(HostCommand::rate(ONE / 2)).expect("a rate");
        player.period();
        let instruction = Instruction { number: 1, place: 2, periods: 3, ..Instruction::default() };
        // kept while the motion is under way (it was refused then, before instructions carried their place), and the road ends there
        player.accept(HostCommand::Instruction(instruction)).expect("a planned stop");
        while !player.period().at_rest {}
        assert_eq!((player.status().place, player.status().executed), (Place::start_of(2), 0));
        for done in [0, 0, 1] {
            let status = player.period();
            assert_eq!((status.executed, status.increments), (done, [0]));
        }
        assert_eq!(player.period().rate, ONE / 2);
    }

    #[test]
    fn an_instruction_that_cannot_be_executed_in_order_is_refused() {
        let mut player = player();
        fill(&mut player, (0..60).map(|n| (5, if n == 55 { Flags::REST } else { Flags::NONE })));
        player.accept(HostCommand::rate(ONE)).expect("a rate");
        for _ in 0..10 {
            player.period();
        }
        let at = |place| HostCommand::Instruction(Instruction { number: 1, place, ..Instruction::default() });
        assert_eq!(player.accept(at(9)), Err(CommandRefusal::OutOfOrder));
        // some records are needed to stop, but for a planned stop
        let nearest = (10..55).find(|&place| player.accept(at(place)).is_ok()).expect("there is room");
        assert!((16..40).contains(&nearest), "{nearest}");
        assert_eq!(player.accept(at(nearest + 1)), Err(CommandRefusal::Busy));
        player.accept(HostCommand::rate(-ONE)).expect("a rate");
        for _ in 0..90 {
            player.period();
        }
        assert_eq!((player.status().place, player.status().executed), (Place::start_of(0), 0));
        player.accept(HostCommand::rate(0)).expect("a rate");
        player.accept(HostCommand::rate(ONE)).expect("a rate");
        let mut executed_at = None;
        while player.status().executed == 0 {
            let status = player.period();
            executed_at = Some(status.place);
            assert!(Place::start_of(nearest).distance_to(status.place) <= 0 || status.executed == 1);
        }
        assert!(executed_at.is_some_and(|place| Place::start_of(nearest).distance_to(place) <= ONE));
    }

    #[test]
    fn a_hold_defers_an_instruction_that_has_come_to_its_place() {
        let mut player = player();
        let instruction = Instruction { number: 1, ..Instruction::default() };
        player.accept(HostCommand::Instruction(instruction)).expect("at its place");
        for _ in 0..5 {
            assert_eq!(player.period().executed, 0);
        }
        player.accept(HostCommand::rate(-ONE)).expect("a rate");
        assert_eq!(player.period().executed, 0);
        player.accept(HostCommand::rate(1)).expect("a rate");
        let status = player.period();
        assert_eq!((status.executed, status.starved), (1, false), "what follows is not late, it is not due yet");
        let second = Instruction { number: 2, ..Instruction::default() };
        player.accept(HostCommand::Instruction(second)).expect("at its place");
        assert_eq!(player.status().executed, 2, "where it may begin at once it does");
    }

    #[test]
    fn a_restart_blocks_motion_until_its_last_repeat_is_complete() {
        let mut player = player();
        fill(&mut player, (0..40).map(|n| (4, if n == 39 { Flags::REST } else { Flags::NONE })));
        player.accept(HostCommand::rate(ONE * 5 / 9)).expect("a rate");
        for _ in 0..20 {
            player.period();
        }
        player.accept(HostCommand::Restart { last: 2 }).expect("any time");
        let repeat = |number, periods| RepeatedInstruction {
            number,
            periods,
            changes: [OutputChange { channel: 3, value: number as i32 }; 4],
            count: 1,
            until: None,
        };
        assert_eq!(player.accept(HostCommand::Repeat(repeat(1, 3))), Err(CommandRefusal::InMotion));
        while !player.period().at_rest {}
        let place = player.status().place;
        assert!(place.fraction != 0 && player.status().blocked);
        assert_eq!(player.accept(HostCommand::Repeat(repeat(2, 3))), Err(CommandRefusal::Busy), "out of its order");
        player.accept(HostCommand::Repeat(repeat(1, 3))).expect("at rest");
        for repeated in [0, 0, 1, 1] {
            let status = player.period();
            assert_eq!((status.repeated, status.place, status.outputs[3]), (repeated, place, 1));
        }
        player.accept(HostCommand::Repeat(repeat(2, 0))).expect("at rest");
        assert_eq!((player.status().repeated, player.status().blocked), (2, false));
        assert!(player.period().place != place);
        player.accept(HostCommand::Restart { last: 2 }).expect("any time");
        assert!(!player.status().blocked, "it is complete already");
    }

    #[test]
    fn actions_fire_once_and_are_replayed_only_where_wanted() {
        let mut player = player();
        let action = OutputAction { place: 2, channel: 3, before: 0, after: 1 };
        player.accept(HostCommand::Action(action)).expect("room");
        assert_eq!(
            player.accept(HostCommand::Action(OutputAction { channel: 200, ..action })),
            Err(CommandRefusal::NoSuchChannel)
        );
        fill(&mut player, (0..4).map(|n| (1, if n == 3 { Flags::REST } else { Flags::NONE })));
        player.accept(HostCommand::rate(ONE)).expect("a rate");
        let outputs = |p: &mut Player<1, 64, 32>| -> Vec<i32> { (0..4).map(|_| p.period().outputs[3]).collect() };
        assert_eq!(outputs(&mut player), [0, 0, 1, 1]);
        player.accept(HostCommand::rate(-ONE)).expect("a rate");
        assert_eq!(outputs(&mut player), [1, 1, 1, 1]);
        player.accept(HostCommand::ManualOutput(OutputChange { channel: 3, value: 0 })).expect("a channel");
        player.accept(HostCommand::rate(ONE)).expect("a rate");
        assert_eq!(outputs(&mut player), [0, 0, 0, 0]);
        player.accept(HostCommand::Replay { on: true }).expect("a switch");
        player.accept(HostCommand::ManualOutput(OutputChange { channel: 3, value: 1 })).expect("a channel");
        player.accept(HostCommand::rate(-ONE)).expect("a rate");
        assert_eq!(outputs(&mut player), [1, 0, 0, 0]);
        player.accept(HostCommand::rate(ONE)).expect("a rate");
        assert_eq!(outputs(&mut player), [0, 0, 1, 1]);
    }

    proptest! {
        /// Any rates, any sliding of the window: the counts are the sum of the records before the place, always.
        #[test]
        fn counts_are_a_function_of_the_place(
            increments in prop::collection::vec(-30i16..30, 300),
            words in prop::collection::vec((-2 * ONE..2 * ONE, 1u32..60), 1..40),
        ) {
            let mut player = player();
            let mut sums = vec![0i64];
            for &i in &increments { sums.push(sums[sums.len() - 1] + i64::from(i)); }
            for (target, periods) in words {
                player.accept(HostCommand::rate(target)).expect("a rate");
                for _ in 0..periods {
                    let status = *player.status();
                    let record = |n: u32| Record { increments: [increments[n as usize]], ..Record::default() };
                    if target > 0 && (status.high as usize) < increments.len() {
                        let _ = player.accept(HostCommand::Ahead { place: status.high, record: record(status.high) });
                    } else if target < 0 && status.low > 0 {
                        let place = status.low - 1;
                        let _ = player.accept(HostCommand::Behind { place, record: record(place), rests: place == 0 });
                    }
                    player.period();
                    let status = player.status();
                    let n = status.place.record as usize;
                    let under = increments.get(n).map_or(0, |&i| retrace_core::playback::partial_increment(i, status.place.fraction));
                    prop_assert_eq!(status.counts[0], sums[n] + i64::from(under));
                }
            }
        }
    }
}
