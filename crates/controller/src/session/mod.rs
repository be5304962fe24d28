//! The motion path of a job: one turn a control period, from the operator's words to the card's next report.
//!
//! Invariant: the order within a turn is always the same: look what is planned, take the operator's words, ask the mode what is
//! wanted, switch what is due, slide the window, set the rate, let the period pass, book it. Nothing here waits for the planner
//! but in virtual time, where no time passes by waiting.

mod back_target;
mod commands;
mod dnc_pause;
mod manual_outputs;
mod restart;
mod return_path;
mod switching;
mod telemetry;
mod tool_length;
mod window;

use std::thread;
use std::time::Duration;

use retrace_core::mode::{Mode, ModeCommand, ModeController, ModeOutput, MotionFacts, OperatorNotice};
use retrace_core::wheel::Wheel;
use retrace_core::{ONE, Place, RateTarget};
use retrace_link::{CardStatus, HostCommand, MotionCard, Outputs, channel};

use crate::command_queue::CommandSources;
use crate::event::{CardError, CutterOffReason, EventKind};
use crate::machine::{MachineConfig, RetraceOutputs};
use crate::operator::percent;
use crate::overrides::OverrideRequester;
use crate::plan_item::{ExclusiveKind, PlanEnd};
use crate::record_streamer::{PassedItem, RecordStreamer};
use crate::resume::{PlanReplay, ResumeError, ResumePlan, ResumePoint};
use crate::run_stats::{PeriodClass, RunStats};
use crate::telemetry::{Telemetry, TelemetrySender};
use back_target::BackTarget;
use dnc_pause::DncPause;
use manual_outputs::ManualOutputs;
use restart::{LeavingRun, OutputRestart};
use tool_length::ToolLengthEntry;

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The program was executed to its end.
    Completed,
    /// The operator stopped it, or nobody was there to go on.
    Stopped,
    /// The program turned out to have an error while it was fed; rendered.
    Refused(String),
    /// An alarm: number, cause, remedy.
    Alarm(&'static str, String, String),
}

/// Time and company of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunMode {
    /// Does time pass while nothing happens? In virtual time the motion path waits for the planner instead.
    pub wall_time: bool,
    /// Is an operator there to press cycle start at a program stop? Without one it is passed.
    pub operator: bool,
    /// Is the motion thread scheduled under SCHED_FIFO, where that is permitted?
    pub real_time: bool,
}

/// Records that may be on their way to the card, or that it has run since it was heard of, at a common line's latency.
pub const IN_FLIGHT_RECORDS: u32 = 120;

/// Standing still for so long (s), with the operator's script at its end, ends the job: nobody will go on.
const NOBODY_THERE_S: f64 = 10.0;

/// A job being executed on a card.
pub struct Session<'r, const A: usize, C: MotionCard<A>> {
    card: C,
    supply: RecordStreamer<'r, A>,
    operation: ModeController,
    operators: CommandSources,
    overrides: OverrideRequester,
    wheel: Box<Wheel<512>>,
    manner: RunMode,
    period_s: f64,
    enough: u32,
    /// Periods to stand and wait for records in wall time.
    patience: u64,
    /// The fire channels of torches, jets and beams.
    cutting: Vec<u8>,
    /// The channels of the cutters in the order of the card's settings.
    cutting_channels: Vec<u8>,
    /// The channels that the end of a job switches off.
    off_at_end: Vec<u8>,
    /// The outputs are being brought back before motion goes on.
    restart: OutputRestart,
    /// Outputs that were switched by hand, and are not reported yet.
    by_hand: ManualOutputs,
    /// The cutter went out because the machine stood, and was not brought back yet.
    cutter_is_out: bool,
    leaving_run: LeavingRun,
    /// The place where the cutter was switched that the operator has agreed to pass backward with the cutter on.
    passed_boundary: Option<u32>,
    /// A dry run.
    inhibits_outputs: bool,
    /// A jet may cut while the path is retraced.
    retrace_cuts: bool,
    /// M1 stops.
    optional_stop: bool,
    replays: bool,
    /// The outputs as they were reported last.
    outputs: Outputs,
    mm_per_pulse: [f64; A],
    teller: TelemetrySender<A>,
    tally: RunStats,
    /// The kind of the instruction that the card is executing.
    executing: Option<ExclusiveKind>,
    /// Standing at a program stop until cycle start.
    program_stop: bool,
    /// Cycle start was pressed there.
    go_on: bool,
    /// Standing at the end of a block until cycle start.
    single_stop: bool,
    single: bool,
    stopping: bool,
    /// Everything was executed once, and the job waits for its release.
    program_ended: bool,
    /// The program is interrupted (DNC).
    dnc: DncPause<'r, A>,
    /// A tool length is being entered.
    tool_length: ToolLengthEntry,
    /// Reverse run that ends at a place.
    back: Option<BackTarget>,
    /// The handwheel has been behind `reached`.
    wheel_behind: bool,
    /// The road ends where the mode has it end.
    road_cut: bool,
    /// An alarm was told.
    alarmed: bool,
    dry: bool,
    still_periods: u64,
    target: Option<RateTarget>,
}

impl<'r, const A: usize, C: MotionCard<A>> Session<'r, A, C> {
    /// A session on `card`, which stands at the place where the supply begins.
    pub fn new(
        card: C,
        machine: &MachineConfig,
        supply: RecordStreamer<'r, A>,
        operators: CommandSources,
        manner: RunMode,
        teller: TelemetrySender<A>,
    ) -> Self {
        let mut mm_per_pulse = [0.0; A];
        for (slot, axis) in mm_per_pulse.iter_mut().zip(&machine.axes) {
            *slot = axis.pulses_per_mm.recip();
        }
        Self {
            tally: RunStats::new(card.status().place.record),
            supply: supply.cutting(&machine.cutting_outputs),
            card,
            operation: ModeController::default(),
            operators,
            overrides: OverrideRequester::default(),
            wheel: Box::new(Wheel::new(machine.wheel_periods, machine.wheel_counts)),
            manner,
            period_s: machine.period_s(),
            enough: machine.stopping.foresight_records + IN_FLIGHT_RECORDS,
            patience: u64::from(machine.look_ahead_records),
            cutting: machine.cutting_outputs.clone(),
            cutting_channels: machine.cutting_channels(),
            off_at_end: machine.off_at_end(),
            restart: OutputRestart::new(),
            by_hand: ManualOutputs::new(),
            cutter_is_out: false,
            leaving_run: LeavingRun::No,
            passed_boundary: None,
            inhibits_outputs: machine.inhibits_outputs,
            retrace_cuts: machine.cutters.iter().any(|cutter| cutter.retrace_cut),
            optional_stop: false,
            replays: machine.retrace_outputs == RetraceOutputs::Replayed,
            outputs: [0; channel::COUNT],
            mm_per_pulse,
            teller,
            executing: None,
            program_stop: false,
            go_on: false,
            single_stop: false,
            single: false,
            stopping: false,
            program_ended: false,
            dnc: DncPause::new(machine),
            tool_length: ToolLengthEntry::new(machine),
            back: None,
            wheel_behind: false,
            road_cut: true,
            alarmed: false,
            dry: false,
            still_periods: 0,
            target: None,
        }
    }

    /// The same, which asks for overrides above 100 %.
    #[must_use]
    pub fn asking(self, overrides: OverrideRequester) -> Self {
        Self { overrides, ..self }
    }

    /// Runs the job to its end.
    pub fn run(mut self) -> (Outcome, RunStats, C) {
        // Every card takes this word; it changes nothing but what retracing does.
        let _ = self.card.send(HostCommand::Replay { on: self.replays });
        self.override_rate();
        self.teller.outputs(&self.card.status().outputs);
        self.tell(EventKind::Started);
        if self.operation.mode() != Mode::Run {
            self.tell_mode();
        }
        let outcome = loop {
            match self.run_period() {
                Ok(None) => {}
                Ok(Some(outcome)) => break outcome,
                Err(trouble) => break self.ends_in(trouble),
            }
        };
        // A restart that was under way may complete behind the end: no rate may be left that would set the machine in motion then.
        let _ = self.card.send(HostCommand::rate(0));
        self.end_switched_off(match outcome {
            Outcome::Completed => CutterOffReason::ProgramEnd,
            _ => CutterOffReason::JobStopped,
        });
        self.tally.dropped_events = self.teller.dropped_events();
        (outcome, self.tally, self.card)
    }

    /// Takes the job up where it was left, its origin having had these counts: finds the place, asks `agree`, brings the axes to the counts of the
    /// place in the order of DNC-6 where they stand elsewhere, and goes on forward to `reached` by itself. Where `agree` says no, it is stopped at once.
    ///
    /// # Errors
    /// [`Unfound`]; the card has not been told anything then.
    pub fn resume(
        mut self,
        at: &ResumePoint,
        counts: [i64; A],
        agree: impl FnOnce(&ResumePlan<A>) -> bool,
    ) -> Result<(Outcome, RunStats, C), ResumeError> {
        let prepared = PlanReplay::new(&mut self.supply, at, counts, self.mm_per_pulse).follow(self.card.status())?;
        if !agree(&prepared) {
            return Ok((Outcome::Stopped, self.tally, self.card));
        }
        if let (Some(axis), false) = (self.tool_axis(), at.lengths.is_empty()) {
            self.bar_beyond_limits(prepared.counts()[axis], prepared.start().place);
        }
        let begun = self.go_to_breakpoint(prepared.counts()).and_then(|ended| match ended {
            None => self.card.begin_path(*prepared.start()).map(|()| None).map_err(|fault| CardError::of(&fault)),
            ended => Ok(ended),
        });
        match begun {
            Ok(None) => {}
            Ok(Some(outcome)) => return Ok((outcome, self.tally, self.card)),
            Err(trouble) => {
                let outcome = self.ends_in(trouble);
                return Ok((outcome, self.tally, self.card));
            }
        }
        self.operation = ModeController::rejoining();
        self.tally = RunStats::new(at.start.reached);
        // Before anything moves in the work its tool has to turn; what cuts by itself is lit at the furthest place only.
        let cutting = std::mem::take(&mut self.cutting);
        self.begin_restart(|channel| !cutting.contains(&channel));
        self.cutting = cutting;
        Ok(self.run())
    }

    /// The end of a job by something that is told unless an alarm was.
    fn ends_in(&mut self, trouble: CardError) -> Outcome {
        let (number, cause, remedy) = trouble.parts();
        if !self.alarmed {
            self.tell(EventKind::Alarm(trouble));
        }
        Outcome::Alarm(number, cause, remedy)
    }

    /// One control period. `Err` is a fault of the card.
    fn run_period(&mut self) -> Result<Option<Outcome>, CardError> {
        self.watch_interruption()?;
        if self.dnc.is_off_path() {
            return self.turn_off_path();
        }
        self.poll_planner();
        self.take_orders();
        self.advance_restart();
        let demand = self.demand();
        while self.switch_what_is_due(demand)? {
            self.poll_planner();
        }
        self.slide(demand);
        if let Some(outcome) = self.ended() {
            return Ok(Some(outcome));
        }
        self.set_rate(demand);
        let status = *self.card.run_period().map_err(|fault| CardError::of(&fault))?;
        self.account_period(&status);
        Ok(self.alarm(&status))
    }

    /// A latched alarm: told at once, and the end of the job when the machine stands.
    fn alarm(&mut self, status: &CardStatus<A>) -> Option<Outcome> {
        let alarm = status.alarm?;
        if !self.alarmed {
            self.tell(EventKind::Alarm(CardError::Latched(alarm)));
            self.alarmed = true;
        }
        status.at_rest.then(|| self.ends_in(CardError::Latched(alarm)))
    }

    /// Looks what is planned by now. In virtual time the run must not depend on how fast the planner is: it waits until enough is.
    fn poll_planner(&mut self) {
        self.supply.poll_planner();
        let mut spins = 0u32;
        while !self.manner.wall_time
            && !self.supply.has_lookahead(self.card.status(), self.enough)
            && !self.operators.stop_requested()
        {
            spins += 1;
            match spins {
                0..100 => std::hint::spin_loop(),
                100..200 => thread::yield_now(),
                _ => thread::sleep(Duration::from_micros(50)),
            }
            self.supply.poll_planner();
        }
        if self.supply.planner_gone() || self.teller.deaf() {
            // A defect over there, which is passed on when the machine stands.
            self.stopping = true;
            let _ = self.operation.apply(ModeCommand::Hold);
        }
    }

    fn facts(&self) -> MotionFacts {
        let status = self.card.status();
        MotionFacts {
            place: status.place,
            at_rest: status.at_rest,
            reached: status.reached,
            oldest: self.oldest(),
            outputs_agree: self.outputs_compared_with(self.supply.expected()) == *self.supply.expected(),
            wheel: self.wheel.rate(),
        }
    }

    fn demand(&mut self) -> ModeOutput {
        if self.dnc.is_paused() {
            return self.demand_paused();
        }
        if self.restart.is_active() && self.operation.mode() != Mode::Run {
            // One restart at a time: what the furthest place needs is compared when this one is over.
            return ModeOutput { target: RateTarget::ZERO, look_ahead: false, restore_outputs: false, notice: None };
        }
        self.search_back();
        let (facts, mode) = (self.facts(), self.operation.mode());
        let mut demand = self.operation.advance_period(&facts);
        // An instruction in hand is completed before a pause.
        let pauses = self.dnc.is_pausing() && self.executing.is_none();
        let stops = self.program_stop && !self.go_on || self.single_stop;
        let leaves_run = !self.has_left_run();
        if pauses || stops || leaves_run || self.back.as_ref().is_some_and(BackTarget::is_looked_for) {
            demand.target = RateTarget::ZERO;
        }
        match demand.notice {
            Some(OperatorNotice::HistoryStart) => {
                let there = self.back.as_ref().is_some_and(|back| back.is_there(facts.oldest));
                self.tell(match self.supply.barrier() {
                    _ if there => EventKind::BackTargetReached,
                    _ if self.cutter_boundary() == Some(facts.oldest) => EventKind::CutterBoundary,
                    Some(code) => EventKind::RetraceBarrier(code),
                    None => EventKind::HistoryStartReached,
                });
            }
            Some(OperatorNotice::OutputsDiffer) => self.tell_differing(),
            Some(OperatorNotice::RunResumed) => self.tell(EventKind::RunResumed),
            None => {}
        }
        self.watch_wheel(&facts);
        if demand.restore_outputs {
            self.cutter_is_out = false;
            self.begin_restart(|_| true);
        }
        if !self.restart.lets_rate_pass() {
            demand.target = RateTarget::ZERO;
        } else if demand.target != RateTarget::ZERO && !self.restart.is_active() && self.card.status().blocked {
            // The cutter went out where the machine stood; retracing goes on without it, normal run with outputs that agree.
            if self.operation.mode() == Mode::Run && !facts.outputs_agree {
                let _ = self.operation.apply(ModeCommand::Restart { confirmed: false });
                demand.target = RateTarget::ZERO;
            } else {
                self.release_block();
            }
        }
        if self.operation.mode() != mode {
            self.tell_mode();
        }
        demand
    }

    /// The handwheel's forward end is `reached`: that it stands there again is told once.
    fn watch_wheel(&mut self, facts: &MotionFacts) {
        let at_reached = facts.place == Place::start_of(facts.reached);
        if self.operation.mode() != Mode::Wheel {
            self.wheel_behind = false;
        } else if !at_reached {
            self.wheel_behind = true;
        } else if facts.at_rest && std::mem::take(&mut self.wheel_behind) {
            self.tell(EventKind::HistoryEndReached);
        }
    }

    fn account_period(&mut self, status: &CardStatus<A>) {
        let executing = self.executing;
        self.follow_by_hand(status);
        self.acknowledge();
        if let Some(planned) = self.overrides.pass(status.reached) {
            // Overrides are asked for in steps of a hundredth of a percent.
            self.tell(EventKind::OverridePlanned((100.0 * percent(planned)).round() / 100.0));
            self.override_rate();
        }
        if let Some(off) = status.cutter_off {
            self.cutter_went_off(off);
        }
        let mode = self.operation.mode();
        let held = self.operation.is_held() || self.program_stop || self.single_stop || self.waits_for_release();
        let executing = executing.or(self.restart.is_active().then_some(ExclusiveKind::Switch));
        if self.dnc.is_paused() {
            self.tally.pause();
        } else {
            self.tally.count(PeriodClass {
                mode,
                held,
                instruction: executing.map(|kind| kind == ExclusiveKind::Dwell),
                rate: status.rate,
                place: status.place,
            });
        }
        self.watch_replayed_outputs(status);
        self.supply.seek(status);
        while let Some(news) = self.supply.next_passed_item() {
            match news {
                PassedItem::Action(action, line) => {
                    self.tally.switch_events += 1;
                    self.tell_at(line, EventKind::OutputChanged(action.channel, action.after));
                }
                PassedItem::Message(line, text) => self.tell_at(line, EventKind::Message(text)),
                PassedItem::Active(active) => self.teller.send(Telemetry::Active(active)),
            }
        }
        self.watch_supply(status, mode);
        // Before a stop, and before the end, it runs out by itself.
        if mode == Mode::Run && status.rate == ONE && self.supply.goes_on() {
            self.tally.buffered(self.card.acknowledged_high().wrapping_sub(status.place.record));
        }
        self.tell_period(status);
        self.still_periods = if status.rate == 0 && executing.is_none() { self.still_periods + 1 } else { 0 };
    }

    /// Has the job come to its end?
    fn ended(&mut self) -> Option<Outcome> {
        let status = *self.card.status();
        if !status.at_rest || self.executing.is_some() {
            return None;
        }
        if self.stopping {
            // Everything was executed, wherever the operator has gone back to since.
            return Some(if self.program_ended { Outcome::Completed } else { Outcome::Stopped });
        }
        if self.restart.is_active() {
            return None;
        }
        let at_end = status.place == Place::start_of(status.reached);
        if self.operation.mode() == Mode::Run && !self.dnc.is_on() && at_end && self.supply.all_executed(&status) {
            return Some(match self.supply.summary().map(|s| &s.ending) {
                Some(PlanEnd::Refused(text)) => Outcome::Refused(text.clone()),
                _ if self.operators.releases_the_end() => {
                    self.wait_for_release();
                    return None;
                }
                _ => Outcome::Completed,
            });
        }
        self.nobody_goes_on().then_some(Outcome::Stopped)
    }

    /// The program has come to its end: the job stays open, so that reverse run is possible while the part is still clamped.
    fn wait_for_release(&mut self) {
        if !self.program_ended {
            self.program_ended = true;
            self.tell(EventKind::ProgramEnd);
            self.switch_off_at_end(CutterOffReason::ProgramEnd);
        }
    }

    /// Does it stand at the end of the program, until the operator releases the job or goes back?
    fn waits_for_release(&self) -> bool {
        self.program_ended && self.operation.mode() == Mode::Run && !self.dnc.is_on()
    }

    /// Does it wait for an operator who will not come? A feed or a line may stall for as long as it likes.
    fn nobody_goes_on(&self) -> bool {
        let waits = self.operation.mode() != Mode::Run
            || self.dnc.is_paused()
            || self.operation.is_held()
            || self.operation.override_rate() == 0
            || self.operation.rapid_override() == 0
            || self.program_stop
            || self.single_stop;
        let nobody = waits && self.operators.waits_for_motion() && (!self.manner.wall_time || self.manner.operator);
        nobody && self.still_periods as f64 * self.period_s > NOBODY_THERE_S
    }
}
