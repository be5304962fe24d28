//! Screen model: a snapshot of the machine, independent of threads and of the number of axes.
//!
//! Invariant: its size is bounded however long the job is. The screen is a function of this model and of the key state.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use retrace_controller::{ContourStates, CutterState, DifferingOutput, PlannedPath};
use retrace_core::mode::Mode;
use retrace_core::{Place, RecordIndex};
use retrace_journal::HoldReason;
use retrace_link::{AnalogInputs, HeightState, SpindleStatus, channel};

use crate::message::{self, Message};
use crate::path_length::PathLengths;
use crate::program_facts::ProgramFacts;
use crate::shop_job_table::ShopJobTable;
use crate::trail::Trail;
use crate::work_tables::WorkTables;

/// Stage of the job.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ScreenStage {
    /// No job runs: setup.
    #[default]
    Setup,
    /// An interrupted job is about to be resumed: its breakpoint is being located, or the operator is asked.
    Resuming,
    /// A job runs.
    Job,
    /// The job has ended; how, in words.
    Ended(String),
}

/// Alarm as the screen shows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AlarmShown {
    /// Error number.
    pub number: String,
    /// Cause.
    pub cause: String,
    /// Remedy.
    pub remedy: String,
    /// Whether it is a refused program and not an alarm of the machine.
    pub is_refusal: bool,
}

/// Yes-or-no question.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Question {
    /// Question in a few words.
    pub title: String,
    /// Facts for the decision.
    pub lines: Vec<String>,
}

/// Order of the operator that was passed on and then not carried out.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rejection {
    /// Number of rejections so far.
    pub count: u64,
    /// Error number, if it has one.
    pub number: Option<&'static str>,
    /// Cause.
    pub cause: String,
    /// Remedy; empty where the cause names it.
    pub remedy: String,
}

/// Homing state of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AxisHoming {
    /// The axis has no home switch, or the card needs none.
    #[default]
    NotNeeded,
    /// Homed since the card was switched on.
    Homed,
    /// Not homed since the card was switched on.
    NotHomed,
}

/// Progress of a pause (DNC-1 … DNC-6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pause {
    /// Direction of the spindle at the breakpoint; 0 is stopped.
    pub spindle: i32,
    /// Whether the spindle was stopped (DNC-3).
    pub stopped: bool,
    /// Whether the spindle was restarted (DNC-4).
    pub started: bool,
    /// Whether on-line mode was restored (DNC-5).
    pub online: bool,
}

/// Modal state in force at the cursor, as far as it was reported.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Active {
    /// Active G and M codes.
    pub modal: String,
    /// Programmed feed, mm/min.
    pub feed: Option<f64>,
    /// Tool number.
    pub tool: Option<i32>,
    /// Kind of the current motion.
    pub motion: MotionKind,
}

/// Kind of motion that a block commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotionKind {
    /// At the programmed feed.
    #[default]
    Feed,
    /// A rapid move.
    Rapid,
    /// Canned cycle, some of whose moves are rapid.
    Cycle,
}

/// Time that the screen takes to draw itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Redraw {
    /// Mean, ms.
    pub mean_ms: f64,
    /// Maximum, ms.
    pub max_ms: f64,
    /// Number of redraws.
    pub count: u64,
}

/// Time remaining.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeRemaining {
    /// Seconds of motion.
    pub seconds: f64,
    /// Whether it is the planned time; with an override it is an estimate.
    pub exact: bool,
}

/// Model of the screen.
#[derive(Clone, Debug)]
pub struct ScreenModel {
    /// Facts that do not change while a program is loaded.
    pub facts: Arc<ProgramFacts>,
    /// Stage of the job.
    pub stage: ScreenStage,
    /// Whether every axis is homed. No program moves otherwise.
    pub homed: bool,
    /// Homing state of each axis.
    pub homing: Vec<AxisHoming>,
    /// Control periods since the card started.
    pub period: u64,
    /// Period in which the job began.
    pub began: u64,
    /// Periods of the job in which its path was retraced, by whatever means, and those in which it was held.
    pub retraced_periods: u64,
    /// Periods of the job in which a hold, a program stop or single block held it.
    pub held_periods: u64,
    /// Period in which the program ended, or the job before it; the job's clock stops there.
    pub ended: Option<u64>,
    /// Counts of the axes, pulses: path and layer.
    pub counts: Vec<i64>,
    /// Layer in the count of the tool axis, pulses.
    pub layer: i64,
    /// Machine position of the sheet on the tool axis as it was sensed last, mm, where it is known.
    pub sheet_mm: Option<f64>,
    /// Whether the tool is down at the sheet for a cut: neither the end of a contour nor anything else has lifted it.
    pub tool_is_down: bool,
    /// State of height control.
    pub height: HeightState,
    /// Readings of the analog inputs.
    pub analog_inputs: AnalogInputs,
    /// Machine position of the work zero, mm (degrees).
    pub work_zero_mm: Vec<f64>,
    /// Angle by which work X and Y are turned from those of the machine, degrees counter-clockwise.
    pub work_rotation_deg: f64,
    /// Offset of the path along each axis from tool lengths that were entered, mm.
    pub moved_mm: Vec<f64>,
    /// Place of the cursor.
    pub place: Place,
    /// Record of the furthest place executed.
    pub reached: RecordIndex,
    /// Record of the oldest place in the history.
    pub oldest: RecordIndex,
    /// Place after the last planned record.
    pub planned: RecordIndex,
    /// Records that the card holds: first, and after the last.
    pub window: [RecordIndex; 2],
    /// Rate; 1 is as recorded.
    pub rate: f64,
    /// Speed along the path, mm/min.
    pub feed_mm_min: f64,
    /// The spindle as the card measures it.
    pub spindle: SpindleStatus,
    /// The manual task that is being carried out; the next one is refused until it is done.
    pub manual_task: Option<&'static str>,
    /// Result of the last manual task, until the next one; empty where it has none.
    pub manual_result: String,
    /// Wear of the consumables of each cutter, a line for each.
    pub consumables: Vec<String>,
    /// Jobs of the shop; `None` where the command has none.
    pub shop_jobs: Option<Arc<ShopJobTable>>,
    /// Points on the edge of the sheet, in mm of the machine's X and Y: none, one, or two that are an edge.
    pub sheet_points: Vec<[f64; 2]>,
    /// Whether the axes follow the spindle while it is turned by hand.
    pub follows_spindle: bool,
    /// Requested feed override; 1 is 100 %.
    pub override_rate: f64,
    /// Rapid override; 1 is 100 %.
    pub rapid_override: f64,
    /// Speed override of the spindle, 0.1 … 2.
    pub speed_override: f64,
    /// Whether the program has switched both off where the machine is (M49).
    pub override_is_off: bool,
    /// Override that the plan permits, 1 or more.
    pub override_planned: f64,
    /// Program line at the cursor.
    pub line: u32,
    /// Program line at the furthest place.
    pub reached_line: u32,
    /// Mode of operation.
    pub mode: Mode,
    /// Why the machine holds in normal run.
    pub hold_reason: HoldReason,
    /// Whether the cursor is at rest.
    pub at_rest: bool,
    /// Whether the rate was reduced for lack of records.
    pub starved: bool,
    /// Whether the machine is off the path.
    pub off_path: bool,
    /// Whether single block is on.
    pub single: bool,
    /// Instruction in execution.
    pub switching: Option<&'static str>,
    /// Code of the program stop that is waited at.
    pub program_stop: Option<&'static str>,
    /// Inputs that are active, as a bit mask.
    pub inputs: u16,
    /// Values of the output channels that were reported.
    pub outputs: BTreeMap<u8, i32>,
    /// Outputs that the program expects at this place, as far as they were reported; a missing one is 0.
    pub program_outputs: BTreeMap<u8, i32>,
    /// Whether M1 stops.
    pub optional_stop: bool,
    /// Whether the cutters are kept off.
    pub dry_run: bool,
    /// Tool for a manual tool change; 0 removes the tool.
    pub tool_change: Option<i32>,
    /// Whether the cutter went off where it was to cut: the program resumes only with it on.
    pub cutter_is_off: bool,
    /// State of each cutter by the channel that fires it, with the number of its contour; off where none was reported.
    pub cutter_states: BTreeMap<u8, (CutterState, u32)>,
    /// Period in which an output was switched on, of those that are on.
    pub on_since: BTreeMap<u8, u64>,
    /// Why a cutter went off last, by the channel that fires it.
    pub cutter_off_reasons: BTreeMap<u8, &'static str>,
    /// Program line in which an interrupted cut ends.
    pub cut_end_line: Option<u32>,
    /// Output of the cutter that was lost in the cut, until it is started again.
    pub lost_cutter: Option<u8>,
    /// Number of times that an interrupted cut of this job was continued.
    pub restarts: u32,
    /// Whether the key that held the jog was let go, which ends it: no hold by the operator.
    pub is_jog_released: bool,
    /// Whether the machine goes back to continue an interrupted cut.
    pub recovering: bool,
    /// Instruction that a restart executes again.
    pub restarting: Option<&'static str>,
    /// States of the contours of the job.
    pub contours: ContourStates,
    /// Whether the machine is at rest where the program switched the cutter, which is on manually.
    pub at_cutter_boundary: bool,
    /// Modal state.
    pub active: Active,
    /// Offsets and tools that are in force while no job runs.
    pub tables: Arc<WorkTables>,
    /// Active alarm.
    pub alarm: Option<AlarmShown>,
    /// Outputs that differ from what the program expects.
    pub differing_outputs: Vec<DifferingOutput>,
    /// Progress of a pause.
    pub pause: Option<Pause>,
    /// Source that the program is awaited from, and the period of that report, one second after the wait began.
    pub waiting: Option<(String, u64)>,
    /// Whether the operator has stopped the job, whose end is still being recorded.
    pub is_stopping: bool,
    /// The last order that was rejected after it had been passed on.
    pub rejection: Arc<Rejection>,
    /// Open question.
    pub question: Option<Question>,
    /// Of a resumed job: the oldest record in its history, and the length of the path from there, mm.
    pub history_before: Option<(RecordIndex, f64)>,
    /// Latest messages, the newest last.
    pub messages: VecDeque<Message>,
    /// Path of the tool.
    pub trail: Trail,
    /// Path as it was executed, of a job whose planned path is not known.
    pub executed_path: Option<Arc<PlannedPath>>,
    /// Lengths along the path.
    pub lengths: PathLengths,
    /// Number of underruns of the look-ahead.
    pub underruns: u32,
    /// Time that drawing takes.
    pub redraw: Redraw,
    /// Whether the screen is to be closed.
    pub is_closed: bool,
    /// Counter of changes, so that nothing is drawn twice.
    pub changes: u64,
}

impl ScreenModel {
    /// Model of a machine at rest, without any report yet.
    #[must_use]
    pub fn new(facts: Arc<ProgramFacts>) -> Self {
        let (axes, first) = (facts.axes.len(), facts.first_place);
        Self {
            stage: ScreenStage::Setup,
            homed: true,
            homing: vec![AxisHoming::default(); axes],
            period: 0,
            began: 0,
            retraced_periods: 0,
            held_periods: 0,
            ended: None,
            counts: vec![0; axes],
            layer: 0,
            sheet_mm: None,
            tool_is_down: false,
            height: HeightState::Off,
            analog_inputs: AnalogInputs::default(),
            work_zero_mm: vec![0.0; axes],
            work_rotation_deg: 0.0,
            moved_mm: vec![0.0; axes],
            place: Place::start_of(first),
            reached: first,
            oldest: first,
            planned: first,
            window: [first; 2],
            rate: 0.0,
            feed_mm_min: 0.0,
            spindle: SpindleStatus::default(),
            manual_task: None,
            manual_result: String::new(),
            consumables: Vec::new(),
            shop_jobs: None,
            sheet_points: Vec::new(),
            follows_spindle: false,
            override_rate: 1.0,
            rapid_override: 1.0,
            speed_override: 1.0,
            override_is_off: false,
            override_planned: 1.0,
            line: 0,
            reached_line: 0,
            mode: Mode::Run,
            hold_reason: HoldReason::None,
            at_rest: true,
            starved: false,
            off_path: false,
            single: false,
            switching: None,
            program_stop: None,
            inputs: 0,
            outputs: BTreeMap::new(),
            program_outputs: BTreeMap::new(),
            optional_stop: false,
            dry_run: false,
            tool_change: None,
            cutter_states: BTreeMap::new(),
            on_since: BTreeMap::new(),
            cutter_off_reasons: BTreeMap::new(),
            cutter_is_off: false,
            cut_end_line: None,
            lost_cutter: None,
            restarts: 0,
            is_jog_released: false,
            recovering: false,
            restarting: None,
            contours: ContourStates::default(),
            at_cutter_boundary: false,
            active: Active::default(),
            tables: Arc::default(),
            alarm: None,
            differing_outputs: Vec::new(),
            pause: None,
            waiting: None,
            is_stopping: false,
            rejection: Arc::default(),
            question: None,
            history_before: None,
            messages: VecDeque::new(),
            trail: Trail::default(),
            executed_path: None,
            lengths: PathLengths::from(Place::start_of(first)),
            underruns: 0,
            redraw: Redraw::default(),
            is_closed: false,
            changes: 0,
            facts,
        }
    }

    /// Machine position of an axis, mm (degrees).
    #[must_use]
    pub fn machine_mm(&self, axis: usize) -> f64 {
        let pulses = self.counts.get(axis).copied().unwrap_or(0);
        self.facts.axes.get(axis).map_or(0.0, |facts| pulses as f64 / facts.pulses_per_mm)
    }

    /// Work position of an axis, mm (degrees).
    #[must_use]
    pub fn work_mm(&self, axis: usize) -> f64 {
        let from_zero = |axis: usize| self.machine_mm(axis) - self.work_zero_mm.get(axis).copied().unwrap_or(0.0);
        let [Some(x), Some(y), _] = self.facts.space() else { return from_zero(axis) };
        if self.work_rotation_deg == 0.0 || axis != x && axis != y {
            return from_zero(axis);
        }
        let (sin, cos) = self.work_rotation_deg.to_radians().sin_cos();
        let (along_x, along_y) = (from_zero(x), from_zero(y));
        if axis == x { along_x * cos + along_y * sin } else { along_y * cos - along_x * sin }
    }

    /// Position of an axis on the path, without the layer, mm (degrees).
    fn path_mm(&self, axis: usize) -> f64 {
        let layer = if self.facts.layer_axis == Some(axis) { self.layer as f64 } else { 0.0 };
        self.machine_mm(axis) - self.facts.axes.get(axis).map_or(0.0, |facts| layer / facts.pulses_per_mm)
    }

    /// Distance of an axis to the end of the block, mm (degrees), where it is known.
    #[must_use]
    pub fn to_go_mm(&self, axis: usize) -> Option<f64> {
        let end = self.facts.preview.end_of(self.line)?;
        let end = f64::from(*end.get(axis)?) + self.moved_mm.get(axis).copied().unwrap_or(0.0);
        (self.stage == ScreenStage::Job && !self.off_path).then_some(end - self.path_mm(axis))
    }

    /// Position in the drawing: X, Y, Z, mm.
    #[must_use]
    pub fn in_space(&self) -> [f32; 3] {
        self.facts.space().map(|axis| axis.map_or(0.0, |i| self.machine_mm(i) as f32))
    }

    /// Length of the history behind the cursor: seconds at 100 %, and mm.
    #[must_use]
    pub fn history(&self) -> (f64, f64) {
        let records = f64::from(records_between(self.oldest, self.place.record));
        let mm = self.lengths.length_at(self.place) - self.lengths.length_at(Place::start_of(self.oldest));
        (records * self.facts.period_s, mm.max(0.0))
    }

    /// Distance from the furthest place back to the cursor, mm.
    #[must_use]
    pub fn back_mm(&self) -> f64 {
        (self.lengths.total_mm() - self.lengths.length_at(self.place)).max(0.0)
    }

    /// Seconds of motion planned ahead of the cursor.
    #[must_use]
    pub fn ahead_s(&self) -> f64 {
        f64::from(records_between(self.place.record, self.planned)) * self.facts.period_s
    }

    /// Source that the machine waits for, and for how many seconds.
    #[must_use]
    pub fn stalled_source(&self) -> Option<(&str, f64)> {
        let (source, reported) = self.waiting.as_ref()?;
        Some((source, 1.0 + self.period.saturating_sub(*reported) as f64 * self.facts.period_s))
    }

    /// Whether the machine moves in rapid. In a canned cycle: whether it is faster than the programmed feed.
    #[must_use]
    pub fn is_rapid(&self) -> bool {
        let fastest = self.active.feed.unwrap_or(0.0) * self.override_rate.max(1.0) * 1.02;
        !self.at_rest
            && !self.off_path
            && match self.active.motion {
                MotionKind::Rapid => true,
                MotionKind::Cycle => self.feed_mm_min > fastest,
                MotionKind::Feed => false,
            }
    }

    /// Machine time of the job, up to the end of its program, s.
    #[must_use]
    pub fn run_s(&self) -> f64 {
        self.ended.unwrap_or(self.period).saturating_sub(self.began) as f64 * self.facts.period_s
    }

    /// Counts the periods since the last look at a job, in the mode in which they were spent.
    pub(crate) fn count_periods(&mut self, mode: Mode, hold_reason: HoldReason, periods: u64) {
        if self.stage != ScreenStage::Job {
            return;
        }
        if mode != Mode::Run {
            self.retraced_periods += periods;
        } else if matches!(hold_reason, HoldReason::Hold | HoldReason::ProgramStop | HoldReason::SingleBlock) {
            self.held_periods += periods;
        }
    }

    /// Time remaining, where it is known.
    #[must_use]
    pub fn time_remaining(&self) -> Option<TimeRemaining> {
        let executed = f64::from(records_between(self.facts.first_place, self.reached)) * self.facts.period_s;
        let back = f64::from(records_between(self.place.record, self.reached)) * self.facts.period_s;
        let plan = (self.facts.planned.seconds()? - executed).max(0.0);
        let factor = self.override_rate.max(0.01);
        Some(TimeRemaining {
            seconds: (plan + back) / factor,
            exact: self.override_rate == 1.0 && self.rapid_override == 1.0,
        })
    }

    /// Value of an output channel; 0 where none was reported.
    #[must_use]
    pub fn output(&self, channel: u8) -> i32 {
        self.outputs.get(&channel).copied().unwrap_or(0)
    }

    /// Time in s for which an output has been on; 0 where it is off.
    #[must_use]
    pub fn on_s(&self, channel: u8) -> f64 {
        let periods = self.on_since.get(&channel).map_or(0, |&since| self.period.saturating_sub(since));
        periods as f64 * self.facts.period_s
    }

    /// Numbers of the digital outputs that are on.
    pub fn outputs_on(&self) -> impl Iterator<Item = u8> {
        self.outputs.iter().filter(|&(&c, &v)| usize::from(c) < channel::DIGITAL && v != 0).map(|(&c, _)| c)
    }

    /// Value of an output that the program expects at this place.
    #[must_use]
    pub fn program_output(&self, channel: u8) -> i32 {
        self.program_outputs.get(&channel).copied().unwrap_or(0)
    }

    /// Adds a message, or counts it where it repeats another.
    pub fn add_message(&mut self, time_s: f64, line: u32, text: impl Into<String>) {
        message::add(&mut self.messages, time_s, line, text.into());
        self.changes += 1;
    }

    /// Whether the machine is at rest at the end of the program, where reverse run is still possible.
    #[must_use]
    pub fn is_at_program_end(&self) -> bool {
        self.stage == ScreenStage::Job && self.hold_reason == HoldReason::Ended && self.mode == Mode::Run
    }

    /// Ends the job; `how` says how, in words. A tool that is down stays there.
    pub fn end(&mut self, how: &str) {
        self.ended.get_or_insert(self.period);
        let down = if self.tool_is_down { "the tool is DOWN: u, then PgUp raises it; " } else { "" };
        let how = format!("{down}{how}");
        (self.stage, self.pause) = (ScreenStage::Ended(how.clone()), None);
        self.is_stopping = false;
        self.differing_outputs.clear();
        self.add_message(self.period as f64 * self.facts.period_s, self.line, how);
    }

    /// Shows that an order was rejected after it had been passed on.
    pub fn reject(&mut self, number: Option<&'static str>, cause: impl Into<String>, remedy: impl Into<String>) {
        let count = self.rejection.count + 1;
        self.rejection = Arc::new(Rejection { count, number, cause: cause.into(), remedy: remedy.into() });
        self.changes += 1;
    }

    /// Opens a question, or closes it with `None`.
    pub fn ask(&mut self, question: Option<Question>) {
        self.question = question;
        self.changes += 1;
    }

    /// Closes the box of a refused program.
    pub fn close_refusal(&mut self) {
        if self.alarm.as_ref().is_some_and(|alarm| alarm.is_refusal) {
            self.clear_alarm();
        }
    }

    /// Removes the alarm.
    pub fn clear_alarm(&mut self) {
        self.alarm = None;
        self.changes += 1;
    }
}

/// Number of records from one place to a later one; 0 where it is not later.
fn records_between(from: RecordIndex, to: RecordIndex) -> u32 {
    if from.is_before(to) { to.since(from) } else { 0 }
}
