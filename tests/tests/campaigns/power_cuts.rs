//! The power fails in the middle of a cut: host and card are gone at the same moment, and of the journal the tail is
//! missing that was not durable yet. The axes are homed again and the job is resumed (CUT-46): the end of the cut that
//! `resume` reports is never beyond the real one and at most a second of cutting before it, and the part is whole.
//!
//! Invariant: where the cut ended is known from the pins alone.

use retrace_tests::command::{Bench, cases};
use retrace_tests::cut_judge::judge_served;
use retrace_tests::cut_part::{JUDGED, MATERIALS, MachineKind, is_homed_at, machine, program};
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::sender::TestRandom;
use retrace_tests::served::ServedCard;
use serde_json::Value;
use std::collections::VecDeque;
use std::fs;
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Number of jobs that the suite runs, each with up to `MAX_CUTS`, and the seed of the first: a short one.
const SUITE: u32 = 1;
const SUITE_SEED: u64 = 4;
const MAX_CUTS: usize = 3;
/// Card time over wall time.
const SPEED: f64 = 4.0;
/// Number of hosts and cards at a time.
const AT_A_TIME: usize = 3;
/// Bytes that were written earlier than this before the power failed are durable.
const SYNC: Duration = Duration::from_millis(50);
/// Longest time in s of cutting that is not known of (CUT-46), and behind a journal that lost durable lines as well:
/// each of them may have a position of its own.
const MAX_UNKNOWN_S: [f64; 2] = [1.0, 3.0];
/// Records a second.
const RECORDS: f64 = 1000.0;
/// Longest wall time of a job; then its host is killed.
const MAX_JOB: Duration = Duration::from_secs(40);

/// What was cut of the path without an interruption: stretches of places.
struct WholeCut(Vec<[f64; 2]>);

impl WholeCut {
    fn of(trace: &[Sample]) -> Self {
        let pairs = trace.windows(2).filter(|pair| burns(&pair[0]) && burns(&pair[1]));
        Self(pairs.map(|pair| [pair[0].place, pair[1].place]).filter(|[from, to]| from < to).collect())
    }

    /// Records that are cut before this place.
    fn records_before(&self, place: f64) -> f64 {
        self.0.iter().map(|[from, to]| (place.min(*to) - from).max(0.0)).sum()
    }
}

fn burns(sample: &Sample) -> bool {
    sample.is_on(JUDGED.fire) && sample.inputs >> JUDGED.input & 1 == 1
}

/// Lengths of a journal while it grows.
struct JournalGrowth {
    folder: PathBuf,
    lengths: VecDeque<(Instant, usize)>,
}

impl JournalGrowth {
    fn of(bench: &Bench) -> Self {
        Self { folder: bench.path("state/retrace/jobs"), lengths: VecDeque::new() }
    }

    fn path(&self) -> Option<PathBuf> {
        Some(fs::read_dir(&self.folder).ok()?.next()?.ok()?.path().join("journal"))
    }

    /// Notes the present length; returns whether the journal has grown.
    fn has_grown(&mut self) -> bool {
        let length = self.path().and_then(|path| fs::metadata(path).ok()).map_or(0, |file| file.len() as usize);
        let has_grown = self.lengths.back().is_none_or(|&(_, last)| last < length);
        if has_grown {
            self.lengths.push_back((Instant::now(), length));
        }
        has_grown
    }

    /// Length of what was durable at this moment.
    fn durable_at(&self, moment: Instant) -> usize {
        let is_durable = |&&(at, _): &&(Instant, usize)| moment.saturating_duration_since(at) > SYNC;
        self.lengths.iter().rev().find(is_durable).map_or(0, |&(_, length)| length)
    }
}

/// Which part of a journal is gone.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Torn {
    /// A part of what was not durable.
    Tail,
    /// A part of its last two lines, durable or not.
    Lines,
}

/// One job on its card.
struct PowerCutJob {
    bench: Bench,
    card: ServedCard,
    growth: JournalGrowth,
    whole: WholeCut,
    told: String,
}

/// Sums of all jobs.
#[derive(Debug, Default)]
struct Tally {
    cuts: u32,
    /// Cuts behind which a part was missing that had been cut, by the part of the journal that was gone.
    compared: [u32; 2],
    /// Longest time in s of cutting that was not known of.
    unknown_s: [f64; 2],
    torn_bytes: usize,
    not_begun: u32,
    ignitions: u64,
}

impl PowerCutJob {
    /// The host, until it ends by itself, waits for an operator, or the power fails. Its exit code, if it ended, and
    /// whether the power failed.
    fn host(&mut self, arguments: &[&str], chance: &mut TestRandom, until: Option<Duration>) -> (Option<i32>, bool) {
        let mut host = self.bench.start(arguments, Stdio::null(), "host.txt");
        let (begun, after_write) = (Instant::now(), chance.below(2) == 0);
        let ended = loop {
            thread::sleep(Duration::from_millis(1));
            let (has_grown, now) = (self.growth.has_grown(), begun.elapsed());
            if let Some(status) = host.try_wait().expect("a child") {
                break (status.code(), false);
            }
            if until.is_some_and(|until| now > until && (!after_write || has_grown)) {
                self.cut_power(&mut host, chance);
                break (None, true);
            }
            let out = fs::read_to_string(self.bench.path("host.txt")).unwrap_or_default();
            let waits = ["lost", "not_started", "not_latched", "at_rest", "no_sheet", "sheet_contact"]
                .iter()
                .any(|why| out.contains(&format!("\"reason\":\"{why}\"")));
            if waits || now > MAX_JOB {
                thread::sleep(Duration::from_millis(100));
                host.kill().expect("it is killed");
                host.wait().expect("it ends");
                break (None, false);
            }
        };
        self.told += &format!("--- {arguments:?}: {ended:?}\n");
        self.told += &fs::read_to_string(self.bench.path("host.txt")).unwrap_or_default();
        ended
    }

    fn cut_power(&mut self, host: &mut Child, chance: &mut TestRandom) {
        thread::sleep(Duration::from_micros(chance.below(5000) as u64));
        if chance.below(2) == 0 {
            self.card.operate("power off");
            host.kill().expect("it is killed");
        } else {
            host.kill().expect("it is killed");
            self.card.operate("power off");
        }
        host.wait().expect("it ends");
    }

    /// Takes a part of the journal away; returns the number of bytes.
    fn tear(&mut self, torn: Torn, failed: Instant, chance: &mut TestRandom) -> usize {
        let Some((path, bytes)) = self.growth.path().and_then(|path| Some((path.clone(), fs::read(path).ok()?))) else {
            return 0;
        };
        let mut ends: Vec<usize> = (0..bytes.len()).filter(|&at| bytes[at] == b'\n').map(|at| at + 1).collect();
        if ends.last() != Some(&bytes.len()) {
            ends.push(bytes.len());
        }
        // the first line is durable before anything moves
        let first = ends.first().copied().unwrap_or_default();
        let from = match torn {
            Torn::Tail => self.growth.durable_at(failed),
            Torn::Lines => ends.iter().rev().nth(2).copied().unwrap_or_default(),
        };
        let length = (from + chance.below(bytes.len() + 1 - from.min(bytes.len()))).max(first).min(bytes.len());
        fs::write(path, &bytes[..length]).expect("a cut journal");
        self.growth.lengths = VecDeque::from([(failed, length)]);
        bytes.len() - length
    }

    /// The furthest place at which it cut so far.
    fn cut_until(&self) -> f64 {
        // the card writes its trace to the file now and then
        thread::sleep(Duration::from_millis(300));
        let trace = samples(&self.bench.path("pins.vcd"));
        trace.iter().filter(|sample| burns(sample) && sample.line != 0).map(|sample| sample.place).fold(0.0, f64::max)
    }

    /// Whether the contour in which it cut last is cut to its end, as an operator sees at the part.
    fn contour_is_whole(&self, cut_until: f64) -> bool {
        let next = self.whole.0.iter().find(|[from, _]| *from >= cut_until - 1.0);
        next.is_none_or(|[from, _]| *from > cut_until + 2.0)
    }

    /// Compares the end of the cut that the host reported with the real one; returns the time in s that is unknown.
    fn unknown_s(&self, cut_until: f64) -> Result<Option<f64>, String> {
        let out = fs::read_to_string(self.bench.path("host.txt")).unwrap_or_default();
        let events: Vec<Value> = out.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        let find = |kind: &str| events.iter().find(|event| event["event"] == kind);
        let Some(resumed) = find("resume").filter(|_| find("started").is_some()) else { return Ok(None) };
        let place = |event: &Value, record: &str, fraction: &str| {
            let number = |key: &str| event[key].as_f64().unwrap_or_else(|| panic!("{key}: {event}"));
            number(record) + number(fraction) / 4_294_967_296.0
        };
        // the end that comes from the journal, and not one that this host saw
        let is_restored = |event: &&Value| event["event"] == "cut_end" && event["may_be_longer"] == true;
        let end = events
            .iter()
            .find(is_restored)
            .map_or_else(|| place(resumed, "record", "fraction"), |event| place(event, "cut_record", "cut_fraction"));
        let unknown = self.whole.records_before(cut_until) - self.whole.records_before(end);
        // in a record, the place of a period is known
        if unknown < -1.0 {
            return Err(format!("the cut ends at {cut_until}, reported is {end}: {} records beyond it", -unknown));
        }
        Ok(Some(unknown / RECORDS))
    }
}

fn case(seed: u64, tally: &Mutex<Tally>) -> Result<(), String> {
    let mut chance = TestRandom::new(seed);
    let bench = Bench::new();
    let kind = MachineKind { senses: chance.below(3) == 0, homes: true };
    bench.file("part.ngc", program(&mut chance));
    bench.file("materials.toml", MATERIALS);
    let machine = bench.file("m.toml", machine(kind)).display().to_string();
    let arguments = ["--machine", "m.toml", "--no-journal", "--vcd", "whole.vcd"];
    let whole = Run::of(&bench, std::path::Path::new("part.ngc"), &arguments);
    let vcd = bench.path("pins.vcd").display().to_string();
    let mut faults = format!("no-start=0.1,seed={seed}");
    let mut script = String::new();
    if chance.below(2) == 0 {
        // the cut is lost and recovered before, or while, the power fails
        faults += &format!(",lose@{}", 5 + chance.below(100));
        script = (0..20).map(|_| "after 1.5s recover\n").collect();
    }
    bench.file("s.op", script);
    bench.file("skip.op", "at 0.1s skip contour\n");
    let card = ServedCard::with(&[
        "--machine",
        &machine,
        "--source-faults",
        &faults,
        "--vcd",
        &vcd,
        "--speed",
        &SPEED.to_string(),
    ]);
    let port = card.port.clone();
    card.home(&bench)?;
    let job = Duration::from_secs_f64(whole.number("periods") / RECORDS / SPEED);
    let whole_cut = WholeCut::of(&samples(&bench.path("whole.vcd")));
    let growth = JournalGrowth::of(&bench);
    let mut job_run = PowerCutJob { bench, card, growth, whole: whole_cut, told: faults };
    let run = ["run", "part.ngc", "--card", &port, "--machine", "m.toml", "--operator", "s.op", "--json"];
    let resume = ["resume", "--yes", "--operator", "s.op", "--json"];
    let skip = ["resume", "--yes", "--operator", "skip.op", "--json"];
    let mut arguments: &[&str] = &run;
    let mut cuts = 1 + chance.below(MAX_CUTS);
    let mut compared: Option<(f64, Torn)> = None;
    for _ in 0..40 {
        let until = (cuts > 0).then(|| job.mul_f64(chance.below(1000) as f64 / 1000.0));
        let (code, has_failed) = job_run.host(arguments, &mut chance, until);
        let failed = Instant::now();
        let told = |job_run: &PowerCutJob, why: &str| Err(format!("{why}\n{}", job_run.told));
        if let Some((cut_until, torn)) = compared.take() {
            match job_run.unknown_s(cut_until) {
                Ok(Some(unknown_s)) => {
                    let mut tally = tally.lock().expect("no panic");
                    tally.compared[torn as usize] += 1;
                    tally.unknown_s[torn as usize] = tally.unknown_s[torn as usize].max(unknown_s);
                    if unknown_s > MAX_UNKNOWN_S[torn as usize] {
                        return told(&job_run, &format!("{unknown_s} s of the cut are unknown, {torn:?}"));
                    }
                }
                Ok(None) => compared = Some((cut_until, torn)),
                Err(why) => return told(&job_run, &why),
            }
        }
        if has_failed {
            cuts -= 1;
            let torn = [Torn::Tail, Torn::Lines][chance.below(2)];
            let bytes = job_run.tear(torn, failed, &mut chance);
            job_run.told += &format!("--- the power fails, {torn:?}, {bytes} bytes are gone\n");
            // what was gone before stays gone
            let torn = if compared.is_some_and(|(_, before)| before == Torn::Lines) { Torn::Lines } else { torn };
            compared = Some((job_run.cut_until(), torn));
            job_run.card.operate("power on");
            thread::sleep(Duration::from_millis(100));
            job_run.told += &job_run.card.home(&job_run.bench)?;
            let mut tally = tally.lock().expect("no panic");
            tally.cuts += 1;
            tally.torn_bytes += bytes;
        }
        match code {
            Some(0) => {
                let PowerCutJob { bench, card, told, .. } = job_run;
                let ended = card.end();
                let verdict = judge_served(bench.path("whole.vcd"), bench.path("pins.vcd"), &JUDGED);
                let [counts, counted] = ["counts", "counted"]
                    .map(|key| (0..3).filter_map(|axis| ended[key][axis].as_i64()).collect::<Vec<i64>>());
                let is_good = verdict.is_good() && counts == whole.counts() && is_homed_at(&counts, &counted);
                tally.lock().expect("no panic").ignitions += verdict.ignitions;
                return if is_good { Ok(()) } else { Err(format!("{verdict:?} {counts:?} {counted:?}\n{told}")) };
            }
            // nothing was begun, or durable, that could be resumed
            Some(2) if job_run.whole.records_before(job_run.cut_until()) == 0.0 => {
                tally.lock().expect("no panic").not_begun += 1;
                let _ = fs::remove_dir_all(&job_run.growth.folder);
                (arguments, compared) = (&run, None);
            }
            // over the kerf of a contour that is whole no arc strikes: the operator skips the rest of it
            None if !has_failed && job_run.contour_is_whole(job_run.cut_until()) => arguments = &skip,
            Some(3) | None => arguments = &resume,
            other => return told(&job_run, &format!("exit code {other:?}")),
        }
    }
    Err(format!("it does not end\n{}", job_run.told))
}

#[test]
fn a_cut_is_resumed_whole_after_the_power_failed() {
    let first: u64 = std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(SUITE_SEED);
    let (next, of, begun) = (AtomicU32::new(0), cases(SUITE), Instant::now());
    let (tally, wrong) = (Mutex::new(Tally::default()), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for _ in 0..AT_A_TIME {
            scope.spawn(|| {
                while let number = next.fetch_add(1, Ordering::Relaxed)
                    && number < of
                {
                    let seed = first + u64::from(number);
                    if let Err(why) = case(seed, &tally) {
                        println!("WRONG seed {seed}");
                        wrong.lock().expect("no panic").push(format!("seed {seed}: {why}"));
                    }
                }
            });
        }
    });
    let (tally, wrong) = (tally.into_inner().expect("no panic"), wrong.into_inner().expect("no panic"));
    println!("{of} jobs in {:.0} s, {} failed: {tally:?}", begun.elapsed().as_secs_f64(), wrong.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}
