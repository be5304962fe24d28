//! The host is killed at any moments of a job that probes, or that cuts a thread: resumed, the job ends on the counts
//! of an uninterrupted run, with the same points in its file, and every answer that is in the journal is there once
//! (PRB-14, SPN-25).

use std::fs;
use std::process::Stdio;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::case_runner::run_cases;
use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::sender::TestRandom;
use retrace_tests::served::ServedCard;
use serde_json::{Value, json};

/// A job whose host is killed.
#[derive(Debug)]
struct KilledJob {
    program: &'static str,
    machine: &'static str,
    work: Option<&'static str>,
    /// Questions of the program, and points in its file.
    asks: (usize, usize),
    /// Factor of the card's time over wall time.
    speed: &'static str,
}

/// A grid of touches over two steps, an input that is read, a probing cycle that sets the offset of the last moves. The
/// questions are those of the grid, its inputs, one without an answer in contact, and two of the cycle.
const PROBING: KilledJob = KilledJob {
    program: "G21 G90 F1200\n(PROBEOPEN points.txt)\n#1 = 0\nO100 while [#1 LT 9]\nG0 Z1\nG0 X[3 * #1] Y[#1]\n\
        G38.2 Z-3\nM66 P5 L0\n#2 = [#2 + #5063 + #5399]\n#1 = [#1 + 1]\nO100 endwhile\nG0 Z2\nG38.3 Z1.5\n\
        o<probe_surface> call [-3] [5] [2]\n(PROBECLOSE)\nG55 G1 X20 Z1.25\nG1 X[10 + #2]\nM2\n",
    machine: "[card]\nwatchdog_ms = 2000\n[[card.input]]\nnumber = 0\nuse = \"probe\"\n[[card.input]]\nnumber = 5\n\
        use = \"plain\"\n[probe]\nfeed_mm_per_min = 1200\nslow_feed_mm_per_min = 600\n",
    work: Some("box=-5:10,-5:50,-20:-1.5;box=10:50,-5:50,-20:-0.7"),
    asks: (21, 11),
    speed: "5",
};

/// Two passes of a thread with a taper at its end, and a thread of two parts. A host may be silent for no longer than
/// the records last that the card holds, less those in which the spindle coasts.
const THREADS: KilledJob = KilledJob {
    program: "G21 G18 G90\nS800 M3\nG0 X10 Z5\nG76 P1.5 Z-10 I-1 J0.5 K0.92 R1 Q29.5 H0 E1.5 L2\nG0 X20 Z5\n\
        G33 Z-5 K1.5\nG33 X22 Z-10 K1.5\nG0 X25\nG1 Z0 F2000\nM5\nM2\n",
    machine: "[card]\nwatchdog_ms = 400\n[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\n",
    work: None,
    asks: (0, 0),
    speed: "2",
};

/// Number of hosts and cards at a time.
const AT_A_TIME: usize = 3;
/// Largest number of times that a job is resumed: a computer under load may be silent for longer than the watchdog
/// allows.
const TRIES: u32 = 8;

/// Number of commands that were killed while they ran.
static KILLS: AtomicU32 = AtomicU32::new(0);

/// A card, and a folder for the job on it.
struct JobPlace {
    bench: Bench,
    card: ServedCard,
}

/// What a job leaves.
#[derive(Debug, PartialEq)]
struct Left {
    counts: Value,
    points: String,
    answers: usize,
}

impl JobPlace {
    fn new(job: &'static KilledJob) -> Self {
        let bench = Bench::new();
        bench.file("part.ngc", job.program);
        let machine = bench.file("machine.toml", job.machine).display().to_string();
        let mut arguments = vec!["--speed", job.speed, "--machine", &machine];
        arguments.extend(job.work.into_iter().flat_map(|work| ["--work", work]));
        let card = ServedCard::with(&arguments);
        Self { bench, card }
    }

    fn run(&self) -> Vec<&str> {
        vec!["run", "part.ngc", "--card", &self.card.port, "--machine", "machine.toml", "--json"]
    }

    /// Starts the command and kills it after this time.
    fn killed(&self, arguments: &[&str], after: Duration) {
        let mut child = self.bench.start(arguments, Stdio::null(), "killed.txt");
        thread::sleep(after);
        let had_ended = child.try_wait().expect("a child").is_some();
        KILLS.fetch_add(u32::from(!had_ended), Ordering::Relaxed);
        child.kill().expect("it is killed");
        child.wait().expect("it ends");
    }

    fn ended(self) -> Left {
        let journal = fs::read_dir(self.bench.path("state/retrace/jobs"))
            .ok()
            .and_then(|mut jobs| fs::read_to_string(jobs.next()?.ok()?.path().join("journal")).ok());
        let points = fs::read_to_string(self.bench.path("points.txt")).unwrap_or_default();
        let answers = journal.unwrap_or_default().matches("\"answer\":").count();
        Left { counts: self.card.end()["counts"].clone(), points, answers }
    }
}

fn has_not_moved(left: &Left) -> bool {
    left.answers == 0 && left.counts.as_array().is_some_and(|counts| counts.iter().all(|count| *count == json!(0)))
}

/// An uninterrupted run: its duration, and what it leaves.
fn whole(job: &'static KilledJob) -> (Duration, Left) {
    for _ in 0..TRIES {
        let (place, begun) = (JobPlace::new(job), Instant::now());
        let result = place.bench.retrace(place.run());
        let takes = begun.elapsed();
        if result.code == Some(0) {
            return (takes, place.ended());
        }
        assert_eq!(result.code, Some(3), "{}\n{}", result.out, result.err);
    }
    panic!("no run came to its end")
}

/// Runs one job, killed up to three times and resumed. An error is a difference, or no answer at all.
fn case(job: &'static KilledJob, seed: u64, (takes, whole): &(Duration, Left)) -> Result<String, String> {
    let mut chance = TestRandom::new(seed);
    let mut moment = || takes.mul_f64(chance.below(1 << 20) as f64 / f64::from(1 << 20));
    let moments = [moment(), moment(), moment()];
    let times = 1 + chance.below(3);
    let place = JobPlace::new(job);
    place.killed(&place.run(), moments[0]);
    for after in &moments[1..times] {
        place.killed(&["resume", "--yes", "--json"], *after);
    }
    let resume = || place.bench.retrace(["resume", "--yes", "--json"]);
    let (mut result, mut alarms) = (resume(), Vec::new());
    for _ in 0..TRIES {
        // An alarm of the watchdog under load, or a killed process that holds the folder for a moment.
        if result.code != Some(3) && !result.err.contains("E2206") {
            break;
        }
        let line = |kind: &str| result.out.lines().find(|line| line.contains(kind)).unwrap_or_default().to_owned();
        alarms.push(line("\"event\":\"alarm\""));
        result = resume();
    }
    let told = |result: &CommandOutput| format!("{}\n{}", result.out.lines().last().unwrap_or_default(), result.err);
    let detail = format!("seed {seed}, killed at {:?}, {alarms:?}: {}", &moments[..times], told(&result));
    let left = place.ended();
    match result.code {
        Some(0) if left == *whole => Ok("completed".into()),
        Some(2) if result.err.contains("E2209") && left == *whole => Ok("had come to its end".into()),
        Some(2) if result.err.contains("E2209") && has_not_moved(&left) => {
            Ok("refused with E2209, nothing had moved".into())
        }
        _ => Err(format!("{detail}\n{left:?}\nand not {whole:?}")),
    }
}

/// Runs jobs whose hosts are killed.
fn kill(job: &'static KilledJob) {
    let whole = whole(job);
    assert_eq!((whole.1.answers, whole.1.points.lines().count()), job.asks, "{whole:?}");
    run_cases(3, AT_A_TIME, |seed| case(job, seed, &whole), || format!("{} kills", KILLS.load(Ordering::Relaxed)));
}

#[test]
fn a_host_that_is_killed_while_it_probes_asks_nothing_twice_and_ends_exactly() {
    kill(&PROBING);
}

/// The card switches the spindle off, follows it to rest in the groove, and keeps the thread for the next host.
#[test]
fn a_host_that_is_killed_in_a_thread_goes_on_in_it_and_ends_exactly() {
    kill(&THREADS);
}
