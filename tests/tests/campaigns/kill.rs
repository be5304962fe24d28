//! The host is killed at any moment of a job: resumed, the job ends on the counts of an uninterrupted run, with every
//! instruction executed once, or it is refused with the reason. There is never a silent difference.

use std::fs::{self, File};
use std::process::Stdio;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::case_runner::run_cases;
use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::sender::TestRandom;
use retrace_tests::served::ServedCard;
use retrace_tests::trace::{Switched, piped};
use serde_json::Value;

/// A straight run, blends, a loop in a subprogram, codes with a duration and synchronous ones, a dwell, an arc.
const PROGRAM: &str = "G21 G90 G94 F3000\nG64 P0.1\nM3 S1000\nG1 X20\nM62 P10\nX25 Y5\nX12 Y9\nM63 P10\nO100 \
    sub\nO101 repeat [3]\nG91\nM62 P12\nG1 X3 Y1\n\
    M101\nX-3 Y2 Z-0.5\nM63 P12\nM102\nX1\nG90\nO101 endrepeat\nO100 endsub\nO100 call\nM8\nG4 P0.3\nG1 X30 Y-4\nM64 \
    P14\nG3 X36 Y2 I0 J6\nO100 call\n\
    M9\nM62 P11\nG1 X15 Y5 Z0\nX11.111 Y7.007 Z-3.3\nM65 P14\nM5\nM2\n";
/// Duration of the codes, and a watchdog that tolerates a computer under load.
const MACHINE: &str = "[card]\nwatchdog_ms = 2000\n[code.M3]\nduration_ms = 200\n[code.M8]\nduration_ms = \
    150\n[code.M101]\noutput = 20\n\
    class = \"synchronous\"\n[code.M102]\noutput = 20\noff = true\nduration_ms = 60\n";
/// An operator who goes back and forward again, in a straight run and in the loop's second call.
const OPERATOR: &str =
    "at 1s hold\nafter 0.2s reverse 100%\nafter 0.5s leave\nat 4s hold\nafter 0.1s reverse 60%\nafter 0.5s leave\n";
/// End of the program, in pulses.
const END: [i64; 3] = [11_111, 7_007, -3_300];
/// Factor of the card's time over wall time: the host has the watchdog's 2 s in 0.4 s, and still keeps up.
const SPEED: &str = "5";
/// Number of hosts and cards at a time.
const AT_A_TIME: usize = 3;
/// Largest number of times that a job is resumed where it ends in an alarm: a computer under load may be silent for
/// longer than the watchdog allows.
const TRIES: u32 = 6;

/// How a job is started.
#[derive(Clone, Copy, Debug)]
struct Kind {
    streamed: bool,
    operated: bool,
}

/// Number of commands that were killed while they ran.
static KILLS: AtomicU32 = AtomicU32::new(0);

/// A card, and a folder for the jobs on it.
struct JobPlace {
    bench: Bench,
    card: ServedCard,
    reading: retrace_tests::trace::Reading,
}

impl JobPlace {
    fn new() -> Self {
        let bench = Bench::new();
        bench.file("part.ngc", PROGRAM);
        bench.file("machine.toml", MACHINE);
        bench.file("back.op", OPERATOR);
        let trace = bench.path("trace.vcd");
        let reading = piped(trace.clone());
        let card = ServedCard::with(&["--speed", SPEED, "--vcd", &trace.to_string_lossy()]);
        Self { bench, card, reading }
    }

    fn run(&self, kind: Kind) -> Vec<&str> {
        let program = if kind.streamed { "-" } else { "part.ngc" };
        let mut run = vec!["run", program, "--card", &self.card.port, "--machine", "machine.toml", "--json"];
        if kind.operated {
            run.extend(["--operator", "back.op"]);
        }
        run
    }

    /// Starts the command and kills it after this time.
    fn killed(&self, arguments: &[&str], kind: Kind, after: Duration) {
        let input = || File::open(self.bench.path("part.ngc")).expect("the program");
        let input = if kind.streamed { input().into() } else { Stdio::null() };
        let begun = Instant::now();
        let mut child = self.bench.start(arguments, input, "killed.txt");
        thread::sleep(after.saturating_sub(begun.elapsed()));
        let had_ended = child.try_wait().expect("a child").is_some();
        KILLS.fetch_add(u32::from(!had_ended), Ordering::Relaxed);
        child.kill().expect("it is killed");
        child.wait().expect("it ends");
    }

    /// Cuts bytes off the last line of the journal, as a power failure may; returns their number.
    fn tear(&self, chance: &mut TestRandom) -> Option<usize> {
        let mut jobs = fs::read_dir(self.bench.path("state/retrace/jobs")).ok()?;
        let journal = jobs.next()?.ok()?.path().join("journal");
        let bytes = fs::read(&journal).ok()?;
        let line = bytes.trim_ascii_end().rsplit(|&byte| byte == b'\n').next()?.len() + 1;
        // the first line is durable before anything moves
        let first = bytes.iter().position(|&byte| byte == b'\n')? + 1;
        let off = (1 + chance.below(line)).min(bytes.len().saturating_sub(first));
        fs::write(&journal, &bytes[..bytes.len() - off]).ok()?;
        Some(off)
    }

    /// Ends the card; returns the counts that it reports, those at its step wires, and its switching.
    fn ended(self) -> (Value, Switched) {
        let told = self.card.end();
        assert_eq!((&told["counts"], &told["periods_apart"]), (&told["counted"], &0.into()), "{told}");
        (told["counts"].clone(), self.reading.ended())
    }
}

/// An uninterrupted run: its duration, and the card's switching.
struct UninterruptedRun {
    takes: Duration,
    switched: Switched,
}

fn whole(kind: Kind) -> UninterruptedRun {
    for _ in 0..TRIES {
        let (place, begun) = (JobPlace::new(), Instant::now());
        let input = if kind.streamed { PROGRAM } else { "" };
        let result = place.bench.retrace_reading(place.run(kind), input.as_bytes());
        let takes = begun.elapsed();
        let (counts, switched) = place.ended();
        if result.code == Some(0) {
            assert_eq!(ends_at(&counts), END);
            return UninterruptedRun { takes, switched };
        }
        // The load of a moment, or another program that still has the card open that had this port's name before; any
        // other reason is a failure.
        assert!(result.code == Some(3) || result.err.contains("E2144"), "{}\n{}", result.out, result.err);
    }
    panic!("no run came to its end")
}

fn ends_at(counts: &Value) -> [i64; 3] {
    [0, 1, 2].map(|axis| counts[axis].as_i64().expect("a count"))
}

/// Number of a refusal or an alarm in the output.
fn number(result: &CommandOutput) -> String {
    let text = format!("{}\n{}", result.err, result.out.lines().last().unwrap_or_default());
    let at = text.match_indices('E').map(|(at, _)| at + 1);
    let mut digits = at.filter_map(|at| text.get(at..at + 4)).filter(|four| four.bytes().all(|b| b.is_ascii_digit()));
    digits.next().map_or_else(|| format!("no number: {text}"), |four| format!("E{four}"))
}

/// Runs one job, killed and resumed; returns its result. An error is a silent difference, or no answer at all.
fn case(seed: u64, wholes: &[UninterruptedRun; 2]) -> Result<String, String> {
    let mut chance = TestRandom::new(seed);
    let kind = Kind { streamed: chance.below(4) == 0, operated: chance.below(2) == 0 };
    let whole = &wholes[usize::from(kind.operated)];
    let mut moment = || whole.takes.mul_f64(chance.below(1 << 20) as f64 / f64::from(1 << 20));
    let (first, second) = (moment(), moment());
    let again = chance.below(3) == 0;
    let place = JobPlace::new();
    place.killed(&place.run(kind), kind, first);
    let torn = (chance.below(4) == 0).then(|| place.tear(&mut chance)).flatten();
    let file = Kind { streamed: false, operated: false };
    if again {
        place.killed(&["resume", "--yes", "--json"], file, second);
    }
    let mut notes = torn.map_or(String::new(), |_| " with a torn journal".to_owned());
    let mut result = place.bench.retrace(["resume", "--yes", "--json"]);
    for _ in 0..TRIES {
        let what = number(&result);
        match (result.code, what.as_str()) {
            (Some(0), _) => break,
            (Some(3), _) => result = place.bench.retrace(["resume", "--yes", "--json"]),
            (_, "E2208") if kind.streamed => {
                result = place.bench.retrace(["resume", "--yes", "--json", "--program", "part.ngc"]);
            }
            // a killed process holds the folder for a moment
            (_, "E2206") => result = place.bench.retrace(["resume", "--yes", "--json"]),
            _ => break,
        }
        notes = format!("{notes}, after {what}");
    }
    let how = format!(
        "{kind:?}, killed at {first:?}{}",
        if again { format!(", again at {second:?}") } else { String::new() }
    );
    let detail =
        format!("seed {seed}: {how}{notes}\n{}\n{}", result.out.lines().last().unwrap_or_default(), result.err);
    let (counts, switched) = place.ended();
    let counts = ends_at(&counts);
    let is_whole = counts == END && switched.outputs == whole.switched.outputs && in_order(&switched, &whole.switched);
    let wrong = || {
        let numbers = |of: &Switched| of.executed.iter().map(u64::to_string).collect::<Vec<_>>().join(" ");
        Err(format!(
            "{detail}\ncounts {counts:?}\nexecuted {}\nand not  {}\nswitched {:?}\nand not  {:?}",
            numbers(&switched),
            numbers(&whole.switched),
            switched.outputs,
            whole.switched.outputs
        ))
    };
    match (result.code, number(&result).as_str()) {
        (Some(0), _) if is_whole => Ok(format!("completed{notes}")),
        (Some(0), _) => wrong(),
        (Some(2), "E2209") if is_whole => Ok("had come to its end".into()),
        (Some(2), number @ ("E2209" | "E2204")) => {
            let nothing = counts == [0; 3] && switched.executed.iter().all(|&number| number == 0);
            if nothing { Ok(format!("refused with {number}, nothing had moved")) } else { wrong() }
        }
        (_, number) if number.starts_with("E2") && result.err.contains("help:") => {
            Ok(format!("refused with {number}\n{detail}"))
        }
        _ => Err(detail),
    }
}

/// Whether every instruction is executed once, in order, up to the same one.
fn in_order(is: &Switched, whole: &Switched) -> bool {
    is.executed.is_sorted() && is.executed.last() == whole.executed.last()
}

#[test]
fn a_host_that_is_killed_at_any_moment_leaves_a_job_that_goes_on_exactly() {
    let wholes = thread::scope(|scope| {
        let begun = [false, true].map(|operated| scope.spawn(move || whole(Kind { streamed: operated, operated })));
        begun.map(|run| run.join().expect("a run without an interruption"))
    });
    let [plain, operated] = &wholes;
    assert_eq!(plain.switched.outputs, operated.switched.outputs, "operator and stream change nothing");
    run_cases(3, AT_A_TIME, |seed| case(seed, &wholes), || format!("{} kills", KILLS.load(Ordering::Relaxed)));
}
