//! A manual move on the card: an epoch that begins at the machine's position, played to its end or to where it is
//! stopped.
//!
//! Invariant: it begins and ends at rest. When it is stopped, the rest of it is discarded, and the next one begins at
//! the counts.

use retrace_core::{Place, Rate, RecordIndex};
use retrace_link::{
    CardStatus, GearStart, GearState, HostCommand, Instruction, MotionCard, PathStart, ProbeArming, ProbeLatch,
    SpindleTask,
};
use std::thread;
use std::time::Duration;

use crate::jog_planner::{JogPlanner, JogRequest};

/// Over a link, the card's report of being at rest may be this many periods old.
pub(crate) const REPORT_LATENCY_PERIODS: u32 = retrace_config::IN_FLIGHT_RECORDS;

/// A manual move in progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ManualMove {
    /// Place at which it begins.
    start: RecordIndex,
    /// Number of the last instruction that was executed; it does not change.
    executed: u32,
    state: ManualMoveState,
    /// Number of records ahead that are enough to run at full rate.
    look_ahead_records: u32,
    wall_time: bool,
    /// Periods at rest while it is being stopped.
    rest_periods: u32,
    /// Whether the card has begun an epoch for it.
    off_path: bool,
    /// What the card needs before anything moves.
    arming: Arming,
    /// Whether it is held.
    is_held: bool,
    /// Whether it is passed backward to its beginning.
    is_reversed: bool,
}

/// What the card needs before anything moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Arming {
    None,
    /// The probe's latch, of a probing move.
    Probe(ProbeArming),
    /// The gear, of a rigid tap.
    Tap(GearStart),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ManualMoveState {
    /// Waiting until enough is planned.
    Planned,
    /// A tap that the card has kept: waiting until enough is planned beyond its place.
    Kept,
    /// Moving; the rate that was sent to the card last, and whether the probe's latch is armed if it has to be.
    Moving { sent: Rate, is_armed: bool },
    /// Coming to rest before the end.
    Stopping,
    /// At rest.
    Ended(ManualMoveEnd),
}

/// How a manual move ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ManualMoveEnd {
    /// At its end.
    Completed,
    /// Before its end: it was stopped.
    Stopped,
    /// It could not be planned.
    NotPlanned,
}

impl ManualMove {
    /// Requests a move. The machine is at rest; `executed` is the number of the last instruction.
    pub(crate) fn begin<const A: usize>(
        jog_planner: &mut JogPlanner<'_, A>,
        request: JogRequest<A>,
        executed: u32,
        look_ahead_records: u32,
        wall_time: bool,
    ) -> Self {
        let start = jog_planner.ring.write();
        jog_planner.request(request);
        Self {
            start,
            executed,
            state: ManualMoveState::Planned,
            look_ahead_records,
            wall_time,
            rest_periods: 0,
            off_path: false,
            arming: Arming::None,
            is_held: false,
            is_reversed: false,
        }
    }

    /// Makes it a probing move: the probe's latch is armed before anything moves, and the move also ends at rest behind
    /// the touch.
    pub(crate) fn probing(self, arming: ProbeArming) -> Self {
        Self { arming: Arming::Probe(arming), ..self }
    }

    /// Makes it a rigid tap: its records follow the spindle, and it ends where it began. It awaits more records than a
    /// path does.
    pub(crate) fn tapping(self, gear: GearStart) -> Self {
        let look_ahead_records = self.look_ahead_records.max(u32::from(gear.ahead));
        Self { arming: Arming::Tap(gear), look_ahead_records, ..self }
    }

    /// Makes it a rigid tap that the card has kept: its gear is engaged, and the tool rests in its hole. Held, until it
    /// is let go on.
    pub(crate) fn resumed_tap<const A: usize>(self, gear: GearStart, status: &CardStatus<A>) -> Self {
        let state = ManualMoveState::Kept;
        Self { state, executed: status.executed.wrapping_sub(1), off_path: true, is_held: true, ..self.tapping(gear) }
    }

    /// Place at which it begins.
    pub(crate) const fn start(&self) -> RecordIndex {
        self.start
    }

    /// Holds the move, or lets it go on.
    pub(crate) fn hold(&mut self, is_held: bool) {
        self.is_held = is_held;
    }

    /// Passes a tap backward to its beginning, or forward again.
    pub(crate) fn reverse(&mut self, is_reversed: bool) {
        self.is_reversed = is_reversed;
    }

    /// Whether it is held.
    pub(crate) const fn is_held(&self) -> bool {
        self.is_held
    }

    /// Whether the card has begun an epoch for it.
    pub(crate) fn is_off_path(&self) -> bool {
        self.off_path
    }

    /// Stops the move. A further stop changes nothing: one that is repeated must not restart the wait for rest.
    pub(crate) fn stop(&mut self) {
        if !matches!(self.state, ManualMoveState::Ended(_) | ManualMoveState::Stopping) {
            (self.state, self.rest_periods) = (ManualMoveState::Stopping, 0);
        }
    }

    /// Performs what is due before the next period. Returns how the move ended, once it has.
    ///
    /// # Errors
    /// The card's fault.
    pub(crate) fn advance<const A: usize, C: MotionCard<A>>(
        &mut self,
        jog_planner: &mut JogPlanner<'_, A>,
        card: &mut C,
    ) -> Result<Option<ManualMoveEnd>, C::Fault> {
        if self.state == ManualMoveState::Planned && self.is_planned(jog_planner, self.start) {
            let is_empty = jog_planner.is_done() && jog_planner.ring.write() == self.start;
            // A probing move without a way asks for the state of the probe.
            if is_empty && (self.arming == Arming::None || jog_planner.has_failed()) {
                self.state = ManualMoveState::Ended(if jog_planner.has_failed() {
                    ManualMoveEnd::NotPlanned
                } else {
                    ManualMoveEnd::Completed
                });
            } else {
                let start = PathStart { executed: self.executed, ..PathStart::at(self.start) };
                card.begin_path(start)?;
                self.off_path = true;
                self.state = ManualMoveState::Moving { sent: Rate::ZERO, is_armed: self.arming == Arming::None };
            }
        }
        if self.state == ManualMoveState::Kept {
            let (place, write) = (card.status().place.record, jog_planner.ring.write());
            // The planner goes on as what it has written is passed, up to the place.
            jog_planner.ring.seek(if write.is_before(place) { write } else { place });
            if self.is_planned(jog_planner, place) {
                self.state = ManualMoveState::Moving { sent: Rate::ZERO, is_armed: true };
            }
        }
        if let ManualMoveState::Moving { mut sent, mut is_armed } = self.state {
            is_armed = is_armed || self.arm(card);
            let takes_records = match self.arming {
                Arming::None => true,
                // The path may begin again as the probe is armed: it may have limits of its own.
                Arming::Probe(_) => is_armed,
                // The card takes records of a tap once it has its gear.
                Arming::Tap(_) => card.status().executed == self.executed.wrapping_add(1),
            };
            if takes_records {
                self.fill(jog_planner, card);
            }
            let is_ready = match self.arming {
                Arming::None => self.may_move(jog_planner, card),
                Arming::Probe(_) => card.status().probe != ProbeLatch::Idle && self.may_move(jog_planner, card),
                Arming::Tap(_) => is_armed,
            };
            let wanted = match (self.is_held, self.is_reversed) {
                (true, _) => Rate::ZERO,
                (false, true) => -Rate::ONE,
                (false, false) => Rate::ONE,
            };
            if sent != wanted && is_ready && card.send(HostCommand::rate(wanted)).is_ok() {
                sent = wanted;
            }
            self.state = ManualMoveState::Moving { sent, is_armed };
            if self.has_ended(jog_planner, card.status()) {
                self.end(jog_planner, card, ManualMoveEnd::Completed);
            }
        }
        if self.state == ManualMoveState::Stopping {
            let _ = card.send(HostCommand::rate(Rate::ZERO));
            self.cancel(jog_planner);
            self.rest_periods = if card.status().at_rest { self.rest_periods + 1 } else { 0 };
            if jog_planner.is_done() && self.rest_periods > if self.wall_time { REPORT_LATENCY_PERIODS } else { 1 } {
                self.end(jog_planner, card, ManualMoveEnd::Stopped);
            }
        }
        Ok(match self.state {
            ManualMoveState::Ended(how) => Some(how),
            _ => None,
        })
    }

    /// Gives the card what it needs before anything moves. Returns whether it was taken.
    fn arm<const A: usize, C: MotionCard<A>>(&self, card: &mut C) -> bool {
        match self.arming {
            Arming::None => true,
            Arming::Probe(arming) => card.send(HostCommand::ArmProbe(arming)).is_ok(),
            Arming::Tap(gear) => {
                let (number, spindle) = (self.executed.wrapping_add(1), Some(SpindleTask::Gear(gear)));
                let instruction = Instruction { number, place: self.start, spindle, ..Instruction::default() };
                card.send(HostCommand::Instruction(instruction)).is_ok()
            }
        }
    }

    /// Whether the move is at rest at its end. A probing move is as well behind its touch, and stays for as long as a
    /// report of the touch may be late.
    fn has_ended<const A: usize>(&mut self, jog_planner: &mut JogPlanner<'_, A>, status: &CardStatus<A>) -> bool {
        let is_at_end = jog_planner.is_done() && status.place == Place::start_of(jog_planner.ring.write());
        match self.arming {
            Arming::None => return is_at_end && status.at_rest,
            Arming::Probe(_) => {}
            Arming::Tap(_) => {
                // Back where it began, and no gear has the cursor any more.
                let is_over = status.executed == self.executed.wrapping_add(1)
                    && status.spindle.gear == GearState::Off
                    && status.place == Place::start_of(self.start);
                if is_over {
                    // What was planned for turning further is not needed.
                    self.cancel(jog_planner);
                }
                self.rest_periods = if is_over && status.at_rest { self.rest_periods + 1 } else { 0 };
                return jog_planner.is_done()
                    && self.rest_periods > if self.wall_time { REPORT_LATENCY_PERIODS } else { 1 };
            }
        }
        let has_touched = matches!(status.probe, ProbeLatch::Touched(_));
        if has_touched {
            self.cancel(jog_planner);
        }
        let is_over = has_touched || is_at_end && status.probe == ProbeLatch::Armed;
        self.rest_periods = if is_over && status.at_rest { self.rest_periods + 1 } else { 0 };
        jog_planner.is_done() && self.rest_periods > if self.wall_time { REPORT_LATENCY_PERIODS } else { 1 }
    }

    /// Ends the planning. In virtual time the number of periods must not depend on the planner's speed: this waits.
    fn cancel<const A: usize>(&self, jog_planner: &mut JogPlanner<'_, A>) {
        jog_planner.cancel();
        while !self.wall_time && !jog_planner.is_done() {
            thread::sleep(Duration::from_micros(20));
        }
    }

    fn end<const A: usize, C: MotionCard<A>>(
        &mut self,
        jog_planner: &mut JogPlanner<'_, A>,
        card: &mut C,
        how: ManualMoveEnd,
    ) {
        let _ = card.send(HostCommand::rate(Rate::ZERO));
        let write = jog_planner.ring.write();
        jog_planner.ring.seek(write);
        self.state = ManualMoveState::Ended(how);
    }

    /// Whether enough is planned beyond `place`, or all of it. In virtual time the result must not depend on the
    /// planner's speed: this waits.
    fn is_planned<const A: usize>(&self, jog_planner: &mut JogPlanner<'_, A>, place: RecordIndex) -> bool {
        loop {
            let done = jog_planner.is_done();
            let write = jog_planner.ring.write();
            if done || !write.is_before(place) && write.since(place) >= self.look_ahead_records {
                return true;
            }
            if self.wall_time {
                return false;
            }
            thread::sleep(Duration::from_micros(20));
        }
    }

    fn fill<const A: usize, C: MotionCard<A>>(&self, jog_planner: &mut JogPlanner<'_, A>, card: &mut C) {
        jog_planner.ring.seek(card.status().place.record);
        self.is_planned(jog_planner, card.status().place.record);
        let end = jog_planner.ring.write();
        match self.arming {
            _ if card.status().rate < Rate::ZERO => {
                self.fill_behind(self.start, jog_planner, card);
                return;
            }
            // At rest it may be turned by hand either way, which begins with the records that are held.
            Arming::Tap(gear) if card.status().at_rest => {
                let place = card.status().place.record;
                let back = self.start.records_to(place).clamp(0, i32::from(gear.ahead)) as u32;
                self.fill_behind(place - back, jog_planner, card);
            }
            _ => {}
        }
        let mut place = card.status().high;
        while place.is_before(end)
            && let Some(record) = jog_planner.ring.record(place)
            && card.send(HostCommand::Ahead { place, record }).is_ok()
        {
            place += 1;
        }
    }

    /// Sends the records of a tap behind the window, back to `first`.
    fn fill_behind<const A: usize, C: MotionCard<A>>(
        &self,
        first: RecordIndex,
        jog_planner: &JogPlanner<'_, A>,
        card: &mut C,
    ) {
        let mut place = card.status().low;
        while first.is_before(place)
            && let Some(record) = jog_planner.ring.record(place - 1)
            && card.send(HostCommand::Behind { place: place - 1, record, rests: place - 1 == self.start }).is_ok()
        {
            place -= 1;
        }
    }

    /// Whether enough records are on the card to run at full rate.
    fn may_move<const A: usize, C: MotionCard<A>>(&self, jog_planner: &mut JogPlanner<'_, A>, card: &C) -> bool {
        let (wanted, end) = ((self.start + self.look_ahead_records), jog_planner.ring.write());
        let wanted = if end.is_before(wanted) { end } else { wanted };
        !card.acknowledged_high().is_before(wanted)
    }
}
