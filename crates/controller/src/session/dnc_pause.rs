//! An interrupted program: the operator's steps from a breakpoint away and back (DNC-1 … DNC-8).
//!
//! Invariant: what may come after what is decided by [`Interruption`] alone; the program's path is left, by an epoch of its own, only after
//! the breakpoint is latched, and taken up again only at the latched counts.

use std::collections::VecDeque;
use std::thread;
use std::time::Duration;

use retrace_core::interruption::{
    Breakpoint, Interruption, InterruptionAction, InterruptionEvent as Said, SpindleDirection, SpindleState,
};
use retrace_core::mode::{Mode, ModeOutput};
use retrace_core::{Flags as RecordFlags, Place, RateTarget};
use retrace_link::{CardStatus, HostCommand, MotionCard, OutputChange, PathStart, channel};

use super::{Outcome, Session};
use crate::dnc_events::{AxisCounts, DncEvent, DncFlags, DncStep};
use crate::event::{CardError, EventKind};
use crate::machine::MachineConfig;
use crate::manual::jog_planner::{JogPlanner, JogRequest};
use crate::manual::manual_move::{ManualMove, ManualMoveEnd, OLD_NEWS};
use crate::operator::{CommandError, OperatorCommand};
use crate::telemetry::{HoldReason, PeriodRecord, Telemetry};

/// So many words may wait for a move by hand to end.
const WORDS: usize = 64;

/// An axis, as far as moves by hand ask.
#[derive(Clone, Copy, Debug)]
struct PausedAxis {
    letter: char,
    pulses_per_mm: f64,
    /// Soft limits in counts.
    travel: [i64; 2],
}

/// What a move by hand is for.
#[derive(Clone, Copy, Debug)]
enum ManualMovePurpose<const A: usize> {
    Jog {
        axis: usize,
        from: i64,
        to: i64,
        /// It was to go farther than it may.
        cut_short: bool,
    },
    /// Back to the breakpoint; the order as it was before.
    Approach(Interruption<A>),
}

/// How far an interruption is.
#[derive(Debug)]
pub(super) struct DncPause<'r, const A: usize> {
    hand: Option<JogPlanner<'r, A>>,
    axes: Vec<PausedAxis>,
    /// The program that is run.
    program: u64,
    order: Interruption<A>,
    /// Coming to rest, to be latched there.
    pausing: bool,
    /// Periods of rest in that.
    stood: u32,
    /// Words that wait for the machine to stand.
    waiting: VecDeque<OperatorCommand>,
    /// It is asked which program would be read.
    identifying: bool,
    trip: Option<(ManualMove, ManualMovePurpose<A>)>,
    /// The place on the program's path, while the card's epoch is another.
    left: Option<PathStart>,
    /// *Spindle start* was given for a cutter: it is lit behind the way back, not before.
    armed: bool,
}

impl<'r, const A: usize> DncPause<'r, A> {
    pub(super) fn new(machine: &MachineConfig) -> Self {
        let axis = |(index, axis): (usize, &crate::machine::AxisConfig)| PausedAxis {
            letter: axis.name,
            pulses_per_mm: axis.pulses_per_mm,
            travel: axis.travel_mm.map(|mm| machine.counts_of(index, mm)),
        };
        Self {
            hand: None,
            axes: machine.axes.iter().enumerate().take(A).map(axis).collect(),
            program: 0,
            order: Interruption::reading(),
            pausing: false,
            stood: 0,
            waiting: VecDeque::with_capacity(WORDS),
            identifying: false,
            trip: None,
            left: None,
            armed: false,
        }
    }

    /// With somebody who plans moves by hand; `program` is the one that is run.
    pub(super) fn with(self, hand: JogPlanner<'r, A>, program: u64) -> Self {
        Self { hand: Some(hand), program, ..self }
    }

    /// Lends out whoever plans moves by hand; [`Interrupted::put_hand`] gives it back.
    pub(super) fn take_hand(&mut self) -> Option<JogPlanner<'r, A>> {
        self.hand.take()
    }

    /// Gives back what [`Interrupted::take_hand`] has lent out.
    pub(super) fn put_hand(&mut self, hand: JogPlanner<'r, A>) {
        self.hand = Some(hand);
    }

    /// Is the program paused, or about to be?
    pub(super) fn is_on(&self) -> bool {
        self.pausing || self.order.is_paused()
    }

    /// Is the program paused?
    pub(super) fn is_paused(&self) -> bool {
        self.order.is_paused()
    }

    /// Is the machine to come to rest for it?
    pub(super) fn is_pausing(&self) -> bool {
        self.pausing
    }

    /// Is the card in an epoch that is none of the program's?
    pub(super) fn is_off_path(&self) -> bool {
        self.left.is_some()
    }

    /// Is something under way that words have to wait for?
    fn is_busy(&self) -> bool {
        self.pausing || self.identifying || self.is_moving()
    }

    /// May a tool length be entered? The breakpoint is moved then.
    pub(super) fn displace(&mut self, pulses: [i64; A]) -> Result<(), retrace_core::interruption::InterruptionError> {
        self.order.displace_breakpoint(pulses)
    }

    /// The breakpoint's counts, and the place on the path where the program was left, while it is paused.
    pub(super) fn breakpoint(&self, here: Place) -> Option<([i64; A], Place)> {
        let latch = self.order.breakpoint()?;
        Some((latch.counts, self.left.map_or(here, |left| left.place)))
    }

    pub(super) fn is_moving(&self) -> bool {
        self.trip.is_some()
    }

    pub(super) fn standing(&self) -> Option<HoldReason> {
        self.order.is_paused().then_some(HoldReason::Paused)
    }

    /// A place that the program's path had reached when it was left.
    pub(super) fn reached(&self) -> Option<u32> {
        self.left.map(|left| left.reached)
    }
}

impl<'r, const A: usize, C: MotionCard<A>> Session<'r, A, C> {
    /// The same, with somebody who plans moves by hand; `program` tells the one that is run from any other.
    #[must_use]
    pub fn by_hand(self, hand: JogPlanner<'r, A>, program: u64) -> Self {
        Self { dnc: self.dnc.with(hand, program), ..self }
    }

    /// A word that comes while a program is paused, or about to be. `None` where it is none of those that count otherwise then.
    pub(super) fn order_interrupted(&mut self, deed: OperatorCommand) -> Option<Result<(), CommandError>> {
        let steps = matches!(
            deed,
            OperatorCommand::Pause
                | OperatorCommand::SpindleStop
                | OperatorCommand::SpindleStart
                | OperatorCommand::Jog { .. }
                | OperatorCommand::Online
                | OperatorCommand::ToolLength(_)
        );
        if steps || self.dnc.is_on() && matches!(deed, OperatorCommand::CycleStart | OperatorCommand::Resume) {
            return Some(self.interruption_word(deed));
        }
        if !self.dnc.is_on() {
            return None;
        }
        match deed {
            OperatorCommand::Hold => {
                self.halt_by_hand();
                Some(Ok(()))
            }
            OperatorCommand::Stop => {
                self.halt_by_hand();
                None
            }
            OperatorCommand::Override(_)
            | OperatorCommand::RapidOverride(_)
            | OperatorCommand::Output { .. }
            | OperatorCommand::CutterOff
            | OperatorCommand::OptionalStop(_) => None,
            _ => Some(Err(CommandError::NotNow("the program is paused: go on with it first"))),
        }
    }

    /// A step of pausing at a breakpoint and going on there. It waits where the machine does not stand yet.
    fn interruption_word(&mut self, deed: OperatorCommand) -> Result<(), CommandError> {
        if deed == OperatorCommand::Pause {
            return self.pause();
        }
        if self.words_wait() && !self.dnc.order.is_inhibited() {
            if self.dnc.waiting.len() == WORDS {
                return Err(CommandError::NotNow("too many words wait for the machine to stand"));
            }
            self.dnc.waiting.push_back(deed);
            return Ok(());
        }
        self.step(deed)
    }

    fn pause(&mut self) -> Result<(), CommandError> {
        if self.dnc.pausing {
            return Err(retrace_core::interruption::InterruptionError::AlreadyPaused.into());
        }
        let Some(&latch) = self.dnc.order.breakpoint() else {
            (self.dnc.pausing, self.dnc.stood) = (true, 0);
            return Ok(());
        };
        self.dnc.order.apply(Said::Pause(latch))?;
        self.dnc.identifying = false;
        if let Some((trip, _)) = &mut self.dnc.trip {
            trip.stop();
        }
        self.tell_paused(&latch);
        Ok(())
    }

    /// The operator wants the axes to stand, whatever moves them.
    fn halt_by_hand(&mut self) {
        if self.dnc.order.is_inhibited() {
            // The way back ends as by *pause*; that is never refused on it.
            let _ = self.pause();
        } else if let Some((trip, _)) = &mut self.dnc.trip {
            trip.stop();
        }
    }

    /// Carries a step out.
    fn step(&mut self, deed: OperatorCommand) -> Result<(), CommandError> {
        let latched = self.dnc.order.breakpoint().copied();
        let turned = latched.and_then(|latch| latch.spindle);
        let said = match deed {
            OperatorCommand::SpindleStop => Said::StopSpindle,
            OperatorCommand::SpindleStart => {
                Said::StartSpindle(turned.map_or(SpindleDirection::Clockwise, |was| was.direction))
            }
            OperatorCommand::Online => Said::Online,
            OperatorCommand::Jog { axis, mm } => return self.jog(axis, mm),
            OperatorCommand::ToolLength(length) => return self.propose_tool_length(length),
            _ => Said::CycleStart { program: latched.map_or(0, |latch| latch.program) },
        };
        let before = self.dnc.order;
        match self.dnc.order.apply(said)? {
            InterruptionAction::StopSpindle => {
                self.dnc.armed = false;
                self.by_hand_now(channel::SPINDLE, 0);
                self.tell_step(DncStep::SpindleStopped);
            }
            InterruptionAction::StartSpindle(turning) => {
                let spindle = sign(turning.direction);
                let step = DncStep::SpindleStarted { spindle, speed: turning.speed };
                if self.spindle_is_a_cutter() {
                    // A cutter is never lit away from the kerf (DNC-9).
                    self.dnc.armed = true;
                    self.tell_step(step);
                } else {
                    self.tell_step(step);
                    self.start_spindle(spindle, turning.speed);
                }
            }
            InterruptionAction::Online => self.tell_step(DncStep::Online),
            InterruptionAction::Approach(_) => {
                // Not before it is known which program would be read.
                self.dnc.order = before;
                let hand = self.dnc.hand.as_mut().ok_or(NO_HAND)?;
                hand.ask(JogRequest::Identify);
                self.dnc.identifying = true;
            }
            InterruptionAction::Halt | InterruptionAction::Jog | InterruptionAction::ResumeReading => {}
        }
        Ok(())
    }

    /// The spindle turns again as it did, by the instructions that started it, with the time that they take.
    fn start_spindle(&mut self, spindle: i32, speed: u32) {
        let mut wants = self.card.status().outputs;
        wants[usize::from(channel::SPEED)] = i32::try_from(speed).unwrap_or(i32::MAX);
        wants[usize::from(channel::SPINDLE)] = spindle;
        self.begin_restart_to(&wants, |channel| matches!(channel, channel::SPEED | channel::SPINDLE));
    }

    /// Does M3 light a torch, a jet or a beam on this machine?
    fn spindle_is_a_cutter(&self) -> bool {
        self.cutting.contains(&channel::SPINDLE)
    }

    fn by_hand_now(&mut self, channel: u8, value: i32) {
        // A card takes every channel that the messages name.
        self.send_by_hand(OutputChange { channel, value });
    }

    fn jog(&mut self, letter: char, mm: f64) -> Result<(), CommandError> {
        let found = self.dnc.axes.iter().position(|axis| axis.letter == letter);
        let mut trial = self.dnc.order;
        trial.apply(Said::Jog)?;
        let index = found.ok_or(CommandError::NoAxis(letter))?;
        let PausedAxis { pulses_per_mm, travel: [low, high], .. } = self.dnc.axes[index];
        let counts = self.card.status().counts;
        let from = counts[index];
        // Who stands beyond a limit may come back.
        let wanted = from.saturating_add((mm * pulses_per_mm).round() as i64);
        let to = wanted.clamp(low.min(from), high.max(from));
        if to == from && wanted != from {
            return Err(CommandError::BeyondLimit(letter));
        }
        let mut end = counts;
        end[index] = to;
        let aim = ManualMovePurpose::Jog { axis: index, from, to, cut_short: to != wanted };
        self.begin_trip(JogRequest::Straight { from: counts, to: end }, aim)
    }

    fn begin_trip(&mut self, request: JogRequest<A>, aim: ManualMovePurpose<A>) -> Result<(), CommandError> {
        let executed = self.dnc.left.map_or(self.card.status().executed, |left| left.executed);
        let hand = self.dnc.hand.as_mut().ok_or(NO_HAND)?;
        let trip = ManualMove::begin(hand, request, executed, self.enough, self.manner.wall_time);
        self.dnc.trip = Some((trip, aim));
        Ok(())
    }

    /// Goes on with whatever is under way at a breakpoint. To be called before every control period.
    pub(super) fn watch_interruption(&mut self) -> Result<(), CardError> {
        if self.dnc.pausing {
            self.watch_pausing();
        }
        if self.dnc.identifying {
            self.watch_identifying();
        }
        self.watch_tool_length();
        self.watch_trip()?;
        while !self.words_wait()
            && let Some(deed) = self.dnc.waiting.pop_front()
        {
            if let Err(why) = self.step(deed) {
                self.tell(EventKind::CommandRejected(why));
            }
        }
        Ok(())
    }

    /// Is something under way that the operator's words have to wait for?
    fn words_wait(&self) -> bool {
        self.dnc.is_busy() || self.restart.is_active() || self.tool_length.is_open()
    }

    /// Latches the breakpoint once the machine stands, with no instruction in hand (DNC-1, DNC-2).
    fn watch_pausing(&mut self) {
        let status = self.card.status();
        let stands = status.at_rest && self.executing.is_none();
        self.dnc.stood = if stands { self.dnc.stood + 1 } else { 0 };
        if self.dnc.stood <= if self.manner.wall_time { OLD_NEWS } else { 1 } {
            return;
        }
        // A cutter went out when the machine came to rest: what the program expects is what it is to come back to.
        let outputs = if self.spindle_is_a_cutter() { self.supply.expected() } else { &status.outputs };
        let (way, speed) = (outputs[usize::from(channel::SPINDLE)], outputs[usize::from(channel::SPEED)]);
        let direction = if way < 0 { SpindleDirection::Counterclockwise } else { SpindleDirection::Clockwise };
        let spindle = (way != 0).then_some(SpindleState { direction, speed: speed.unsigned_abs() });
        let latch = Breakpoint { program: self.dnc.program, counts: status.counts, spindle };
        self.dnc.pausing = false;
        // Nothing is paused yet: it is not refused.
        if self.dnc.order.apply(Said::Pause(latch)).is_ok() {
            self.tell_paused(&latch);
        }
    }

    /// Begins the way back once it is known which program would be read (DNC-6).
    fn watch_identifying(&mut self) {
        let Some(hand) = &self.dnc.hand else { return };
        // In virtual time it must not depend on how long that takes.
        while !self.manner.wall_time && !hand.is_done() {
            thread::sleep(Duration::from_micros(20));
        }
        if !hand.is_done() {
            return;
        }
        let program = hand.program();
        self.dnc.identifying = false;
        if let Err(why) = self.approach(program) {
            self.tell(EventKind::CommandRejected(why));
        }
    }

    fn approach(&mut self, program: u64) -> Result<(), CommandError> {
        let before = self.dnc.order;
        let mut after = before;
        let InterruptionAction::Approach(to) = after.apply(Said::CycleStart { program })? else { return Ok(()) };
        let from = self.card.status().counts;
        let beyond = self.dnc.axes.iter().zip(from.iter().zip(&to)).find(|(axis, (from, to))| {
            let [low, high] = axis.travel;
            from != to && !(low..=high).contains(*to)
        });
        if let Some((axis, _)) = beyond {
            return Err(CommandError::BeyondLimit(axis.letter));
        }
        self.begin_trip(JogRequest::Approach { from, to }, ManualMovePurpose::Approach(before))?;
        self.dnc.order = after;
        self.tell_step(DncStep::Approaching);
        Ok(())
    }

    fn watch_trip(&mut self) -> Result<(), CardError> {
        let here = self.here();
        let Some((trip, aim)) = &mut self.dnc.trip else { return Ok(()) };
        let Some(hand) = &mut self.dnc.hand else { return Ok(()) };
        let ended = trip.turn(hand, &mut self.card).map_err(|fault| CardError::of(&fault))?;
        if trip.is_off_path() {
            self.dnc.left.get_or_insert(here);
            self.target = None;
        }
        let Some(ended) = ended else { return Ok(()) };
        let aim = *aim;
        self.dnc.trip = None;
        match aim {
            ManualMovePurpose::Jog { .. } if ended == ManualMoveEnd::NotPlanned => {
                self.tell(EventKind::CommandRejected(NOT_PLANNED))
            }
            ManualMovePurpose::Jog { axis, from, to, cut_short } => self.tell_jogged(axis, from, to, cut_short),
            ManualMovePurpose::Approach(before) if ended == ManualMoveEnd::NotPlanned => {
                self.dnc.order = before;
                self.tell(EventKind::CommandRejected(NOT_PLANNED));
            }
            // *Pause* has said so already.
            ManualMovePurpose::Approach(_) if ended == ManualMoveEnd::Stopped => {}
            ManualMovePurpose::Approach(_) => self.arrive()?,
        }
        Ok(())
    }

    /// The axes are back: the program's path is taken up where it was left (DNC-7, DNC-8).
    fn arrive(&mut self) -> Result<(), CardError> {
        let counts = self.card.status().counts;
        if let Err(why) = self.dnc.order.apply(Said::Arrived(counts)) {
            self.tell(EventKind::CommandRejected(why.into()));
            let _ = self.pause();
            return Ok(());
        }
        let line = self.dnc_line();
        if let Some(start) = self.dnc.left.take() {
            self.card.begin_path(start).map_err(|fault| CardError::of(&fault))?;
            let _ = self.card.send(HostCommand::Replay { on: self.replays });
        }
        self.target = None;
        let flags = DncFlags::of(&self.dnc.order);
        self.tell_at(line, EventKind::Dnc(DncEvent { step: DncStep::Arrived, flags }));
        // Whoever pressed cycle start wants it to go on; of outputs that differ, a cutter that was armed was agreed to.
        let agreed = std::mem::take(&mut self.dnc.armed) && self.only_cutters_differ();
        let _ = self.operation.apply(retrace_core::mode::ModeCommand::Restart { confirmed: agreed });
        Ok(())
    }

    /// Are all outputs as the program expects them, but for the cutters?
    fn only_cutters_differ(&self) -> bool {
        let want = self.supply.expected();
        let are = self.outputs_compared_with(want);
        (0..channel::COUNT).all(|at| are[at] == want[at] || self.cutting.contains(&(at as u8)))
    }

    /// Where the program's path is, to be taken up again; the machine stands.
    fn here(&self) -> PathStart {
        let CardStatus { place, reached, executed, .. } = *self.card.status();
        let before = self.supply.record(place.record.wrapping_sub(1));
        let rests = place.fraction == 0 && before.is_some_and(|record| record.flags.contains(RecordFlags::REST));
        PathStart { place, rests, reached, executed }
    }

    /// What is asked of the card at a breakpoint: nothing.
    pub(super) fn demand_paused(&self) -> ModeOutput {
        let look_ahead = self.operation.mode() == Mode::Run;
        ModeOutput { target: RateTarget::ZERO, look_ahead, restore_outputs: false, notice: None }
    }

    /// A control period off the program's path.
    pub(super) fn turn_off_path(&mut self) -> Result<Option<Outcome>, CardError> {
        self.take_orders();
        self.advance_restart();
        let status = *self.card.run_period().map_err(|fault| CardError::of(&fault))?;
        if let Some(off) = status.cutter_off {
            self.cutter_went_off(off);
        }
        self.book_off_path(&status);
        self.still_periods = if status.rate == 0 && !self.dnc.is_moving() { self.still_periods + 1 } else { 0 };
        if let Some(outcome) = self.alarm(&status) {
            return Ok(Some(outcome));
        }
        let is_over = self.stopping || self.nobody_goes_on();
        Ok((is_over && status.at_rest && !self.dnc.is_moving()).then_some(Outcome::Stopped))
    }

    /// Counts and reports a control period off the program's path.
    pub(super) fn book_off_path(&mut self, status: &CardStatus<A>) {
        self.tally.pause();
        self.follow_by_hand(status);
        self.teller.outputs(&status.outputs);
        let period = PeriodRecord {
            mode: self.operation.mode(),
            hold_reason: self.standing(),
            override_rate: self.overrides.asked(),
            rapid_override: self.operation.rapid_override(),
            off_path: true,
            ..PeriodRecord::of(status)
        };
        self.teller.send(Telemetry::Period(period));
    }

    pub(super) fn tell_step(&mut self, step: DncStep) {
        let flags = DncFlags::of(&self.dnc.order);
        let line = self.dnc_line();
        self.tell_at(line, EventKind::Dnc(DncEvent { step, flags }));
    }

    /// The program line of the breakpoint; off the path the card knows none.
    fn dnc_line(&self) -> u32 {
        let status = self.card.status();
        let left = self.dnc.left.map(|left| left.place);
        let record = left.and_then(|Place { record, .. }| self.supply.record(record));
        record.map_or(status.line, |record| record.line)
    }

    fn tell_paused(&mut self, latch: &Breakpoint<A>) {
        let (spindle, speed) = latch.spindle.map_or((0, 0), |turning| (sign(turning.direction), turning.speed));
        let counts = AxisCounts::new(&latch.counts, self.dnc.axes.len());
        self.tell_step(DncStep::Paused { counts, spindle, speed });
    }

    fn tell_jogged(&mut self, index: usize, from: i64, to: i64, cut_short: bool) {
        let PausedAxis { letter, pulses_per_mm, .. } = self.dnc.axes[index];
        let counts = self.card.status().counts;
        let mut off = counts;
        if let Some(latch) = self.dnc.order.breakpoint() {
            off.iter_mut().zip(&latch.counts).for_each(|(off, &latched)| *off -= latched);
        }
        let step = DncStep::Jogged {
            axis: letter,
            mm: (counts[index] - from) as f64 / pulses_per_mm,
            cut_short: cut_short || counts[index] != to,
            off: AxisCounts::new(&off, self.dnc.axes.len()),
        };
        self.tell_step(step);
    }
}

const NO_HAND: CommandError = CommandError::NotNow("nobody is there to plan moves by hand");
const NOT_PLANNED: CommandError = CommandError::NotNow("the move by hand cannot be planned");

fn sign(direction: SpindleDirection) -> i32 {
    match direction {
        SpindleDirection::Clockwise => 1,
        SpindleDirection::Counterclockwise => -1,
    }
}
