//! What the screen shows: one picture of the machine at a moment, with no thread and no axis count of its own.
//!
//! Invariant: bounded however long the job is; everything on the screen is a function of this and of what the operator is typing.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use retrace_controller::telemetry::HoldReason;
use retrace_core::Place;
use retrace_core::mode::Mode;
use retrace_core::place::is_before;
use retrace_link::channel;

use super::path_length::PathLengths;
use super::program_facts::ProgramFacts;
use super::trail::Trail;

/// Messages that are kept.
pub const MESSAGES: usize = 200;

/// Where a job is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ScreenStage {
    /// None runs: the machine is being set up.
    #[default]
    Setup,
    /// One that was interrupted is about to be resumed: its breakpoint is looked for, or the operator is asked.
    Resuming,
    /// One runs.
    Job,
    /// It has ended; how, in words.
    Ended(String),
}

/// An alarm.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AlarmShown {
    /// Its number.
    pub number: String,
    /// What is wrong.
    pub cause: String,
    /// What to do.
    pub remedy: String,
    /// The program is refused; the machine has nothing.
    pub is_refusal: bool,
}

/// A question that is answered with yes or no.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Question {
    /// In a few words.
    pub title: String,
    /// What there is to know before it is answered.
    pub lines: Vec<String>,
}

/// Something that was told.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Machine time, s.
    pub time_s: f64,
    /// Program line.
    pub line: u32,
    /// What.
    pub text: String,
    /// How often it was told, lately.
    pub times: u32,
}

/// A message that was told so few messages ago is counted, and not repeated.
const REPEATED_WITHIN: usize = 8;

/// Is an axis homed?
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AxisHoming {
    /// It has no home switch, or the card is one that needs none.
    #[default]
    NotNeeded,
    /// Since the card was switched on.
    Homed,
    /// Not since the card was switched on.
    NotHomed,
}

/// How far a pause has come (DNC-1 … DNC-6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pause {
    /// Which way the spindle turned at the breakpoint; 0: it stood.
    pub spindle: i32,
    /// It has been stopped (DNC-3).
    pub stopped: bool,
    /// It has been started again (DNC-4).
    pub started: bool,
    /// On-line mode is restored (DNC-5).
    pub online: bool,
}

/// The modal state that holds where the machine is, as far as it was told.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Active {
    /// The G and M codes in force.
    pub modal: String,
    /// Programmed feed, mm/min.
    pub feed: Option<f64>,
    /// Number of the tool.
    pub tool: Option<i32>,
    /// What moves along the path.
    pub motion: MotionKind,
}

/// What kind of motion a block commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotionKind {
    /// At the programmed feed.
    #[default]
    Feed,
    /// A rapid move.
    Rapid,
    /// A canned cycle: some of its moves are rapid.
    Cycle,
}

/// How long the screen takes to draw itself, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Redraw {
    /// The mean of all.
    pub mean_ms: f64,
    /// The longest.
    pub max_ms: f64,
    /// How many there were.
    pub count: u64,
}

/// Time that is left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeLeft {
    /// Seconds of motion, once it goes on.
    pub seconds: f64,
    /// Is it from the plan alone? With an override it is an estimate.
    pub exact: bool,
}

/// What the screen shows.
#[derive(Clone, Debug)]
pub struct ScreenModel {
    /// What does not change.
    pub facts: Arc<ProgramFacts>,
    /// Where the job is.
    pub stage: ScreenStage,
    /// Has every axis been homed? Where it has not, no program moves.
    pub homed: bool,
    /// Which axes have been homed, in the order of the axes.
    pub homing: Vec<AxisHoming>,
    /// Control periods since the card started, and when the job began.
    pub period: u64,
    /// The period in which the job began.
    pub began: u64,
    /// The period in which the program came to its end, or the job ended before; none while it goes on. The job's clock stops there.
    pub ended: Option<u64>,
    /// Counts of the axes, pulses.
    pub counts: Vec<i64>,
    /// Machine position of the work zero, mm (degrees).
    pub work_zero_mm: Vec<f64>,
    /// By how much the path was moved along each axis, because a tool length was entered, mm.
    pub moved_mm: Vec<f64>,
    /// Where the cursor stands.
    pub place: Place,
    /// The furthest place executed.
    pub reached: u32,
    /// The oldest place that can be gone back to.
    pub oldest: u32,
    /// Place behind the last record that is planned.
    pub planned: u32,
    /// What the card holds.
    pub window: [u32; 2],
    /// Rate that is run; 1 is as recorded.
    pub rate: f64,
    /// Speed along the path, mm/min.
    pub feed_mm_min: f64,
    /// The override asked for; 1 is 100 %.
    pub override_rate: f64,
    /// The rapid override; 1 is 100 %.
    pub rapid_override: f64,
    /// The override that is planned, 1 or more.
    pub override_planned: f64,
    /// Program line at the cursor.
    pub line: u32,
    /// Program line at the furthest place.
    pub reached_line: u32,
    /// The mode of operation.
    pub mode: Mode,
    /// Why it stands in normal run.
    pub standing: HoldReason,
    /// Does the cursor stand?
    pub at_rest: bool,
    /// Was the rate held down for want of records?
    pub short: bool,
    /// Is the machine off the path?
    pub off_path: bool,
    /// Is single block on?
    pub single: bool,
    /// The instruction that is being executed, if one is.
    pub switching: Option<&'static str>,
    /// Which inputs are active.
    pub inputs: u16,
    /// Output channels that were told.
    pub outputs: BTreeMap<u8, i32>,
    /// What the program has had the outputs at, at this place, as far as it was told; what is missing is 0.
    pub program_outputs: BTreeMap<u8, i32>,
    /// M1 stops.
    pub optional_stop: bool,
    /// The tool that is to be changed by hand; 0 for none at all.
    pub tool_change: Option<i32>,
    /// The cutter went out where it was to cut: the program goes on only with it.
    pub cutter_is_out: bool,
    /// It stands where the program switched the cutter, which is on by hand.
    pub at_cutter_boundary: bool,
    /// The modal state.
    pub active: Active,
    /// The alarm in force.
    pub alarm: Option<AlarmShown>,
    /// Outputs that differ at `reached`: channel, value, value that the program expects.
    pub differ: Vec<(u8, i32, i32)>,
    /// How far a pause has come.
    pub pause: Option<Pause>,
    /// Whose program is waited for, and the period in which that was reported, a second after it had begun.
    pub waiting: Option<(String, u64)>,
    /// What the operator is asked.
    pub question: Option<Question>,
    /// Of a job that is resumed: the oldest place that can be gone back to, and the length of the path from there, mm.
    pub history_before: Option<(u32, f64)>,
    /// What was told last, the newest at the end.
    pub messages: VecDeque<Message>,
    /// Where the machine went.
    pub trail: Trail,
    /// How long the path is.
    pub lengths: PathLengths,
    /// Times that the look-ahead ran dry.
    pub underruns: u32,
    /// How long drawing takes.
    pub redraw: Redraw,
    /// The screen is to be left.
    pub over: bool,
    /// Counts every change of the rest, so that nothing is drawn twice.
    pub changes: u64,
}

impl ScreenModel {
    /// A machine that stands, of which nothing was told yet.
    #[must_use]
    pub fn new(facts: Arc<ProgramFacts>) -> Self {
        let (axes, first) = (facts.axes.len(), facts.first_place);
        Self {
            stage: ScreenStage::Setup,
            homed: true,
            homing: vec![AxisHoming::default(); axes],
            period: 0,
            began: 0,
            ended: None,
            counts: vec![0; axes],
            work_zero_mm: vec![0.0; axes],
            moved_mm: vec![0.0; axes],
            place: Place::start_of(first),
            reached: first,
            oldest: first,
            planned: first,
            window: [first; 2],
            rate: 0.0,
            feed_mm_min: 0.0,
            override_rate: 1.0,
            rapid_override: 1.0,
            override_planned: 1.0,
            line: 0,
            reached_line: 0,
            mode: Mode::Run,
            standing: HoldReason::None,
            at_rest: true,
            short: false,
            off_path: false,
            single: false,
            switching: None,
            inputs: 0,
            outputs: BTreeMap::new(),
            program_outputs: BTreeMap::new(),
            optional_stop: false,
            tool_change: None,
            cutter_is_out: false,
            at_cutter_boundary: false,
            active: Active::default(),
            alarm: None,
            differ: Vec::new(),
            pause: None,
            waiting: None,
            question: None,
            history_before: None,
            messages: VecDeque::new(),
            trail: Trail::default(),
            lengths: PathLengths::from(Place::start_of(first)),
            underruns: 0,
            redraw: Redraw::default(),
            over: false,
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
        self.machine_mm(axis) - self.work_zero_mm.get(axis).copied().unwrap_or(0.0)
    }

    /// How far an axis has to go to the end of the block, mm (degrees), where that is known.
    #[must_use]
    pub fn to_go_mm(&self, axis: usize) -> Option<f64> {
        let end = self.facts.preview.end_of(self.line)?;
        let end = f64::from(*end.get(axis)?) + self.moved_mm.get(axis).copied().unwrap_or(0.0);
        (self.stage == ScreenStage::Job && !self.off_path).then_some(end - self.machine_mm(axis))
    }

    /// Where the machine is in the drawing: X, Y, Z, mm.
    #[must_use]
    pub fn in_space(&self) -> [f32; 3] {
        self.facts.space().map(|axis| axis.map_or(0.0, |i| self.machine_mm(i) as f32))
    }

    /// How far back the history reaches from here: seconds at 100 %, and mm.
    #[must_use]
    pub fn history(&self) -> (f64, f64) {
        let records = f64::from(span(self.oldest, self.place.record));
        let mm = self.lengths.at(self.place) - self.lengths.at(Place::start_of(self.oldest));
        (records * self.facts.period_s, mm.max(0.0))
    }

    /// How far the machine has gone back from the furthest place, mm.
    #[must_use]
    pub fn back_mm(&self) -> f64 {
        (self.lengths.total_mm() - self.lengths.at(self.place)).max(0.0)
    }

    /// Seconds that are planned beyond the cursor.
    #[must_use]
    pub fn ahead_s(&self) -> f64 {
        f64::from(span(self.place.record, self.planned)) * self.facts.period_s
    }

    /// Whose program is waited for, and since how many seconds, where the machine stands for want of it.
    #[must_use]
    pub fn waits_for(&self) -> Option<(&str, f64)> {
        let (source, reported) = self.waiting.as_ref()?;
        Some((source, 1.0 + self.period.saturating_sub(*reported) as f64 * self.facts.period_s))
    }

    /// Does the machine move in rapid? In a canned cycle, whatever is faster than the programmed feed.
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

    /// Machine time that the job has run, up to the end of its program, s.
    #[must_use]
    pub fn run_s(&self) -> f64 {
        self.ended.unwrap_or(self.period).saturating_sub(self.began) as f64 * self.facts.period_s
    }

    /// Time that is left, where it is known.
    #[must_use]
    pub fn left(&self) -> Option<TimeLeft> {
        let executed = f64::from(span(self.facts.first_place, self.reached)) * self.facts.period_s;
        let back = f64::from(span(self.place.record, self.reached)) * self.facts.period_s;
        let plan = (self.facts.planned.seconds()? - executed).max(0.0);
        let factor = self.override_rate.max(0.01);
        Some(TimeLeft {
            seconds: (plan + back) / factor,
            exact: self.override_rate == 1.0 && self.rapid_override == 1.0,
        })
    }

    /// The value of an output channel; 0 where nothing was told of it.
    #[must_use]
    pub fn output(&self, channel: u8) -> i32 {
        self.outputs.get(&channel).copied().unwrap_or(0)
    }

    /// Numbers of the digital outputs that are on.
    pub fn outputs_on(&self) -> impl Iterator<Item = u8> {
        self.outputs.iter().filter(|&(&c, &v)| usize::from(c) < channel::DIGITAL && v != 0).map(|(&c, _)| c)
    }

    /// What the program has had an output at, at this place.
    #[must_use]
    pub fn program_output(&self, channel: u8) -> i32 {
        self.program_outputs.get(&channel).copied().unwrap_or(0)
    }

    /// Adds a message. One that was told a moment ago is counted.
    pub fn say(&mut self, time_s: f64, line: u32, text: impl Into<String>) {
        let text = text.into();
        let recent = self.messages.len().saturating_sub(REPEATED_WITHIN);
        let same =
            (recent..self.messages.len()).find(|&at| self.messages[at].text == text && self.messages[at].line == line);
        let times = same.and_then(|at| self.messages.remove(at)).map_or(1, |before| before.times.saturating_add(1));
        if self.messages.len() >= MESSAGES {
            self.messages.pop_front();
        }
        self.messages.push_back(Message { time_s, line, text, times });
        self.changes += 1;
    }

    /// Does the machine stand at the end of the program, with reverse run still possible?
    #[must_use]
    pub fn is_at_program_end(&self) -> bool {
        self.stage == ScreenStage::Job && self.standing == HoldReason::Ended && self.mode == Mode::Run
    }

    /// The job has ended; how, in words.
    pub fn end(&mut self, how: &str) {
        self.ended.get_or_insert(self.period);
        (self.stage, self.pause) = (ScreenStage::Ended(how.into()), None);
        self.differ.clear();
        self.say(self.period as f64 * self.facts.period_s, self.line, how);
    }

    /// The operator is asked something, or nothing any more.
    pub fn ask(&mut self, question: Option<Question>) {
        self.question = question;
        self.changes += 1;
    }

    /// The alarm has been cleared.
    pub fn alarm_is_cleared(&mut self) {
        self.alarm = None;
        self.changes += 1;
    }
}

/// Records from one place to a later one; 0 where it is not later.
fn span(from: u32, to: u32) -> u32 {
    if is_before(from, to) { to.wrapping_sub(from) } else { 0 }
}
