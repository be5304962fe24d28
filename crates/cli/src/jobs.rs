//! `retrace jobs`: lists jobs that can be resumed and jobs that ran.
//!
//! Invariant: nothing is written, and a job with a damaged journal does not prevent the others from being listed.

use std::path::Path;

use retrace_config::{ChannelNames, MachineConfig, NumberedError, channel_name};
use retrace_core::mode::Mode;
use retrace_journal::{
    HoldReason, JobCard, JobFolder, JobHeader, JobRecord, JobState, JobStore, ListedJob, PositionEntry, ProgramSource,
};
use retrace_link::channel;
use serde_json::{Value, json};

use crate::args;
use crate::escape;

/// Number of jobs that are listed without --all.
const LISTED: usize = 20;

/// Runs the command.
///
/// # Errors
/// The jobs folder or the job is missing, or its journal cannot be used.
pub fn run(args: &args::Jobs) -> Result<(), NumberedError> {
    let jobs = JobStore::open_or_default(args.jobs.path())?;
    match &args.action {
        None => list(&jobs, args),
        Some(args::JobsAction::Show { id }) => show(&jobs.find(id)?, args)?,
    }
    Ok(())
}

fn list(jobs: &JobStore, args: &args::Jobs) {
    let listed = jobs.list();
    let all = listed.len();
    // Jobs that never started are of no interest.
    let of_interest = listed.into_iter().filter(|job| args.all || job.state != JobState::NeverBegan);
    let shown: Vec<ListedJob> = of_interest.take(if args.all { all } else { LISTED }).collect();
    if args.format.json {
        let jobs_json: Vec<Value> = shown.iter().map(|job| listed_json(job, args.jobs.path())).collect();
        crate::out::line(json!({"folder": jobs.folder().display().to_string(), "jobs": jobs_json}));
        return;
    }
    if shown.is_empty() {
        say!("no jobs in {}; `retrace run PROGRAM` starts one", jobs.folder().display());
        return;
    }
    let rows: Vec<[String; 5]> = shown.iter().map(|job| row(job, args.jobs.path())).collect();
    say!("{}", table(["job", "program", "state", "progress", "next step"], &rows).trim_end());
    if shown.len() < all {
        say!("{} more with --all", all - shown.len());
    }
}

/// The jobs in a folder, as one JSON object, the newest first.
///
/// # Errors
/// The folder is missing.
pub fn listed(journal: Option<&Path>) -> Result<Value, NumberedError> {
    let jobs = JobStore::open_or_default(journal)?;
    let listed = jobs.list().into_iter().filter(|job| job.state != JobState::NeverBegan).take(LISTED);
    let listed: Vec<Value> = listed.map(|job| listed_json(&job, journal)).collect();
    Ok(json!({"jobs": listed}))
}

/// A job, as one JSON object.
///
/// # Errors
/// There is no such job, or its journal cannot be used.
pub fn shown(journal: Option<&Path>, id: &str) -> Result<Value, NumberedError> {
    let folder = JobStore::open_or_default(journal)?.find(id)?;
    Ok(record_json(&folder.read()?, &folder.state()))
}

fn row(job: &ListedJob, journal: Option<&Path>) -> [String; 5] {
    let (program, far) = job.summary.as_ref().map_or_else(
        || ("?".into(), String::new()),
        |glance| {
            (escape::name(&glance.job.program).into_owned(), progress_text(&glance.job, glance.at.as_ref(), &job.state))
        },
    );
    [job.folder.id().into(), program, job.state.word().into(), far, next_step(job.folder.id(), &job.state, journal)]
}

/// Formats a table with columns as wide as their widest cell.
pub(crate) fn table<const N: usize>(head: [&str; N], rows: &[[String; N]]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([head[column].chars().count()]).max().unwrap_or_default()
    };
    let widths: [usize; N] = std::array::from_fn(width);
    let line = |cells: [&str; N]| -> String {
        let padded: Vec<String> = cells.iter().zip(widths).map(|(cell, width)| format!("{cell:width$}")).collect();
        format!("{}\n", padded.join("  ").trim_end())
    };
    let rows = rows.iter().map(|row| line(std::array::from_fn(|n| row[n].as_str())));
    std::iter::once(line(head)).chain(rows).collect()
}

/// Progress of a job: line reached, number of lines, percentage.
fn progress_text(job: &JobHeader, at: Option<&PositionEntry>, state: &JobState) -> String {
    match (at.map(|at| at.line), job.lines) {
        _ if *state == JobState::Completed => "to the end".into(),
        (None, _) => "at the start".into(),
        (Some(line), None) => format!("line {line}"),
        (Some(line), Some(lines)) => {
            format!("line {line} of {lines}, {:.0} %", 100.0 * f64::from(line) / lines.max(1) as f64)
        }
    }
}

fn next_step(id: &str, state: &JobState, journal: Option<&Path>) -> String {
    match state {
        JobState::Running(Some(pid)) => format!("running in process {pid}"),
        JobState::Running(None) => "running in another process".into(),
        JobState::Completed | JobState::NeverBegan => String::new(),
        JobState::Unusable(refusal) => format!("{}: see `retrace jobs show {id}`", refusal.number),
        JobState::Interrupted | JobState::Stopped | JobState::Alarm => {
            let journal = journal.map(|folder| format!(" --journal {}", folder.display())).unwrap_or_default();
            format!("retrace resume {id}{journal}")
        }
    }
}

fn listed_json(job: &ListedJob, journal: Option<&Path>) -> Value {
    let mut value = json!({
        "id": job.folder.id(),
        "state": job.state.word(),
        "resumable": job.state.can_resume(),
        "next_step": next_step(job.folder.id(), &job.state, journal),
    });
    if let JobState::Unusable(refusal) = &job.state {
        value["error"] = json!({"number": refusal.number, "cause": refusal.cause, "remedy": refusal.remedy});
    }
    if let Some(glance) = &job.summary {
        value["program"] = json!(glance.job.program);
        value["source"] = json!(glance.job.source);
        value["began"] = json!(glance.job.when);
        value["ended"] = json!(glance.end.as_ref().map(|end| end.when));
        value["line"] = json!(glance.at.as_ref().map(|at| at.line));
        value["lines"] = json!(glance.job.lines);
    }
    value
}

fn show(folder: &JobFolder, args: &args::Jobs) -> Result<(), NumberedError> {
    let (state, record) = (folder.state(), folder.read()?);
    if args.format.json {
        crate::out::line(record_json(&record, &state));
        return Ok(());
    }
    say!("{}: {}", folder.id(), state_text(&state));
    for (name, text) in details(&record) {
        say!("  {name:11} {text}");
    }
    let to_do = next_step(folder.id(), &state, args.jobs.path());
    if !to_do.is_empty() {
        say!("  {:11} {to_do}", "next step");
    }
    Ok(())
}

fn state_text(state: &JobState) -> String {
    match state {
        JobState::Running(_) => "running".into(),
        JobState::Interrupted => "interrupted by a failure of the computer or the process; breakpoint saved".into(),
        JobState::Stopped => "stopped; breakpoint saved".into(),
        JobState::Alarm => "stopped by an alarm; breakpoint saved".into(),
        JobState::Completed => "completed".into(),
        JobState::NeverBegan => "nothing has moved".into(),
        JobState::Unusable(refusal) => refusal.cause.clone(),
    }
}

/// Details of a job, by name.
fn details(record: &JobRecord) -> Vec<(&'static str, String)> {
    let job = &record.job;
    let mut words =
        vec![("program", source_text(job)), ("began", format!("{}, with retrace {}", job.when, job.retrace_version))];
    words.extend(
        record.resumed.iter().map(|again| ("resumed", format!("{}, with retrace {}", again.when, again.retrace))),
    );
    if let Some(end) = &record.end {
        words.push(("ended", format!("{}, exit code {}", end.when, end.exit_code)));
    }
    let card = record.resumed.last().map_or(&job.card, |again| &again.card);
    let machine = job.machine.path.as_deref().unwrap_or("built in");
    words.push(("machine", format!("{machine}, control period {} ms", f64::from(job.period_us) / 1000.0)));
    words.push(("card", card_text(card)));
    words.extend(breakpoint(record));
    if record.spooled.bytes > 0 {
        let all = if record.spooled.ended { "complete" } else { "incomplete" };
        words.push(("received", format!("{} bytes of the program are stored, {all}", record.spooled.bytes)));
    }
    let overrides = record.overrides().len();
    let index = format!("{} marks, {overrides} changes of the planned override", record.marks);
    words
        .push(("index", record.last_mark.map_or(index.clone(), |mark| format!("{index}; up to place {}", mark.place))));
    if let Some(alarm) = &record.alarm {
        let text = |name: &str| alarm[name].as_str().unwrap_or_default().to_owned();
        words.push(("alarm", format!("{}: {}. {}", text("number"), text("cause"), text("remedy"))));
    }
    if record.tail.torn > 0 {
        words.push((
            "torn",
            format!("the last {} bytes of the journal were incomplete and are ignored", record.tail.torn),
        ));
    }
    if record.lost > 0 {
        words.push(("lost", format!("{} entries, because the disk was too slow", record.lost)));
    }
    words
}

/// Position of the breakpoint in words.
fn breakpoint(record: &JobRecord) -> Vec<(&'static str, String)> {
    let start = record.last_position.start;
    let fraction = start.place.fraction_of_record();
    let mut place = format!("place {}", start.place.record);
    if start.place.fraction != 0 {
        place += &format!(" and {fraction:.3} of a period");
    }
    if start.reached != start.place.boundary_ahead() {
        place += &format!(", retraced from place {}", start.reached);
    }
    let Some(at) = &record.at else {
        return vec![("breakpoint", format!("at the start, {place}, counts {:?}", record.last_position.counts))];
    };
    let rest = if at.at_rest { "at rest" } else { "in motion" };
    let line = progress_text(&record.job, Some(at), &JobState::Interrupted);
    let mode = mode_text(at.mode, at.hold_reason);
    let names = channel_names(&record.job);
    let outputs: Vec<String> = at.outputs.iter().map(|&(number, value)| output_text(&names, number, value)).collect();
    let mut rows = vec![
        ("breakpoint", format!("{line}; {place}, {rest}; {} instructions complete", start.executed)),
        ("counts", format!("{:?} pulses", record.last_position.counts)),
        ("mode", mode.into()),
        ("outputs", if outputs.is_empty() { "all off".into() } else { outputs.join(", ") }),
        ("as of", at.when.to_string()),
    ];
    if at.layer != 0 {
        rows.insert(2, ("layer", format!("{} pulses of the tool axis besides its path", at.layer)));
    }
    rows
}

fn source_text(job: &JobHeader) -> String {
    let lines = job.lines.map(|lines| format!(", {lines} lines")).unwrap_or_default();
    match &job.source {
        ProgramSource::File(path) => format!("{path}{lines}"),
        ProgramSource::StandardInput => "from standard input".into(),
        ProgramSource::Socket(address) => format!("from {address}"),
        ProgramSource::Serial(address) => format!("from serial:{address}"),
        ProgramSource::Device(path) => format!("from {path}"),
    }
}

fn card_text(card: &JobCard) -> String {
    match card {
        JobCard::Sim => "simulated".into(),
        JobCard::Wired(of) => format!("`{}`, serial number {}, at {}", of.name, of.serial, of.address),
    }
}

fn mode_text(mode: Mode, standing: HoldReason) -> &'static str {
    match (mode, standing) {
        (Mode::Run, HoldReason::None | HoldReason::Ended) => "normal run",
        (Mode::Run, HoldReason::Hold) => "held",
        (Mode::Run, HoldReason::ProgramStop) => "at a program stop",
        (Mode::Run, HoldReason::SingleBlock) => "single block",
        (Mode::Run, HoldReason::Paused) => "paused",
        (Mode::Reverse, _) => "reverse run",
        (Mode::Forward, _) => "forward run",
        (Mode::Wheel, _) => "handwheel",
        (Mode::Rejoin, _) => "returning to the furthest place",
        (Mode::AwaitOutputs, _) => "at the furthest place, outputs differ",
    }
}

/// Output names of the job's machine.
fn channel_names(job: &JobHeader) -> ChannelNames {
    // The text was valid when the job started; a newer version may refuse it.
    MachineConfig::parse(&job.machine.text, "")
        .map_or_else(|_| ChannelNames::default(), |m| ChannelNames::of_machine(&m))
}

fn output_text(names: &ChannelNames, number: u8, value: i32) -> String {
    let name = names.name(number);
    match number {
        channel::SPINDLE if name != channel_name(channel::SPINDLE) => format!("{name} on"),
        channel::SPINDLE if value > 0 => "spindle clockwise".into(),
        channel::SPINDLE => "spindle counterclockwise".into(),
        channel::SPEED if name != channel_name(channel::SPEED) => format!("{name} {}", f64::from(value) / 1000.0),
        channel::SPEED => format!("{} rev/min", f64::from(value) / 1000.0),
        channel::TOOL => format!("tool {value}"),
        analog if channel::is_analog(analog) => format!("{name} {}", names.value_text(number, value)),
        _ if value == 1 => format!("{name} on"),
        _ => format!("{name} {value}"),
    }
}

fn record_json(record: &JobRecord, state: &JobState) -> Value {
    let start = record.last_position.start;
    json!({
        "state": state.word(),
        "resumable": state.can_resume(),
        "job": record.job,
        "resumed": record.resumed,
        "breakpoint": {
            "record": start.place.record.number(),
            "fraction": start.place.fraction,
            "reached": start.reached.number(),
            "executed": start.executed,
            "counts": record.last_position.counts,
            "line": record.at.as_ref().map(|at| at.line),
        },
        "position": record.at,
        "spooled": record.spooled,
        "marks": record.marks,
        "overrides": record.overrides(),
        "alarm": record.alarm,
        "end": record.end,
        "lost": record.lost,
        "torn_bytes": record.tail.torn,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_controller::{JournalRecorder, PeriodRecord, Telemetry};
    use retrace_core::{Place, RecordIndex, mode};
    use retrace_journal::{
        CommandArguments, Durability, DurablePlace, EndEntry, FORMAT, FileHash, JobEnding, JournalWriter,
        MachineFileCopy, ResumeEntry, Timestamp, WiredCard,
    };
    use retrace_link::{CardStatus, OutputChange};

    /// Job that ran on a card, was stopped in reverse run, and was resumed once.
    fn stopped(jobs: &JobStore) -> JobFolder {
        let when = Timestamp::from_ms(1_795_308_387_000);
        let folder = jobs.create("part.ngc", when).expect("a folder");
        let card = WiredCard { address: "port".into(), name: "retrace-sim".into(), serial: 77, boot: 5 };
        let job = JobHeader {
            format: FORMAT,
            id: folder.id().into(),
            when,
            retrace_version: "0.1.0".into(),
            planner: 1,
            program: "part.ngc".into(),
            source: ProgramSource::File("part.ngc".into()),
            lines: Some(120),
            files: Vec::new(),
            machine: MachineFileCopy { path: None, hash: FileHash::of(b""), text: String::new() },
            arguments: CommandArguments::default(),
            tables: None,
            card: JobCard::Wired(card.clone()),
            period_us: 1000,
            origin: RecordIndex::new(0),
            counts: vec![0, 0, 0],
            outputs: Vec::new(),
            executed: 0,
        };
        let place = Place { record: RecordIndex::new(1234), fraction: 1 << 30 };
        let resumed = ResumeEntry {
            when,
            retrace: "0.1.1".into(),
            card: JobCard::Wired(card),
            place,
            reached: RecordIndex::new(1300),
            executed: 2,
            counts: vec![1200, 0, -5],
        };
        let store = folder.create_journal().expect("a file");
        drop(JournalWriter::begin(store, Durability::Written, job, None).expect("it works"));
        let (store, tail) = (folder.open_journal().expect("a file"), folder.read().expect("whole").tail);
        let writer = JournalWriter::reopen(
            store,
            Durability::Written,
            tail,
            DurablePlace::starting_at(RecordIndex::new(0)),
            resumed,
            None,
        )
        .expect("it works");
        let mut recorder = JournalRecorder::<3>::new(&writer, 3, 1000);
        for (channel, value) in [(channel::SPINDLE, 1), (channel::SPEED, 12_000_000), (3, 1)] {
            recorder.record(&Telemetry::Output(OutputChange { channel, value }));
        }
        let status = CardStatus::<3> {
            place,
            reached: RecordIndex::new(1300),
            executed: 2,
            line: 37,
            counts: [1200, 0, -5],
            ..CardStatus::at_rest(retrace_link::PathStart::at(RecordIndex::new(0)))
        };
        recorder.record(&Telemetry::Period(PeriodRecord {
            mode: mode::Mode::Reverse,
            at_rest: true,
            ..PeriodRecord::from_status(&status)
        }));
        drop(recorder);
        let end = EndEntry { when, outcome: JobEnding::Stopped, exit_code: 4, report: Value::Null };
        writer.end(end).expect("it works");
        folder
    }

    #[test]
    fn a_stopped_job_is_listed_and_told_in_words() {
        let folder = tempfile::tempdir().expect("a folder");
        let jobs = JobStore::open(folder.path());
        let job = stopped(&jobs);
        let listed = jobs.list();
        let name = "20261122-004627-part";
        let expected = [name, "part.ngc", "stopped", "line 37 of 120, 31 %", &format!("retrace resume {name}")];
        assert_eq!(row(&listed[0], None), expected);
        let value = listed_json(&listed[0], None);
        assert_eq!((&value["resumable"], &value["line"], &value["lines"]), (&json!(true), &json!(37), &json!(120)));

        let record = job.read().expect("whole");
        let words: Vec<String> = details(&record).iter().map(|(name, text)| format!("{name}: {text}")).collect();
        for expected in [
            "program: part.ngc, 120 lines",
            "resumed: 2026-11-22T00:46:27.000Z, with retrace 0.1.1",
            "ended: 2026-11-22T00:46:27.000Z, exit code 4",
            "machine: built in, control period 1 ms",
            "card: `retrace-sim`, serial number 77, at port",
            "breakpoint: line 37 of 120, 31 %; place 1234 and 0.250 of a period, retraced from place 1300, at rest; \
             2 instructions complete",
            "counts: [1200, 0, -5] pulses",
            "mode: reverse run",
            "outputs: output 3 on, spindle clockwise, 12000 rev/min",
        ] {
            assert!(words.iter().any(|line| line == expected), "{expected} is not in {words:#?}");
        }
        let value = record_json(&record, &job.state());
        assert_eq!((&value["breakpoint"]["record"], &value["breakpoint"]["fraction"]), (&json!(1234), &json!(1 << 30)));
        assert_eq!((&value["state"], &value["job"]["lines"]), (&json!("stopped"), &json!(120)));
    }

    #[test]
    fn a_table_is_as_wide_as_its_cells() {
        let rows = [["a".to_owned(), "bb".into()], ["cccc".into(), String::new()]];
        assert_eq!(table(["x", "y"], &rows), "x     y\na     bb\ncccc\n");
    }

    #[test]
    fn outputs_are_said_as_an_operator_would() {
        let result: Vec<String> = [(64, -1), (65, 12_500), (66, 1), (68, 3), (5, 1), (5, 7)]
            .map(|(n, v)| output_text(&ChannelNames::default(), n, v))
            .into();
        assert_eq!(
            result,
            ["spindle counterclockwise", "12.5 rev/min", "mist on", "tool 3", "output 5 on", "output 5 7"]
        );
        let laser = "[[axis]]\nname = \"x\"\npulses_per_mm = 100\nmax_velocity_mm_per_s = 50\n\
            max_acceleration_mm_per_s2 = 500\nmax_jerk_mm_per_s3 = 5000\ntravel_mm = [0, 100]\n[[cutter]]\n\
            name = \"beam\"\nkind = \"beam\"\nfire = 64\n";
        let laser = ChannelNames::of_machine(&MachineConfig::parse(laser, "").expect("a machine file"));
        assert_eq!(output_text(&laser, 65, 600_000), "beam power 600");
    }

    #[test]
    fn what_to_do_can_be_typed() {
        assert_eq!(next_step("j", &JobState::Stopped, None), "retrace resume j");
        assert_eq!(next_step("j", &JobState::Interrupted, Some(Path::new("here"))), "retrace resume j --journal here");
        assert_eq!(next_step("j", &JobState::Completed, None), "");
    }
}
