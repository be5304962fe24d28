//! The motion path of a job: one turn per control period, from the operator's commands to the card's next report.
//!
//! Invariant: the order within a turn is always the same: poll the planner, apply the operator's commands, get the
//! mode's output, send the instruction that is due, slide the window, set the rate, let the period pass, account it.
//! Nothing here waits for the planner except in virtual time, where waiting takes no time.

mod alarms;
mod arc_latch;
mod back_target;
mod commands;
mod contour_pass;
mod cut_end;
mod cut_map;
mod cut_mapping;
mod cutter_watch;
mod direct_return;
mod dnc_pause;
mod geared;
mod height_by_hand;
mod input_wait;
mod job_phase;
mod kerf_search;
mod lead_in;
mod manual_outputs;
mod park;
mod pause_state;
mod pointer;
mod probing;
mod program_override;
mod recorded_layers;
mod recovery;
mod restart;
mod resumption;
mod return_path;
mod sense_test;
mod session_config;
mod switching;
mod telemetry;
mod test_pulse;
mod tool_length;
mod tool_lift;
mod window;

use std::thread;
use std::time::Duration;

use retrace_config::MachineConfig;
use retrace_core::mode::{Mode, ModeCommand, ModeController, ModeOutput, MotionFacts, OperatorNotice, Resuming};
use retrace_core::wheel::Wheel;
use retrace_core::{Place, Rate, RateTarget, RecordIndex};
use retrace_link::{CardStatus, HostCommand, MotionCard, Outputs, channel};

use crate::command_queue::CommandSources;
use crate::cutter_off_reason::CutterOffReason;
use crate::cutter_state::CutterState;
use crate::event::{CardError, EventKind};
use crate::operator::rate_percent;
use crate::overrides::OverrideRequester;
use crate::plan_item::{ExclusiveKind, PlanEnd};
use crate::record_streamer::RecordStreamer;
use crate::run_stats::{PeriodClass, RunStats};
use crate::telemetry::TelemetrySender;
use back_target::BackTarget;
use contour_pass::ContourPass;
use cut_map::CutMap;
use direct_return::RetraceEstimate;
use geared::GearedMotion;
use height_by_hand::HeightByHand;
use input_wait::InputWait;
use job_phase::{JobPhase, ProgramStop};
use manual_outputs::ManualOutputs;
use pause_state::DncPause;
use probing::ProgramProbing;
use program_override::ProgramOverride;
use recorded_layers::RecordedLayers;
use recovery::CutRecovery;
use restart::{LeavingRun, OutputRestart};
use sense_test::SenseTest;
pub(crate) use sense_test::{cancel_command, return_command, sense_command, sensed_mm};
pub use session_config::RunMode;
use session_config::{SessionConfig, contour_channels};
use test_pulse::TestPulse;
pub(crate) use test_pulse::pulse_command;
use tool_length::ToolLengthEntry;
use tool_lift::ToolLift;

/// How a run ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The program was executed to its end.
    Completed,
    /// The operator stopped it, or no operator was there to resume it.
    Stopped,
    /// The program turned out to have an error while it was decoded; the rendered error.
    BlockError(String),
    /// An alarm: number, cause, remedy.
    Alarm(&'static str, String, String),
}

/// Time at rest (s), with the operator's script at its end, after which the job ends because nobody will resume it.
const NOBODY_THERE_S: f64 = 10.0;

/// A job that is executed on a card.
pub struct Session<'r, const A: usize, C: MotionCard<A>> {
    card: C,
    streamer: RecordStreamer<'r, A>,
    mode_controller: ModeController,
    commands: CommandSources,
    overrides: OverrideRequester,
    wheel: Box<Wheel<512>>,
    config: SessionConfig<A>,
    /// Restart of the outputs before motion resumes.
    restart: OutputRestart,
    /// Outputs that were switched manually and are not reported yet.
    manual_outputs: ManualOutputs,
    leaving_run: LeavingRun,
    /// The cutter boundary that the operator has confirmed to pass backward with the cutter on.
    passed_boundary: Option<RecordIndex>,
    /// The cutter boundary at which reverse run rests until the operator confirms it, also if the cutter goes off
    /// there.
    asked_boundary: Option<RecordIndex>,
    /// Whether M1 stops.
    optional_stop: bool,
    /// The outputs as they were reported last.
    outputs: Outputs,
    telemetry: TelemetrySender<A>,
    stats: RunStats,
    /// Kind of the instruction that the card is executing.
    executing: Option<ExclusiveKind>,
    program_stop: ProgramStop,
    /// Whether the machine is at rest at the end of a block until cycle start.
    single_stop: bool,
    single_block: bool,
    /// Furthest place when the step of single block began.
    step_begin: RecordIndex,
    /// Control periods behind the end of the program in which the card reported an output of a cutter on.
    on_at_end_periods: u32,
    phase: JobPhase,
    /// State of a DNC pause.
    dnc: DncPause<'r, A>,
    /// Entry of a tool length in progress.
    tool_length: ToolLengthEntry,
    /// Target of a reverse run, if it has one.
    back_target: Option<BackTarget>,
    /// Estimate of the time of that reverse run, while it is calculated.
    retrace_estimate: Option<RetraceEstimate<A>>,
    /// Recovery of an interrupted cut.
    recovery: CutRecovery,
    /// What was cut of the contours.
    cut_map: CutMap,
    recorded_layers: RecordedLayers,
    /// How contours are passed that are cut, or skipped.
    contour_pass: ContourPass,
    /// State of each cutter, in the order of the fire channels.
    cutter_states: Vec<CutterState>,
    /// Whether the input of each of them was inactive in the last period while it cut.
    cutter_inactive: Vec<bool>,
    /// Height of the tool of the cutter that senses the sheet.
    tool_lift: ToolLift,
    /// Probing moves of the program.
    probing: ProgramProbing<A>,
    /// Motion that follows the spindle.
    geared: GearedMotion,
    height: HeightByHand,
    program_override: ProgramOverride,
    /// Wait of the program for an input.
    input_wait: Option<InputWait>,
    /// Test pulse that is on.
    test_pulse: Option<TestPulse>,
    sense_test: Option<SenseTest>,
    /// Whether the handwheel has been behind `reached`.
    wheel_was_behind: bool,
    /// Whether the card's window ends where the mode requires.
    window_is_trimmed: bool,
    /// Whether an alarm was reported.
    alarm_reported: bool,
    dry: bool,
    still_periods: u64,
    target: Option<RateTarget>,
}

/// Nothing moves.
const STANDING: ModeOutput =
    ModeOutput { target: RateTarget::ZERO, look_ahead: false, restore_outputs: false, notice: None };

impl<'r, const A: usize, C: MotionCard<A>> Session<'r, A, C> {
    /// Creates a session on `card`, which is at rest at the place where the streamer begins.
    pub fn new(
        card: C,
        machine: &MachineConfig,
        streamer: RecordStreamer<'r, A>,
        commands: CommandSources,
        run_mode: RunMode,
        telemetry: TelemetrySender<A>,
    ) -> Self {
        Self {
            stats: RunStats::new(card.status().place.record),
            recorded_layers: RecordedLayers::new(machine, card.status().place.record),
            streamer: streamer.with_cutters(machine).with_contour_channels(contour_channels(machine)),
            card,
            mode_controller: ModeController::default(),
            commands,
            overrides: OverrideRequester::default(),
            wheel: Box::new(Wheel::new(machine.wheel_periods, machine.wheel_counts)),
            config: SessionConfig::new(machine, run_mode),
            restart: OutputRestart::new(),
            manual_outputs: ManualOutputs::new(),
            leaving_run: LeavingRun::No,
            passed_boundary: None,
            asked_boundary: None,
            optional_stop: false,
            outputs: [0; channel::COUNT],
            telemetry,
            executing: None,
            program_stop: ProgramStop::No,
            single_stop: false,
            single_block: false,
            step_begin: RecordIndex::new(0),
            on_at_end_periods: 0,
            phase: JobPhase::Running,
            dnc: DncPause::new(machine),
            tool_length: ToolLengthEntry::new(machine),
            back_target: None,
            retrace_estimate: None,
            recovery: CutRecovery::new(machine),
            cutter_states: vec![CutterState::Off; machine.cutting_outputs.len()],
            cutter_inactive: vec![false; machine.cutting_outputs.len()],
            cut_map: CutMap::of_machine(machine),
            contour_pass: ContourPass::default(),
            tool_lift: ToolLift::default(),
            probing: ProgramProbing::new(machine),
            geared: GearedMotion::default(),
            height: HeightByHand::default(),
            program_override: ProgramOverride::default(),
            input_wait: None,
            test_pulse: None,
            sense_test: None,
            wheel_was_behind: false,
            window_is_trimmed: true,
            alarm_reported: false,
            dry: false,
            still_periods: 0,
            target: None,
        }
    }

    /// Enables overrides above 100 %.
    #[must_use]
    pub fn with_overrides(self, overrides: OverrideRequester) -> Self {
        Self { overrides, ..self }
    }

    /// Runs the job to its end.
    pub fn run(mut self) -> (Outcome, RunStats, C) {
        // Every card accepts this command; it changes only what retracing does.
        let _ = self.card.send(HostCommand::Replay { on: self.config.replays_outputs });
        self.apply_rate_override();
        self.reset_height();
        self.telemetry.send_output_changes(&self.card.status().outputs);
        self.emit(EventKind::Started);
        self.report_restored_contours();
        if self.mode_controller.mode() != Mode::Run {
            self.emit_mode();
        }
        let outcome = loop {
            match self.run_period() {
                Ok(None) => {}
                Ok(Some(outcome)) => break outcome,
                Err(error) => break self.end_with_error(error),
            }
        };
        // A restart in progress may complete after the end: no rate may remain that would start motion then.
        let _ = self.card.send(HostCommand::rate(Rate::ZERO));
        let switched_off = self.end_with_outputs_off(match outcome {
            Outcome::Completed => CutterOffReason::ProgramEnd,
            _ => CutterOffReason::JobStopped,
        });
        let outcome = match switched_off {
            Err(error) if !matches!(outcome, Outcome::Alarm(..)) => self.end_with_error(error),
            _ => outcome,
        };
        self.stats.dropped_events = self.telemetry.dropped_events();
        self.count_contours();
        (outcome, self.stats, self.card)
    }

    /// Runs one control period. `Err` is a fault of the card.
    fn run_period(&mut self) -> Result<Option<Outcome>, CardError> {
        self.watch_pause()?;
        if self.dnc.is_off_path() {
            return self.run_paused_period();
        }
        if self.probing.is_active() {
            return self.run_probing_period();
        }
        self.poll_planner();
        self.apply_commands();
        self.advance_tool_lift();
        self.advance_sense_test();
        self.advance_retrace_estimate()?;
        if self.dnc.is_off_path() {
            return self.run_paused_period();
        }
        self.advance_recovery()?;
        self.advance_lead_in();
        self.advance_restart();
        let demand = self.mode_output();
        if demand.target != RateTarget::ZERO && self.card.status().at_rest {
            self.check_collision()?;
        }
        while self.send_due_instruction(demand)? {
            self.poll_planner();
        }
        self.slide_window(demand);
        if let Some(outcome) = self.job_outcome() {
            return Ok(Some(outcome));
        }
        self.set_rate(demand);
        let status = *self.card.run_period()?;
        self.watch_gear();
        self.account_period(&status);
        self.watch_outputs_at_end()?;
        Ok(self.alarm(&status))
    }

    /// Polls the planner. In virtual time the run must not depend on the planner's speed: this waits until enough is
    /// planned.
    fn poll_planner(&mut self) {
        self.streamer.poll_planner();
        let (mut spins, enough) = (0u32, self.records_to_plan());
        while !self.config.run_mode.wall_time
            && !self.streamer.has_lookahead(self.card.status(), enough)
            && !self.commands.stop_requested()
        {
            spins += 1;
            match spins {
                0..100 => std::hint::spin_loop(),
                100..200 => thread::yield_now(),
                _ => thread::sleep(Duration::from_micros(50)),
            }
            self.streamer.poll_planner();
        }
        if self.streamer.planner_is_gone() || self.telemetry.receiver_is_gone() {
            // A defect in the planning thread, which is propagated when the machine is at rest.
            self.phase.stop();
            let _ = self.mode_controller.apply(ModeCommand::Hold);
        }
    }

    fn motion_facts(&self) -> MotionFacts {
        let status = self.card.status();
        // In normal run nothing depends on it while the machine moves: the comparison would take most of the period.
        let is_compared = self.mode_controller.mode() != Mode::Run
            || status.blocked
            || self.mode_controller.state().resuming != Resuming::No;
        let agree = || {
            let wants = self.wanted_outputs();
            self.outputs_compared_with(&wants) == wants
        };
        MotionFacts {
            place: status.place,
            at_rest: status.at_rest,
            reached: status.reached,
            oldest: self.oldest(),
            outputs_agree: !is_compared || agree(),
            wheel: self.wheel_rate(),
        }
    }

    fn mode_output(&mut self) -> ModeOutput {
        if self.dnc.is_paused() {
            return self.paused_output();
        }
        if self.is_lifting() {
            return STANDING;
        }
        if let Some(output) = self.lead_in_output() {
            return output;
        }
        if self.restart.is_ending() || self.restart.is_active() && self.mode_controller.mode() != Mode::Run {
            // One restart at a time: what the furthest place needs is compared when this one is complete.
            return STANDING;
        }
        self.recover_when_rejoined();
        if self.is_due_here() {
            return STANDING;
        }
        self.search_back();
        let (facts, mode) = (self.motion_facts(), self.mode_controller.mode());
        let demand = self.advance_mode(&facts);
        let mut demand = self.in_gear(demand);
        // An instruction in progress is completed before a pause.
        let pauses = self.dnc.is_pausing() && self.executing.is_none() && !self.is_engaged();
        // The program stands; whoever retraces meanwhile comes back to where it does.
        let stops = mode == Mode::Run && (self.program_stop == ProgramStop::Waiting || self.single_stop);
        let leaves_run = !self.has_left_run();
        if pauses
            || stops
            || leaves_run
            || self.due_lift().is_some()
            || self.retrace_estimate.is_some()
            || self.back_target.as_ref().is_some_and(BackTarget::is_searching)
        {
            demand.target = RateTarget::ZERO;
        }
        match demand.notice {
            Some(OperatorNotice::HistoryStart) => self.emit_end_of_reverse_run(facts.oldest),
            Some(OperatorNotice::OutputsDiffer) => self.emit_differing_outputs(),
            Some(OperatorNotice::RunResumed) => self.emit(EventKind::RunResumed),
            None => {}
        }
        self.watch_wheel(&facts);
        if demand.restore_outputs {
            self.begin_restart(|_| true);
        }
        if !self.restart.permits_rate() {
            demand.target = RateTarget::ZERO;
        } else if demand.target != RateTarget::ZERO && !self.restart.is_active() && self.card.status().blocked {
            // The cutter went out where the machine was at rest. Retracing continues without it; normal run requires
            // that outputs agree.
            if self.mode_controller.mode() == Mode::Run && !facts.outputs_agree {
                let _ = self.mode_controller.apply(ModeCommand::Restart { confirmed: false });
                demand.target = RateTarget::ZERO;
            } else {
                self.release_block();
            }
        }
        if self.mode_controller.mode() != mode {
            self.emit_mode();
        }
        demand
    }

    /// Reports when the handwheel returns to `reached`, its forward end. Reported once.
    fn watch_wheel(&mut self, facts: &MotionFacts) {
        let at_reached = facts.place == Place::start_of(facts.reached);
        if self.mode_controller.mode() != Mode::Wheel {
            self.wheel_was_behind = false;
        } else if !at_reached {
            self.wheel_was_behind = true;
        } else if facts.at_rest && std::mem::take(&mut self.wheel_was_behind) {
            self.emit(EventKind::HistoryEndReached);
        }
    }

    fn account_period(&mut self, status: &CardStatus<A>) {
        let executing = self.executing;
        self.update_manual_outputs(status);
        self.acknowledge_instruction();
        if let Some(planned) = self.overrides.advance_to(status.reached) {
            // Overrides are requested in steps of a hundredth of a per cent.
            self.emit(EventKind::OverridePlanned((100.0 * rate_percent(planned)).round() / 100.0));
            self.apply_rate_override();
        }
        self.watch_program_override();
        if let Some(off) = status.cutter_off {
            self.cutter_went_off(off);
        }
        self.watch_latch(status);
        self.watch_tool_height(status);
        self.map_period(status);
        self.watch_cutter_states(status);
        self.watch_leading_abrasive(status);
        self.watch_test_pulse(status);
        self.watch_sense_test(status);
        let mode = self.mode_controller.mode();
        let held = self.mode_controller.is_held()
            || self.program_stop != ProgramStop::No
            || self.single_stop
            || self.waits_for_release();
        let executing = executing.or(self.restart.is_active().then_some(ExclusiveKind::Switch));
        if self.dnc.is_paused() {
            self.stats.count_paused();
        } else {
            self.stats.count_period(PeriodClass {
                mode,
                held,
                instruction: executing.map(|kind| kind == ExclusiveKind::Dwell),
                rate: status.rate,
                place: status.place,
            });
        }
        self.watch_replayed_outputs(status);
        self.streamer.seek(status);
        self.report_passed_items();
        self.watch_streamer(status, mode);
        // Before a stop, and before the end, the look-ahead runs out as planned.
        if mode == Mode::Run && status.rate == Rate::ONE && self.streamer.continues_without_stop() {
            self.stats.record_buffered(self.card.acknowledged_high().since(status.place.record));
        }
        self.emit_period(status);
        let is_still = status.rate == Rate::ZERO && (executing.is_none() || self.rests_in_instruction(status));
        self.still_periods = if is_still { self.still_periods + 1 } else { 0 };
    }

    /// Outcome of the job, if it has ended.
    fn job_outcome(&mut self) -> Option<Outcome> {
        let status = *self.card.status();
        // An instruction in progress is completed first.
        if !status.at_rest || self.is_lifting() || self.executing.is_some() && !self.rests_in_instruction(&status) {
            return None;
        }
        if self.phase.is_stopping() {
            // Everything was executed, wherever the operator has reversed to since.
            return Some(if self.phase.program_has_ended() { Outcome::Completed } else { Outcome::Stopped });
        }
        if self.restart.is_active() {
            return None;
        }
        let at_end = status.place == Place::start_of(status.reached);
        if self.mode_controller.mode() == Mode::Run
            && !self.dnc.is_on()
            && at_end
            && self.streamer.all_executed(&status)
        {
            // What was planned behind the last motion has come since the last period.
            self.report_passed_items();
            return Some(match self.streamer.summary().map(|s| &s.ending) {
                Some(PlanEnd::BlockError(text)) => Outcome::BlockError(text.clone()),
                _ if self.commands.waits_for_release_at_end() => {
                    self.wait_for_release();
                    return None;
                }
                _ => Outcome::Completed,
            });
        }
        self.is_abandoned().then_some(Outcome::Stopped)
    }

    /// Keeps the job open at the end of the program, so that reverse run is possible while the part is still clamped.
    fn wait_for_release(&mut self) {
        if self.phase == JobPhase::Running {
            self.phase = JobPhase::ProgramEnded;
            self.emit(EventKind::ProgramEnd);
            self.switch_off_at_end(CutterOffReason::ProgramEnd);
        }
    }

    /// Whether the machine is at rest at the end of the program, until the operator releases the job or reverses.
    fn waits_for_release(&self) -> bool {
        self.phase.program_has_ended() && self.mode_controller.mode() == Mode::Run && !self.dnc.is_on()
    }

    /// Whether the job waits for an operator who will not come. A stream or a link may stall for any time.
    fn is_abandoned(&self) -> bool {
        let waits = self.mode_controller.mode() != Mode::Run
            || self.dnc.is_paused()
            || self.mode_controller.is_held()
            || self.is_stopped_by_override()
            || self.program_stop != ProgramStop::No
            || self.single_stop;
        let nobody = waits
            && self.commands.waits_for_motion()
            && (!self.config.run_mode.wall_time || self.config.run_mode.operator);
        nobody && self.still_periods as f64 * self.config.period_s > NOBODY_THERE_S
    }
}
