//! Fake machine for tests of the screen: it plays a program's records without a card, period by period.
//!
//! Invariant: modes and the return path are those of the core; only rates and outputs are simulated here.

use std::io::Cursor;
use std::sync::{Arc, Mutex};

use retrace_config::MachineConfig;
use retrace_controller::{
    BlockDecoder, CommandError, CommandSources, DecodedBlock, DifferingOutput, DifferingOutputs, Event, EventKind,
    JobOptions, JobStart, ManualTask, Observer, OperatorCommand, PeriodRecord, RunMode, ScriptPlayer, Telemetry,
    interpreter_setup, run_job,
};
use retrace_core::mode::{Mode, ModeCommand, ModeController, MotionFacts as ModeFacts};
use retrace_core::{Distance, Place, Rate, RecordIndex};
use retrace_gcode::{CanonStep, Program, Progress};
use retrace_hal_sim::{Clock, PlantSettings, SimCard};
use retrace_journal::{HoldReason, JournalConfig};
use retrace_link::{AnalogInputs, HeightState, OutputChange, PathStart, SpindleStatus};

use crate::model::{ScreenModel, ScreenStage};
use crate::model_observer::{ModelObserver, lock_model};
use crate::preview::Preview;
use crate::program_facts::{Planned, ProgramCheck, ProgramFacts};
use crate::ui_command::UiCommand;

/// Maximum change of the rate in a period.
const SLOPE: Rate = Rate::from_units(Rate::ONE.units() / 150);

/// Program text, decoded for the machine.
pub(crate) struct Decoder(Program<Cursor<Vec<u8>>>);

impl Decoder {
    pub(crate) fn new(machine: &MachineConfig, text: &str) -> Self {
        Self(Program::new(Cursor::new(text.as_bytes().to_vec()), interpreter_setup(machine)))
    }
}

impl BlockDecoder for Decoder {
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        match self.0.advance(steps) {
            Progress::Line => DecodedBlock::Block,
            Progress::End => DecodedBlock::End,
            Progress::BlockError => DecodedBlock::BlockError("the program has errors".into()),
        }
    }
}

/// Facts of a program before it runs.
pub(crate) fn facts(machine: &MachineConfig, name: &str, text: &str, path: &FakePath) -> ProgramFacts {
    ProgramFacts {
        planned: Planned::Known(path.records.len() as f64 * machine.period_s()),
        check: ProgramCheck::Ready,
        preview: Preview::of(machine, &mut Decoder::new(machine, text)),
        ..ProgramFacts::of(machine, name, text)
    }
}

/// Records of a program, period by period.
#[derive(Debug, Default)]
pub(crate) struct FakePath {
    /// Line and increments of each record.
    records: Vec<(u32, [i32; 9])>,
    /// Outputs that change before a record.
    changes: Vec<(u32, OutputChange)>,
}

impl FakePath {
    /// Runs the program once, at full speed.
    pub(crate) fn of(machine: &MachineConfig, text: &str) -> Self {
        let mut path = Self::default();
        let settings = machine.card_settings(PathStart::at(RecordIndex::new(0)));
        if let Ok(card) = SimCard::<9>::with_machine(settings, &PlantSettings::default(), Clock::Virtual) {
            let operators = CommandSources::from_script(ScriptPlayer::new(Vec::new(), machine.period_us));
            let run_mode = RunMode { wall_time: false, operator: false, real_time: false };
            let job_options =
                JobOptions { start: JobStart::First, commands: operators, run_mode, journal: JournalConfig::default() };
            // A program that cannot run leaves it empty.
            let _ = run_job::<9, _>(machine, Decoder::new(machine, text), job_options, card, &mut path);
        }
        path
    }
}

impl Observer<9> for FakePath {
    fn on_telemetry(&mut self, telemetry: &Telemetry<9>) {
        match telemetry {
            Telemetry::Output(change) => self.changes.push((self.records.len() as u32, *change)),
            Telemetry::Period(period) if period.rate != Rate::ZERO => {
                self.records.push((period.line, period.increments))
            }
            _ => {}
        }
    }
}

/// Fake machine.
pub(crate) struct FakeMachine {
    path: FakePath,
    model: Arc<Mutex<ScreenModel>>,
    live: ModelObserver,
    operation: ModeController,
    period_s: f64,
    period: u64,
    cursor: Distance,
    reached: RecordIndex,
    rate: Rate,
    counts: [i64; 9],
    outputs: Vec<i32>,
    wheel: i32,
    paused: bool,
}

impl FakeMachine {
    /// Machine with these records, for this model.
    pub(crate) fn new(path: FakePath, model: Arc<Mutex<ScreenModel>>, period_s: f64) -> Self {
        let live = ModelObserver::new(Arc::clone(&model));
        let outputs = vec![0; retrace_link::channel::COUNT];
        Self {
            path,
            model,
            live,
            operation: ModeController::default(),
            period_s,
            period: 0,
            cursor: Distance::ZERO,
            reached: RecordIndex::new(0),
            rate: Rate::ZERO,
            counts: [0; 9],
            outputs,
            wheel: 0,
            paused: false,
        }
    }

    /// Executes a command of the operator.
    pub(crate) fn handle_command(&mut self, command: &UiCommand) {
        match command {
            UiCommand::Start => {
                self.event(EventKind::Started);
            }
            UiCommand::Turn(counts) => self.wheel += counts,
            UiCommand::Task(ManualTask::ClearAlarm) => lock_model(&self.model).clear_alarm(),
            UiCommand::Task(ManualTask::Jog { axis, mm }) => self.jog(*axis, *mm),
            UiCommand::Task(task) => self.event(EventKind::Message(format!("{task:?}"))),
            UiCommand::Job(command) => {
                self.event(EventKind::Operator(*command));
                if let Err(why) = self.apply_command(*command) {
                    self.event(EventKind::CommandRejected(why));
                }
            }
            UiCommand::DryRun(_)
            | UiCommand::SetTables(_)
            | UiCommand::CutterOff
            | UiCommand::OptionalStop(_)
            | UiCommand::SetUp
            | UiCommand::Frame(_)
            | UiCommand::SheetPoint
            | UiCommand::AlignSheet
            | UiCommand::ForgetSheet
            | UiCommand::Load(_)
            | UiCommand::Answer(_)
            | UiCommand::CloseRefusal
            | UiCommand::StartContour(_)
            | UiCommand::ConsumablesChanged
            | UiCommand::SkipContour { .. }
            | UiCommand::StartLine(_)
            | UiCommand::StartShopJob { .. }
            | UiCommand::EndSeries
            | UiCommand::ResumeJob(_)
            | UiCommand::JogHeld { .. }
            | UiCommand::JogReleased
            | UiCommand::Quit => {}
        }
    }

    /// Executes a command that needs no mode. Returns whether it was one.
    fn apply_manual(&mut self, command: OperatorCommand) -> bool {
        match command {
            OperatorCommand::Output { number, on } => self.switch(number, i32::from(on)),
            OperatorCommand::SpindleStop => self.switch(retrace_link::channel::SPINDLE, 0),
            OperatorCommand::SpindleStart => self.switch(retrace_link::channel::SPINDLE, 1),
            OperatorCommand::Jog { axis, mm } => self.jog(axis, mm),
            OperatorCommand::Stop => lock_model(&self.model).end("stopped by the operator"),
            OperatorCommand::Online | OperatorCommand::Single => {}
            _ => return false,
        }
        true
    }

    fn apply_command(&mut self, command: OperatorCommand) -> Result<(), CommandError> {
        if self.apply_manual(command) {
            return Ok(());
        }
        let order = match command {
            OperatorCommand::Hold => ModeCommand::Hold,
            OperatorCommand::Pause => {
                self.paused = true;
                ModeCommand::Hold
            }
            OperatorCommand::Resume | OperatorCommand::CycleStart => {
                self.paused = false;
                ModeCommand::Resume
            }
            OperatorCommand::Reverse(rate) => ModeCommand::Reverse(rate),
            OperatorCommand::Forward(rate) => ModeCommand::Forward(rate),
            OperatorCommand::Override(rate) => ModeCommand::Override(rate),
            OperatorCommand::RapidOverride(rate) => ModeCommand::RapidOverride(rate),
            OperatorCommand::Wheel { .. } => ModeCommand::Wheel,
            OperatorCommand::Leave { ask } => ModeCommand::Leave { ask },
            OperatorCommand::Confirm => ModeCommand::Confirm,
            _ => return Err(CommandError::NotNow("the fake machine does not support that")),
        };
        let mode = self.operation.mode();
        self.operation.apply(order)?;
        if self.operation.mode() != mode {
            self.wheel = 0;
        }
        Ok(())
    }

    fn jog(&mut self, axis: char, mm: f64) {
        let facts = Arc::clone(&lock_model(&self.model).facts);
        if let Some(n) = facts.axes.iter().position(|a| a.letter == axis) {
            self.counts[n] += (mm * facts.axes[n].pulses_per_mm).round() as i64;
        }
    }

    fn switch(&mut self, channel: u8, value: i32) {
        self.outputs[usize::from(channel)] = value;
        Observer::<9>::on_telemetry(&mut self.live, &Telemetry::Output(OutputChange { channel, value }));
    }

    /// Outputs that the program expects at the furthest place.
    fn expected(&self) -> Vec<i32> {
        let mut expected = vec![0; self.outputs.len()];
        for (_, change) in self.path.changes.iter().filter(|(place, _)| *place < self.reached.number()) {
            expected[usize::from(change.channel)] = change.value;
        }
        expected
    }

    fn event(&mut self, kind: EventKind) {
        let place = Place::start_of(RecordIndex::new(0)).moved(self.cursor);
        let line = self.path.records.get(place.record.number() as usize).map_or(0, |record| record.0);
        let event = Event { period: self.period, time_s: self.period as f64 * self.period_s, place, line, kind };
        Observer::<9>::on_telemetry(&mut self.live, &Telemetry::Event(event));
    }

    /// Executes a control period.
    pub(crate) fn step(&mut self) {
        self.period += 1;
        let is_job = lock_model(&self.model).stage == ScreenStage::Job;
        let is_way_on = !matches!(self.operation.mode(), Mode::Run | Mode::Reverse | Mode::Wheel);
        let expected = if is_way_on { self.expected() } else { Vec::new() };
        let facts = ModeFacts {
            place: Place::start_of(RecordIndex::new(0)).moved(self.cursor),
            at_rest: self.rate == Rate::ZERO,
            reached: self.reached,
            oldest: RecordIndex::new(0),
            outputs_agree: expected.is_empty() || expected == self.outputs,
            wheel: Rate::percent(10 * i64::from(self.wheel.clamp(-10, 10))),
        };
        if self.period.is_multiple_of(10) {
            self.wheel -= self.wheel.signum() * (self.wheel.abs() / 10).max(1).min(self.wheel.abs());
        }
        let demand = self.operation.advance_period(&facts);
        match demand.notice {
            Some(retrace_core::mode::OperatorNotice::HistoryStart) => self.event(EventKind::HistoryStartReached),
            Some(retrace_core::mode::OperatorNotice::RunResumed) => self.event(EventKind::RunResumed),
            Some(retrace_core::mode::OperatorNotice::OutputsDiffer) => {
                let differ = (0..expected.len()).filter(|&c| expected[c] != self.outputs[c]);
                let mut differ = differ.map(|c| DifferingOutput::new(c as u8, self.outputs[c], expected[c]));
                let some = DifferingOutputs::first(&mut differ);
                self.event(EventKind::OutputsDiffer(some));
            }
            None => {}
        }
        if demand.restore_outputs {
            for (channel, value) in expected.into_iter().enumerate() {
                self.switch(channel as u8, value);
            }
        }
        let target = if is_job { demand.target.feed } else { Rate::ZERO };
        self.rate += (target - self.rate).clamp(-SLOPE, SLOPE);
        let increments = self.advance();
        self.publish(increments);
        if is_job && self.reached.number() as usize == self.path.records.len() && self.operation.mode() == Mode::Run {
            lock_model(&self.model).end("completed");
        }
    }

    /// Moves along the records. Returns the increments.
    fn advance(&mut self) -> [i32; 9] {
        let end = Distance::records(self.path.records.len() as i64);
        let furthest =
            if self.operation.mode() == Mode::Run { end } else { Distance::records(self.reached.number().into()) };
        let from = self.cursor;
        let mut to = (from + self.rate.over(1)).clamp(Distance::ZERO, furthest.max(from));
        // Rest is at a record boundary there, as on the real card.
        if to == from
            && Place::start_of(RecordIndex::new(0)).moved(from).fraction != 0
            && self.operation.mode() != Mode::Run
            && furthest - from < Distance::RECORD
        {
            to = furthest;
        }
        if to == from {
            self.rate = Rate::ZERO;
        }
        self.cursor = to;
        let whole_records = |distance: Distance| (distance.units() >> 32) as usize;
        let (from, to) = (whole_records(from), whole_records(to));
        let mut sum = [0; 9];
        let sign = if to < from { -1 } else { 1 };
        for (_, record) in self.path.records.get(from.min(to)..from.max(to)).unwrap_or_default() {
            for i in 0..9 {
                sum[i] += sign * record[i];
            }
        }
        for (count, &step) in self.counts.iter_mut().zip(&sum) {
            *count += i64::from(step);
        }
        let reached = Place::start_of(RecordIndex::new(0)).moved(self.cursor).boundary_ahead();
        while self.reached.is_before(reached) {
            self.reached += 1;
            let due: Vec<OutputChange> = self
                .path
                .changes
                .iter()
                .filter(|(p, _)| RecordIndex::new(*p + 1) == self.reached)
                .map(|(_, c)| *c)
                .collect();
            for change in due {
                self.switch(change.channel, change.value);
                self.event(EventKind::OutputChanged(change.channel, change.value));
            }
        }
        sum
    }

    fn publish(&mut self, increments: [i32; 9]) {
        let place = Place::start_of(RecordIndex::new(0)).moved(self.cursor);
        let planned = (self.reached.number() + 500).min(self.path.records.len() as u32);
        let standing = match (self.paused && self.rate == Rate::ZERO, self.operation.is_held()) {
            (true, _) => HoldReason::Paused,
            (_, true) => HoldReason::Hold,
            _ => HoldReason::None,
        };
        let period = PeriodRecord {
            period: self.period,
            place,
            reached: self.reached,
            oldest: RecordIndex::new(0),
            planned: RecordIndex::new(planned),
            window: [place.record.number().saturating_sub(200), (place.record.number() + 250).min(planned)]
                .map(RecordIndex::new),
            rate: self.rate,
            line: self.path.records.get(place.record.number() as usize).map_or(0, |record| record.0),
            increments,
            counts: self.counts,
            layer: 0,
            executed: 0,
            at_rest: self.rate == Rate::ZERO,
            starved: false,
            inputs: 0,
            mode: self.operation.mode(),
            hold_reason: standing,
            override_rate: self.operation.override_rate(),
            rapid_override: self.operation.rapid_override(),
            speed_override: Rate::ONE,
            override_is_off: false,
            off_path: lock_model(&self.model).stage == ScreenStage::Setup,
            contour: 0,
            cut_um: 0,
            cut_from: None,
            spindle: SpindleStatus::default(),
            height: HeightState::Off,
            analog_inputs: AnalogInputs::default(),
            is_probing: false,
        };
        self.live.on_telemetry(&Telemetry::Period(period));
    }
}
