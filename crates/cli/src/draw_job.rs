//! `retrace plot --job`: draws the history of a job from its journal: path, place over time, and events.
//!
//! Invariant: the journal is the only source, so that a job is drawn as it ran, even if its program has changed since.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use retrace_config::{MachineConfig, NumberedError, amount_text, channel_name};
use retrace_core::Place;
use retrace_core::mode::Mode;
use retrace_journal::{
    HoldReason, JobFolder, JobRecord, JobState, JobStore, JournalEntries, JournalEntry, PositionEntry,
};
use retrace_plot::{Activity, History, HistoryEvent, HistorySample, Priority, Stroke, StrokeKind, ToolPath};
use serde_json::Value;

/// History of this job, or of the newest one.
///
/// # Errors
/// The job does not exist, or its journal cannot be used.
pub fn history(id: Option<&str>, journal: Option<&Path>) -> Result<History, NumberedError> {
    let jobs = JobStore::open_or_default(journal)?;
    let folder = match id {
        Some(id) => jobs.find(id)?,
        None => newest(&jobs)?,
    };
    let record = folder.read()?;
    let machine = match record.job.machine.text.as_str() {
        "" => MachineConfig::built_in()?,
        text => MachineConfig::parse(text, record.job.machine.path.as_deref().unwrap_or("the built-in machine"))?,
    };
    HistoryBuilder::of(&record, &machine).build(&folder)
}

fn newest(jobs: &JobStore) -> Result<JobFolder, NumberedError> {
    let newest = jobs.list().into_iter().find(|job| job.state != JobState::NeverBegan && job.summary.is_some());
    newest.map(|job| job.folder).ok_or_else(|| {
        let what = format!("no jobs in {}", jobs.folder().display());
        NumberedError::new("E2202", what, "`retrace run PROGRAM` starts one; --journal selects another folder")
    })
}

/// Builds the history from a journal.
struct HistoryBuilder<'r> {
    record: &'r JobRecord,
    machine: &'r MachineConfig,
    clock: MachineTime,
    history: History,
    /// Stored positions: place in periods since the start of the job, and the point there.
    points: Vec<(f64, [f64; 3])>,
    /// Sections that were retraced, as pairs of places in periods, in the order of time.
    gone_over: Vec<[f64; 2]>,
    /// Last position: place, and the activity from there.
    last: Option<(f64, Activity)>,
    reached: f64,
}

impl<'r> HistoryBuilder<'r> {
    fn of(record: &'r JobRecord, machine: &'r MachineConfig) -> Self {
        let clock = MachineTime { period_s: f64::from(record.job.period_us) * 1e-6, ..MachineTime::default() };
        let mut telling = Self {
            record,
            machine,
            clock,
            history: History::default(),
            points: Vec::new(),
            gone_over: Vec::new(),
            last: None,
            reached: 0.0,
        };
        telling.points.push((0.0, telling.point(&record.job.counts)));
        telling
    }

    fn build(mut self, folder: &JobFolder) -> Result<History, NumberedError> {
        let path = folder.journal();
        let file = File::open(&path).map_err(|error| {
            NumberedError::new(
                "E2104",
                format!("{} cannot be read: {error}", path.display()),
                "check the file and its disk",
            )
        })?;
        for entry in JournalEntries::new(BufReader::new(file)) {
            match entry.map_err(|flaw| flaw.numbered_error(&path))?.1 {
                JournalEntry::Position(at) => self.position(&at),
                JournalEntry::Event(event) => self.event(&event),
                JournalEntry::Resumed(_) => {
                    self.add_event(Priority::Ending, "resumed".into());
                    self.clock.begins_anew = true;
                    self.last = None;
                }
                JournalEntry::Lost(lost) => {
                    self.add_event(Priority::Standing, format!("{} entries lost", lost.entries))
                }
                JournalEntry::Job(_)
                | JournalEntry::Mark(_)
                | JournalEntry::Override(_)
                | JournalEntry::Rest(_)
                | JournalEntry::ToolLength(_)
                | JournalEntry::Answer(_)
                | JournalEntry::Tap(_)
                | JournalEntry::Spooled(_)
                | JournalEntry::End(_) => {}
            }
        }
        let state = folder.state();
        if state == JobState::Interrupted {
            self.add_event(Priority::Ending, "interrupted".into());
        }
        for mark in self.record.marks()? {
            let mark = mark?;
            self.points.push((self.periods(Place::start_of(mark.place)), self.point(&mark.counts)));
        }
        Ok(self.finish(&state))
    }

    /// Number of periods from the start of the job to a place.
    fn periods(&self, place: Place) -> f64 {
        f64::from(place.record.since(self.record.job.origin)) + place.fraction_of_record()
    }

    fn point(&self, counts: &[i64]) -> [f64; 3] {
        ['x', 'y', 'z'].map(|name| {
            let axis = self.machine.axes.iter().position(|axis| axis.name == name);
            let mm = axis.and_then(|n| Some(self.machine.axes[n].mm_of(*counts.get(n)?)));
            mm.unwrap_or_default()
        })
    }

    fn position(&mut self, at: &PositionEntry) {
        let time_s = self.clock.seconds(at.period);
        let place = self.periods(at.place);
        self.reached = self.reached.max(self.periods(Place::start_of(at.reached))).max(place);
        if let Some((from, doing)) = self.last
            && doing.is_retracing()
            && from != place
        {
            self.gone_over.push([from, place]);
        }
        let doing = activity(at.mode, at.hold_reason);
        self.last = Some((place, doing));
        self.points.push((place, self.point(&at.counts)));
        let [place_s, reached_s] = [place, self.reached].map(|periods| periods * self.clock.period_s);
        self.history.samples.push(HistorySample { time_s, place_s, reached_s, activity: doing });
    }

    fn event(&mut self, event: &Value) {
        if let Some(period) = event["period"].as_u64() {
            self.clock.seconds(period);
        }
        if let Some((rank, words)) = event_label(event) {
            self.add_event(rank, words);
        }
    }

    fn add_event(&mut self, rank: Priority, words: String) {
        self.history.events.push(HistoryEvent { time_s: self.clock.now_s, priority: rank, label: words });
    }

    fn finish(mut self, state: &JobState) -> History {
        let reached = self.reached;
        self.points.retain(|(place, _)| *place <= reached);
        self.points.sort_by(|a, b| a.0.total_cmp(&b.0));
        let executed = self.points.iter().map(|(_, point)| *point).collect();
        let mut strokes = vec![Stroke { kind: StrokeKind::Executed, points: executed }];
        strokes.extend(self.gone_over.iter().map(|&[from, to]| self.section(from.min(to), from.max(to))));
        let job = &self.record.job;
        self.history.path = ToolPath { title: job.program.clone(), strokes };
        self.history.stands_mm = Some(self.point(&self.record.last_position.counts));
        let line = self.record.at.as_ref().map_or(0, |at| at.line);
        let lines = job.lines.map(|lines| format!(" of {lines}")).unwrap_or_default();
        let far = if *state == JobState::Completed { String::new() } else { format!(" at line {line}{lines}") };
        self.history.summary = format!("{}{far} · {} · began {}", state.word(), job.id, job.when);
        self.history
    }

    /// Path between two places.
    fn section(&self, low: f64, high: f64) -> Stroke {
        let first = self.points.partition_point(|(place, _)| *place < low);
        let behind = self.points.partition_point(|(place, _)| *place <= high);
        let points = self.points[first..behind.max(first)].iter().map(|(_, point)| *point).collect();
        Stroke { kind: StrokeKind::Retraced, points }
    }
}

/// Machine time over a whole job. A card that was restarted counts its periods from 0 again.
#[derive(Clone, Copy, Debug, Default)]
struct MachineTime {
    period_s: f64,
    /// Periods before those that the card counts now.
    before: u64,
    /// Maximum of the periods since the start of the job.
    now: u64,
    now_s: f64,
    first: Option<u64>,
    /// Whether the job was resumed and nothing has been reported since.
    begins_anew: bool,
}

impl MachineTime {
    fn seconds(&mut self, period: u64) -> f64 {
        // The card may have been running for days before the job.
        let first = *self.first.get_or_insert(period);
        let counted = period.saturating_sub(first);
        if self.begins_anew {
            self.begins_anew = false;
            if self.before + counted < self.now {
                self.first = Some(period);
                self.before = self.now;
                return self.now_s;
            }
        }
        self.now = self.now.max(self.before + counted);
        self.now_s = self.now as f64 * self.period_s;
        self.now_s
    }
}

fn activity(mode: Mode, standing: HoldReason) -> Activity {
    match (mode, standing) {
        (Mode::Run, HoldReason::None | HoldReason::Ended) => Activity::Run,
        (Mode::Run, HoldReason::Hold) => Activity::Hold,
        (Mode::Run, HoldReason::ProgramStop) => Activity::ProgramStop,
        (Mode::Run, HoldReason::SingleBlock) => Activity::SingleBlock,
        (Mode::Run, HoldReason::Paused) => Activity::Paused,
        (Mode::Reverse, _) => Activity::Reverse,
        (Mode::Forward, _) => Activity::Forward,
        (Mode::Wheel, _) => Activity::Wheel,
        (Mode::Rejoin, _) => Activity::Return,
        (Mode::AwaitOutputs, _) => Activity::Settle,
    }
}

/// Label of an event with its priority; `None` where the drawing shows the event anyway.
fn event_label(event: &Value) -> Option<(Priority, String)> {
    let text = |name: &str| event[name].as_str().unwrap_or_default().to_owned();
    Some(match event["event"].as_str()? {
        "alarm" => (Priority::Ending, format!("ALARM {}: {}", text("number"), text("cause"))),
        "history_start_reached" => (Priority::Standing, "history start".into()),
        "retrace_barrier" => (Priority::Standing, format!("behind {}", text("code"))),
        "outputs_differ" => (Priority::Standing, "outputs differ".into()),
        "outputs_restored" => (Priority::Standing, "outputs restored".into()),
        "program_stop" => (Priority::Standing, format!("{} waits", text("code"))),
        "underrun" => (Priority::Standing, "underrun".into()),
        "operator" => (Priority::Operator, text("command")),
        "command_rejected" => (Priority::Operator, format!("refused: {}", text("reason"))),
        "switching" => (Priority::Switching, text("code")),
        "output_changed" => (Priority::Switching, switched(event)),
        "message" => (Priority::Passing, format!("\u{201c}{}\u{201d}", text("text"))),
        _ => return None,
    })
}

fn switched(event: &Value) -> String {
    let channel = event["channel"].as_u64().and_then(|channel| u8::try_from(channel).ok()).unwrap_or_default();
    let name = event["name"].as_str().map_or_else(|| channel_name(channel), str::to_owned);
    if let (Some(unit), Some(value)) = (event["unit"].as_str(), event["value"].as_i64()) {
        return format!("{name} {}", amount_text(value as i32, unit));
    }
    match event["value"].as_i64() {
        Some(0) => format!("{name} off"),
        Some(1) => format!("{name} on"),
        value => format!("{name} {}", value.unwrap_or_default()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use retrace_controller::{
        CommandSources, JobOptions, JobStart, JournalRecorder, Observer, RunMode, ScriptPlayer, Telemetry, run_job,
    };
    use retrace_core::RecordIndex;
    use retrace_hal_sim::{Clock, SimCard};
    use retrace_journal::{
        CommandArguments, Durability, EndEntry, FORMAT, FileHash, JobCard, JobEnding, JobHeader, JournalConfig,
        JournalWriter, MachineFileCopy, ProgramSource, Timestamp,
    };
    use serde_json::json;

    use crate::args::{Cli, Command};
    use crate::program::Program;

    struct JournalPath(JournalRecorder<9>);

    impl Observer<9> for JournalPath {
        fn on_telemetry(&mut self, telemetry: &Telemetry<9>) {
            self.0.record(telemetry);
        }
    }

    fn example(name: &str) -> String {
        format!("{}/../../examples/{name}", env!("CARGO_MANIFEST_DIR"))
    }

    /// Runs example 2 with its operator's script and a journal, which ends this way, or without an end.
    fn backed_up(folder: &Path, ended: Option<JobEnding>) {
        let text = std::fs::read_to_string(example("02-back-up.toml")).expect("a machine file");
        let machine = MachineConfig::parse(&text, "02-back-up.toml").expect("a machine");
        let plot = ["retrace", "plot", &example("02-back-up.ngc"), "-o", "x.svg"];
        let Command::Plot(args) = Cli::parse_from(plot).command else { panic!("it is a plot") };
        let program = Program::open(&args.reading, &machine).unwrap_or_else(|_| panic!("a program"));
        let script = crate::files::script(Some(Path::new(&example("02-back-up.op")))).expect("a script");
        let job_folder = JobStore::open(folder).create("02-back-up.ngc", Timestamp::from_ms(0)).expect("a folder");
        let entry = JobHeader {
            format: FORMAT,
            id: job_folder.id().into(),
            when: Timestamp::from_ms(0),
            retrace_version: String::new(),
            planner: 1,
            program: "02-back-up.ngc".into(),
            source: ProgramSource::StandardInput,
            lines: program.lines(),
            files: Vec::new(),
            machine: MachineFileCopy { path: None, hash: FileHash::of(text.as_bytes()), text },
            arguments: CommandArguments::default(),
            tables: None,
            card: JobCard::Sim,
            period_us: 1000,
            origin: RecordIndex::new(0),
            counts: vec![0, 0, 0],
            outputs: Vec::new(),
            executed: 0,
        };
        let store = job_folder.create_journal().expect("a file");
        let writer = JournalWriter::begin(store, Durability::Written, entry, None).expect("it works");
        let mut kept = JournalPath(JournalRecorder::new(&writer, 3, 1000));
        let journal_config =
            JournalConfig { index: Box::new(writer.index_writer(None, &[])), durable: writer.durable_place() };
        let operators = CommandSources::from_script(ScriptPlayer::new(script, machine.period_us));
        let job_options = JobOptions {
            start: JobStart::First,
            commands: operators,
            run_mode: RunMode { wall_time: false, operator: true, real_time: false },
            journal: journal_config,
        };
        let card =
            SimCard::new(RecordIndex::new(0), machine.rate_limits().expect("limits"), Clock::Virtual).expect("a card");
        run_job::<9, _>(&machine, program.decoder(), job_options, card, &mut kept).expect("it runs");
        drop(kept);
        match ended {
            Some(outcome) => {
                let end = EndEntry { when: Timestamp::from_ms(0), outcome, exit_code: 0, report: Value::Null };
                writer.end(end).expect("it works");
            }
            None => drop(writer),
        }
    }

    #[test]
    fn a_history_is_where_the_job_was_and_what_happened() {
        let folder = tempfile::tempdir().expect("a folder");
        backed_up(folder.path(), Some(JobEnding::Completed));
        let history = history(None, Some(folder.path())).expect("a journal");
        assert!(history.summary.starts_with("completed · 19700101-000000-02-back-up"), "{}", history.summary);
        assert!(history.samples.is_sorted_by(|a, b| a.time_s <= b.time_s && a.reached_s <= b.reached_s));
        assert!(history.samples.iter().all(|moment| moment.place_s <= moment.reached_s));
        let last = history.samples.last().expect("it moved");
        assert_eq!((last.activity, last.place_s), (Activity::Run, last.reached_s));
        // The machine retains 4 s of motion, and goes back to the oldest of it.
        let deepest = history.samples.iter().map(|moment| moment.reached_s - moment.place_s).fold(0.0, f64::max);
        assert!((3.9..=4.2).contains(&deepest), "{deepest}");
        let words: Vec<&str> = history.events.iter().map(|remark| remark.label.as_str()).collect();
        for expected in ["hold", "reverse 100%", "history start", "leave", "output 0 on"] {
            assert!(words.contains(&expected), "{expected} is not in {words:?}");
        }
        assert!(history.events.is_sorted_by_key(|remark| remark.time_s));
        // The bracket's 600 mm; the arc error of the marks is negligible.
        let executed = history.path.strokes.first().expect("a path");
        let ends = [executed.points.first(), executed.points.last()].map(|point| point.copied());
        assert_eq!(ends, [Some([0.0; 3]), Some([-10.0, 0.0, 0.0])]);
        assert_eq!(history.stands_mm, Some([-10.0, 0.0, 0.0]));
    }

    #[test]
    fn an_interrupted_job_says_so() {
        let folder = tempfile::tempdir().expect("a folder");
        assert_eq!(history(None, Some(folder.path())).expect_err("no job").number, "E2202");
        backed_up(folder.path(), None);
        let history = history(Some("1970"), Some(folder.path())).expect("a journal");
        assert!(history.summary.starts_with("interrupted at line"), "{}", history.summary);
        assert_eq!(
            history.events.last().map(|remark| (remark.priority, remark.label.as_str())),
            Some((Priority::Ending, "interrupted"))
        );
    }

    #[test]
    fn machine_time_goes_on_where_a_card_begins_anew() {
        let mut clock = MachineTime { period_s: 0.5, ..MachineTime::default() };
        let telemetry = [100, 102, 110].map(|period| clock.seconds(period));
        assert_eq!(telemetry, [0.0, 1.0, 5.0], "a card may have run before");
        clock.begins_anew = true;
        assert_eq!([0, 2].map(|period| clock.seconds(period)), [5.0, 6.0]);
        clock.begins_anew = true;
        assert!((clock.seconds(40) - 25.0).abs() < 1e-9, "a card that kept its count");
    }

    #[test]
    fn events_are_said_in_a_few_words() {
        let result = |event: Value| event_label(&event).map(|(_, words)| words);
        assert_eq!(result(json!({"event": "operator", "command": "override 60%"})).as_deref(), Some("override 60%"));
        assert_eq!(
            result(json!({"event": "output_changed", "channel": 3, "value": 0})).as_deref(),
            Some("output 3 off")
        );
        assert_eq!(
            result(json!({"event": "output_changed", "channel": 65, "value": 7})).as_deref(),
            Some("spindle speed 7")
        );
        assert_eq!(
            result(json!({"event": "alarm", "number": "E3001", "cause": "x"})).as_deref(),
            Some("ALARM E3001: x")
        );
        assert_eq!(result(json!({"event": "mode", "mode": "reverse"})), None);
        assert_eq!(result(json!({})), None);
    }
}
