//! Performs a manual task while no program runs, with the machinery of a job: an epoch, the card's window, and
//! telemetry.
//!
//! Invariant: it begins and ends at rest. *Stop* or *hold* brings it to rest where it is, and the rest of it is
//! discarded.

use retrace_core::{Rate, RecordIndex};
use std::sync::PoisonError;
use std::thread;

use retrace_config::{CutterConfig, IN_FLIGHT_RECORDS, MachineConfig, NumberedError};
use retrace_core::mode::Mode;
use retrace_journal::JournalConfig;
use retrace_link::{Alarm, CardStatus, HostCommand, MotionCard, OutputChange, PathStart};

use super::ManualTask;
use super::frame::{self, CutFrame};
use crate::command_queue::CommandSources;
use crate::dnc_events::{AxisCounts, DncEvent, DncFlags, DncStep};
use crate::event::{CardError, Event, EventKind};
use crate::job::{self, JobOptions, JobStart};
use crate::jog_planner::{self, JogPlanner, JogRequest};
use crate::jog_speed::JogSpeed;
use crate::manual_move::{ManualMove, ManualMoveEnd, REPORT_LATENCY_PERIODS};
use crate::mdi::ModalContext;
use crate::operator::{CommandError, OperatorCommand};
use crate::session::{Outcome, RunMode, pulse_command};
use crate::telemetry::{self, Observer, PeriodRecord, Telemetry, TelemetrySender};

/// Periods within which a card has accepted a command and reported it.
const RESPONSE_PERIODS: u32 = 3 * REPORT_LATENCY_PERIODS;

/// Periods within which a card has begun to home an axis and reported it, however late its reports are.
const MAX_BEGIN_PERIODS: u32 = 100 * REPORT_LATENCY_PERIODS;

/// Result of a task.
#[derive(Clone, Debug, PartialEq)]
pub enum ManualTaskDone {
    /// It was completed.
    Completed {
        /// Whether a jog was shortened by the soft limit.
        cut_short: bool,
    },
    /// It was stopped.
    Stopped,
}

/// Reason why a task was not performed, or not completed. The machine is at rest.
#[derive(Clone, Debug, PartialEq)]
pub enum ManualTaskError {
    /// It was not begun; the reason.
    Numbered(NumberedError),
    /// An MDI block has errors: rendered.
    Block(Vec<String>),
    /// An alarm, or a fault of the card.
    Card(CardError),
}

impl std::fmt::Display for ManualTaskError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Numbered(error) => write!(f, "{error}"),
            Self::Block(errors) => f.write_str(&errors.join("\n")),
            Self::Card(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for ManualTaskError {}

impl From<NumberedError> for ManualTaskError {
    fn from(refusal: NumberedError) -> Self {
        Self::Numbered(refusal)
    }
}

impl From<CardError> for ManualTaskError {
    fn from(error: CardError) -> Self {
        Self::Card(error)
    }
}

/// Performs a task on a card that is at rest. MDI blocks use the modal state of `desk` and update it.
///
/// # Errors
/// The reason why it was not completed.
pub fn perform_manual_task<const A: usize, C: MotionCard<A>>(
    task: &ManualTask,
    machine: &MachineConfig,
    context: &mut ModalContext,
    card: &mut C,
    (operators, run_mode): (CommandSources, RunMode),
    observer: &mut dyn Observer<A>,
) -> Result<ManualTaskDone, ManualTaskError> {
    if let Some(text) = block_of(task, machine)? {
        return perform_block(&text, machine, context, card, (operators, run_mode), observer);
    }
    if card.status().layer != 0 {
        // The height at which a job was stopped becomes part of the counts.
        begin_path(card).map_err(CardError::from)?;
    }
    let mut ring = jog_planner::ring(machine, RecordIndex::new(0))
        .map_err(|_| NumberedError::new("E2112", "no ring for a move", "a shorter look_ahead_s"))?;
    let mail = jog_planner::JogStatus::default();
    let (hand, requests) = jog_planner::jog_channel(ring.split(), &mail);
    let (telemetry, receiver) = telemetry::telemetry_channel(run_mode.wall_time, machine.period_s());
    thread::scope(|scope| {
        scope.spawn(move || receiver.run(observer));
        let planner = scope.spawn(move || requests.serve(machine, Box::new(|| 0)));
        let hand = hand.with_thread(planner.thread().clone());
        let enough = machine.stopping.look_ahead_records + IN_FLIGHT_RECORDS;
        ManualRunner { machine, card, operators, run_mode, telemetry, hand, enough, stopped: false }.perform(task)
    })
}

/// The block that a task amounts to, if it is one.
fn block_of(task: &ManualTask, machine: &MachineConfig) -> Result<Option<String>, ManualTaskError> {
    Ok(match task {
        ManualTask::Mdi(text) => Some(text.clone()),
        ManualTask::WorkZero(None) => {
            let words: Vec<String> =
                machine.axes.iter().map(|axis| format!(" {}0", axis.name.to_ascii_uppercase())).collect();
            Some(format!("G10 L20 P0{}", words.concat()))
        }
        ManualTask::WorkZero(Some(letter)) => {
            axis(machine, *letter)?;
            Some(format!("G10 L20 P0 {}0", letter.to_ascii_uppercase()))
        }
        _ => None,
    })
}

fn axis(machine: &MachineConfig, letter: char) -> Result<usize, NumberedError> {
    machine.axis_of(letter).ok_or_else(|| {
        let names: Vec<String> = machine.axes.iter().map(|axis| axis.name.to_string()).collect();
        let what = format!("the machine has no axis {}", letter.to_ascii_uppercase());
        NumberedError::new("E2161", what, format!("one of {}", names.join(", ")))
    })
}

/// Executes an MDI block as a small job.
fn perform_block<const A: usize, C: MotionCard<A>>(
    text: &str,
    machine: &MachineConfig,
    context: &mut ModalContext,
    card: &mut C,
    (operators, run_mode): (CommandSources, RunMode),
    observer: &mut dyn Observer<A>,
) -> Result<ManualTaskDone, ManualTaskError> {
    begin_path(card).map_err(CardError::from)?;
    let machine = MachineConfig { history_records: 0, ..machine.clone() }.standing_at(&card.status().counts);
    let block = context.block(&machine, text).map_err(ManualTaskError::Block)?;
    let (block, left) = block.with_result();
    let options =
        JobOptions { start: JobStart::First, commands: operators, run_mode, journal: JournalConfig::default() };
    let end = job::run_job(&machine, block, options, &mut *card, observer)
        .map_err(|why| NumberedError::new("E2112", why.to_string(), "a shorter look_ahead_s in the machine file"))?;
    match end.outcome {
        Outcome::Completed => {
            if let Some(carried) = left.lock().unwrap_or_else(PoisonError::into_inner).take() {
                context.apply_modal_snapshot(carried);
            }
            Ok(ManualTaskDone::Completed { cut_short: false })
        }
        Outcome::Stopped => {
            begin_path(card).map_err(CardError::from)?;
            Ok(ManualTaskDone::Stopped)
        }
        Outcome::BlockError(text) => Err(ManualTaskError::Block(vec![text])),
        Outcome::Alarm(number, cause, remedy) => Err(ManualTaskError::Card(CardError::Fault { number, cause, remedy })),
    }
}

/// Begins a new path at the machine's position.
fn begin_path<const A: usize, C: MotionCard<A>>(card: &mut C) -> Result<(), C::Fault> {
    let CardStatus { place, executed, .. } = *card.status();
    card.begin_path(PathStart { executed, ..PathStart::at(place.boundary_ahead()) })
}

/// A task in progress on a card.
pub(super) struct ManualRunner<'a, 'r, const A: usize, C: MotionCard<A>> {
    pub(super) machine: &'a MachineConfig,
    pub(super) card: &'a mut C,
    operators: CommandSources,
    pub(super) run_mode: RunMode,
    telemetry: TelemetrySender<A>,
    hand: JogPlanner<'r, A>,
    enough: u32,
    pub(super) stopped: bool,
}

impl<const A: usize, C: MotionCard<A>> ManualRunner<'_, '_, A, C> {
    fn perform(mut self, task: &ManualTask) -> Result<ManualTaskDone, ManualTaskError> {
        match task {
            ManualTask::Home(None) => {
                let order: Vec<char> = self.machine.homing_order().to_vec();
                if order.is_empty() {
                    return Err(no_home("no axis of the machine has a home switch".into()).into());
                }
                order.into_iter().try_fold(ManualTaskDone::Completed { cut_short: false }, |done, letter| {
                    if done == ManualTaskDone::Stopped { Ok(done) } else { self.home(letter) }
                })
            }
            ManualTask::Home(Some(letter)) => self.home(*letter),
            ManualTask::Jog { axis, mm } => {
                self.jog(*axis, JogSpeed::Full, |from, counts| from.saturating_add(counts(*mm)))
            }
            ManualTask::JogOn { axis, up: true, speed } => self.jog(*axis, *speed, |_, _| i64::MAX),
            ManualTask::JogOn { axis, up: false, speed } => self.jog(*axis, *speed, |_, _| i64::MIN),
            ManualTask::ClearAlarm => self.clear(),
            ManualTask::Output(channel, value) => {
                let change = OutputChange { channel: *channel, value: *value };
                let refused = |_| {
                    NumberedError::new("E2161", format!("the card has no output {channel}"), "an output that it has")
                };
                self.card.send(HostCommand::ManualOutput(change)).map_err(refused)?;
                self.run_periods(if self.run_mode.wall_time { REPORT_LATENCY_PERIODS } else { 2 })
            }
            ManualTask::TestPulse => self.test_pulse(),
            ManualTask::SenseTest => self.sense_test(),
            ManualTask::Frame(frame) => self.trace_frame(frame),
            // Blocks are not handled here.
            ManualTask::Mdi(_) | ManualTask::WorkZero(_) => Ok(ManualTaskDone::Completed { cut_short: false }),
        }
    }

    /// Switches the first cutter on for its test pulse; *hold*, *stop* and *cutter off* end it.
    fn test_pulse(&mut self) -> Result<ManualTaskDone, ManualTaskError> {
        let refuse = |what: &str, remedy: &str| NumberedError::new("E2161", what, remedy.to_owned());
        let machine = self.machine;
        let Some(&channel) = machine.cutting_outputs.first() else {
            return Err(refuse("the machine has no torch, jet or beam", "declare it as a [[cutter]]").into());
        };
        if machine.inhibits_outputs {
            return Err(refuse("this is a dry run: the cutter stays off", "leave the dry run").into());
        }
        let touches = |cutter: &CutterConfig| cutter.collision.iter().any(|&n| self.card.status().inputs >> n & 1 == 1);
        if machine.cutters.iter().any(touches) {
            return Err(refuse("a collision input of the cutter is active", "free the tool, check its input").into());
        }
        self.begin()?;
        let (number, periods) = (1, machine.test_pulse_periods(channel));
        let refused = |_| refuse("the card refuses the test pulse", "a card with this output, at rest");
        self.card.send(pulse_command(number, channel, periods)).map_err(refused)?;
        while self.card.status().repeated != number {
            self.run_period()?;
            if std::mem::take(&mut self.stopped) {
                let _ = self.card.send(HostCommand::ManualOutput(OutputChange { channel, value: 0 }));
            }
        }
        Ok(ManualTaskDone::Completed { cut_short: false })
    }

    /// Homes one axis to its switch, by the card.
    fn home(&mut self, letter: char) -> Result<ManualTaskDone, ManualTaskError> {
        let index = axis(self.machine, letter)?;
        let name = letter.to_ascii_uppercase();
        let homing = self.machine.homing(index).ok_or_else(|| no_home(format!("axis {name} has no home switch")))?;
        self.begin()?;
        self.card
            .send(HostCommand::Home(homing))
            .map_err(|why| no_home(format!("the card does not home axis {name}: {why:?}")))?;
        let settled = if self.run_mode.wall_time { REPORT_LATENCY_PERIODS } else { 2 };
        // Until the card reports that it moves, its reports are older than the command.
        let (mut stood, mut waited, mut has_begun) = (0, 0, false);
        while stood < settled {
            self.run_period()?;
            if self.stopped {
                let _ = self.card.send(HostCommand::rate(Rate::ZERO));
            }
            let at_rest = self.card.status().at_rest;
            has_begun |= !at_rest;
            stood = if at_rest && has_begun { stood + 1 } else { 0 };
            waited += u32::from(!has_begun);
            if waited > MAX_BEGIN_PERIODS {
                return Err(no_home(format!("the card does not begin to home axis {name}")).into());
            }
        }
        // The count was set: a path begins there.
        self.begin()?;
        Ok(if self.stopped { ManualTaskDone::Stopped } else { ManualTaskDone::Completed { cut_short: false } })
    }

    /// Jogs an axis within its soft limits. `wanted` returns the target from its current count and the pulses per mm.
    fn jog(
        &mut self,
        letter: char,
        speed: JogSpeed,
        wanted: impl Fn(i64, &dyn Fn(f64) -> i64) -> i64,
    ) -> Result<ManualTaskDone, ManualTaskError> {
        let index = axis(self.machine, letter)?;
        let counts = self.card.status().counts;
        let from = counts[index];
        let of = |mm| self.machine.counts_of(index, mm);
        let [low, high] = self.machine.axes[index].travel_mm.map(of);
        let wanted = wanted(from, &of);
        let to = wanted.clamp(low.min(from), high.max(from));
        if to == from && wanted != from {
            let what = CommandError::BeyondLimit(letter).to_string();
            return Err(NumberedError::new(
                "E2161",
                what,
                "the other way; home the axis where its position cannot be trusted",
            )
            .into());
        }
        let mut end = counts;
        end[index] = to;
        let ended = self.play_move(JogRequest::Straight { from: counts, to: end, speed })?;
        let cut_short = to != wanted;
        self.emit_jogged(index, from, cut_short || ended == ManualMoveEnd::Stopped);
        // The rest of the move is discarded.
        self.begin()?;
        match ended {
            ManualMoveEnd::Completed => Ok(ManualTaskDone::Completed { cut_short }),
            ManualMoveEnd::Stopped => Ok(ManualTaskDone::Stopped),
            ManualMoveEnd::NotPlanned => {
                Err(NumberedError::new("E2161", "the move cannot be planned", "a shorter move").into())
            }
        }
    }

    /// Plays a move to its end or to where it is stopped.
    fn play_move(&mut self, request: JogRequest<A>) -> Result<ManualMoveEnd, ManualTaskError> {
        let executed = self.card.status().executed;
        let mut trip = ManualMove::begin(&mut self.hand, request, executed, self.enough, self.run_mode.wall_time);
        loop {
            let ended = trip.advance(&mut self.hand, self.card).map_err(CardError::from)?;
            if let Some(ended) = ended {
                return Ok(ended);
            }
            self.run_period()?;
            if self.stopped {
                trip.stop();
                self.stopped = false;
            }
        }
    }

    /// Traces a rectangle with the pointer, which is on along it and off again behind it.
    fn trace_frame(&mut self, frame: &CutFrame) -> Result<ManualTaskDone, ManualTaskError> {
        let CardStatus { counts, outputs, .. } = *self.card.status();
        frame::require_cutters_off(self.machine, &outputs)?;
        let corners = frame.corners(self.machine, counts)?;
        let done = self.visit_corners(&corners);
        self.switch_pointer(false);
        let settled = self.run_periods(if self.run_mode.wall_time { REPORT_LATENCY_PERIODS } else { 2 });
        let done = done?;
        settled.map(|_| done)
    }

    fn visit_corners(&mut self, corners: &[[i64; A]]) -> Result<ManualTaskDone, ManualTaskError> {
        for (index, &to) in corners.iter().enumerate() {
            let from = self.card.status().counts;
            let request = match index {
                0 => JogRequest::Approach { from, to },
                _ => JogRequest::Straight { from, to, speed: JogSpeed::Full },
            };
            let ended = if from == to { ManualMoveEnd::Completed } else { self.play_move(request)? };
            // What is left of a move is discarded.
            self.begin()?;
            match ended {
                ManualMoveEnd::Completed => {}
                ManualMoveEnd::Stopped => return Ok(ManualTaskDone::Stopped),
                ManualMoveEnd::NotPlanned => {
                    return Err(NumberedError::new("E2161", "the frame cannot be planned", "a smaller one").into());
                }
            }
            if index == 0 {
                self.switch_pointer(true);
            }
        }
        Ok(ManualTaskDone::Completed { cut_short: false })
    }

    /// Switches the output of the pointer, if it has one. A card without that output switches nothing.
    fn switch_pointer(&mut self, on: bool) {
        if let Some(channel) = self.machine.setting_up.pointer_output {
            let _ = self.card.send(HostCommand::ManualOutput(OutputChange { channel, value: i32::from(on) }));
        }
    }

    fn clear(&mut self) -> Result<ManualTaskDone, ManualTaskError> {
        let Some(alarm) = self.card.status().alarm else { return Ok(ManualTaskDone::Completed { cut_short: false }) };
        // A rejection by the card shows below.
        let _ = self.card.send(HostCommand::ClearAlarm);
        for _ in 0..RESPONSE_PERIODS {
            if self.card.run_period().is_ok_and(|status| status.alarm.is_none()) {
                return Ok(ManualTaskDone::Completed { cut_short: false });
            }
        }
        Err(ManualTaskError::Card(CardError::Latched(alarm)))
    }

    pub(super) fn begin(&mut self) -> Result<(), ManualTaskError> {
        Ok(begin_path(self.card).map_err(CardError::from)?)
    }

    fn run_periods(&mut self, periods: u32) -> Result<ManualTaskDone, ManualTaskError> {
        for _ in 0..periods {
            self.run_period()?;
        }
        Ok(ManualTaskDone::Completed { cut_short: false })
    }

    /// Runs one control period: the operator's commands, the card, and telemetry.
    pub(super) fn run_period(&mut self) -> Result<(), ManualTaskError> {
        let period = self.card.status().period;
        while let Some(command) = self.operators.next_command(period, 0) {
            self.emit(EventKind::Operator(command));
            match command {
                OperatorCommand::Stop | OperatorCommand::Hold | OperatorCommand::Pause | OperatorCommand::CutterOff => {
                    self.stopped = true
                }
                _ => self.emit(EventKind::CommandRejected(CommandError::NotNow(
                    "an axis is being moved manually: stop it first",
                ))),
            }
        }
        let status = *self.card.run_period().map_err(CardError::from)?;
        self.telemetry.send_output_changes(&status.outputs);
        self.telemetry.send(Telemetry::Period(PeriodRecord {
            off_path: true,
            mode: Mode::Run,
            ..PeriodRecord::from_status(&status)
        }));
        match status.alarm {
            Some(alarm) if status.at_rest => Err(self.alarm(alarm)),
            _ => Ok(()),
        }
    }

    fn alarm(&mut self, alarm: Alarm) -> ManualTaskError {
        self.emit(EventKind::Alarm(CardError::Latched(alarm)));
        ManualTaskError::Card(CardError::Latched(alarm))
    }

    fn emit_jogged(&mut self, index: usize, from: i64, cut_short: bool) {
        let axis = &self.machine.axes[index];
        let mm = axis.mm_of(self.card.status().counts[index] - from);
        let step = DncStep::Jogged { axis: axis.name, mm, cut_short, off: AxisCounts::default() };
        self.emit(EventKind::Dnc(DncEvent { step, flags: DncFlags::default() }));
    }

    pub(super) fn emit(&mut self, kind: EventKind) {
        let CardStatus { period, place, .. } = *self.card.status();
        let time_s = period as f64 * self.machine.period_s();
        self.telemetry.send(Telemetry::Event(Event { period, time_s, place, line: 0, kind }));
    }
}

fn no_home(what: String) -> NumberedError {
    NumberedError::new(
        "E2161",
        what,
        "name its switch in the machine file: `home` of the axis, and the input it is wired to",
    )
}
