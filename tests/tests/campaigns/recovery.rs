//! Random cuts that are interrupted and recovered: the arc is lost, the operator holds or puts the torch out, the host
//! is killed, the card is switched off, the torch touches something, the emergency stop is pressed, once or several
//! times, and the cut goes on by *recover*, beside the path, step by step, or by `resume`. The part has to be as whole
//! as without any of it.
//!
//! Invariant: the judge has the traces of the pins alone.

use retrace_tests::command::{Bench, cases};
use retrace_tests::cut_judge::{JudgedMachine, Verdict, judge, judge_served};
use retrace_tests::cut_part::{JUDGED, MATERIALS, MachineKind, is_homed_at, machine, program};
use retrace_tests::limits::audit;
use retrace_tests::run::Run;
use retrace_tests::sender::TestRandom;
use retrace_tests::served::ServedCard;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Mutex;
use std::thread;
use std::time::{Duration, Instant};

/// Number of recoveries that the suite runs.
const SUITE: u32 = 8;
/// Every so many of them are over a line, with killed hosts.
const SERVED: u64 = 6;
/// Card time over wall time there.
const SPEED: f64 = 6.0;
/// Longest wall time of a job there; then its host is killed.
const MAX_JOB_S: f64 = 40.0;

/// Every so many of them have a torch that senses the sheet before each start.
const SENSING: u64 = 3;

/// Runs the program with these faults of the source and this script; its trace goes to a file of this name.
fn run(
    bench: &Bench,
    (program, kind): (&Path, MachineKind),
    faults: &str,
    script: &str,
    trace: &str,
) -> (Run, PathBuf) {
    bench.file("materials.toml", MATERIALS);
    let (machine, operator) = (bench.file("m.toml", machine(kind)), bench.file("s.op", script));
    let (vcd, machine) = (bench.path(trace), machine.display().to_string());
    let (trace, operator) = (vcd.display().to_string(), operator.display().to_string());
    if std::env::var_os("RETRACE_SHOW").is_some() {
        println!("--- {faults}\n{script}");
        println!("{}", std::fs::read_to_string(program).unwrap_or_default());
    }
    let run = Run::of(
        bench,
        program,
        &["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator, "--no-journal"],
    );
    (run, vcd)
}

/// What the operator does at an interruption that he sees at this time, and when he is done with it.
fn recovery(chance: &mut TestRandom, at_s: f64) -> String {
    let from = at_s + 0.8 + chance.below(20) as f64 / 10.0;
    match chance.below(8) {
        0 => format!("at {from:.3}s back to cut end\nafter 4s cut\n"),
        1 => format!("at {from:.3}s back to pierce\nafter 8s cut moving\n"),
        2 => format!("at {from:.3}s back to cut end\nafter 4s forward 20%\nafter 0.1s hold\nafter 1s recover\n"),
        3 => format!("at {from:.3}s back to cut end\nafter 4s forward 20%\nafter 0.1s hold\nafter 1s cut moving\n"),
        4 => format!("at {from:.3}s recover\nafter 0.3s hold\nafter 0.5s resume\n"),
        5 => {
            // where nothing is interrupted yet, it is refused, and the start is tried again on the path
            let [x, y] = [0; 2].map(|_| chance.below(1400) as f64 / 100.0 - 7.0);
            let lead = ["line", "arc"][chance.below(2)];
            let shift =
                format!("at {from:.3}s lead {lead}\nafter 0s shift {x:.2} {y:.2}\nafter 0s shift {x:.2} {y:.2}\n");
            shift + "after 0.1s recover\nafter 12s shift 0\nafter 0.1s recover\n"
        }
        _ => format!("at {from:.3}s recover\n"),
    }
}

/// Where the arc goes out, by the length that was cut, and how often it does not strike.
fn faults(chance: &mut TestRandom, seed: u64, length_mm: f64) -> String {
    let losses = 1 + chance.below(3);
    let mut faults: Vec<String> =
        (0..losses).map(|_| format!("lose@{:.2}", length_mm * chance.below(1000) as f64 / 1000.0)).collect();
    faults.push(format!("no-start=0.1,seed={seed}"));
    faults.join(",")
}

/// What ends a host before its job is complete.
const STOPS: [Option<&str>; 6] = [None, None, Some("breakaway"), Some("emergency-stop"), Some(CABLE), Some(CARD_OFF)];
/// Its cable is pulled out.
const CABLE: &str = "cable";
/// The card is switched off, and loses what it has.
const CARD_OFF: &str = "card off";

/// A job on a card behind a line whose host is killed, or whose machine is stopped by an input: at any moment, and
/// wherever the arc goes out; or the card is switched off. Each time, the job is resumed.
fn served_case(seed: u64) -> Result<Verdict, String> {
    let mut chance = TestRandom::new(seed);
    let bench = Bench::new();
    let number = seed / SERVED;
    let kind = MachineKind { senses: number.is_multiple_of(2), homes: (number / 2).is_multiple_of(2) };
    let program = bench.file("part.ngc", program(&mut chance));
    let (whole, uninterrupted) = run(&bench, (&program, kind), "", "", "whole.vcd");
    let length_mm = judge(&uninterrupted, &uninterrupted, &JUDGED).cut_mm;
    let faults = faults(&mut chance, seed, length_mm);
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd").display().to_string());
    let speed = SPEED.to_string();
    let mut card =
        ServedCard::with(&["--machine", &machine, "--source-faults", &faults, "--vcd", &vcd, "--speed", &speed]);
    let job_s = whole.number("periods") / 1000.0 / SPEED;
    let port = card.port.clone();
    if kind.homes {
        card.home(&bench)?;
    }
    let mut arguments = vec!["run", "part.ngc", "--card", &port, "--machine", "m.toml", "--json"];
    let mut told = format!("{faults}\n");
    let mut kills = 1 + chance.below(3);
    for _ in 0..40 {
        let kill_s = if kills == 0 { f64::INFINITY } else { job_s * chance.below(1000) as f64 / 1000.0 };
        kills = kills.saturating_sub(1);
        // a card without home switches has no position once it was off
        let stop = STOPS[chance.below(STOPS.len())].filter(|&stop| kind.homes || stop != CARD_OFF);
        let HostEnd { code, out, was_stopped } = host_until(&bench, &arguments, &mut card, (kill_s, stop))?;
        told += &out;
        if code == Some(0) {
            let ended = card.end();
            let verdict = judge_served(&uninterrupted, bench.path("pins.vcd"), &JUDGED);
            let [counts, counted] = ["counts", "counted"]
                .map(|key| (0..3).filter_map(|axis| ended[key][axis].as_i64()).collect::<Vec<i64>>());
            let is_good = verdict.is_good() && counts == whole.counts() && is_homed_at(&counts, &counted);
            return if is_good { Ok(verdict) } else { Err(format!("{verdict:?} {counts:?} {counted:?}\n{told}")) };
        }
        arguments = vec!["resume", "--yes", "--json"];
        if was_stopped && stop == Some(CARD_OFF) {
            told += &homed_again(&bench, &card)?;
        }
    }
    Err(format!("it does not end\n{told}"))
}

/// Homes the axes of a card that was switched off; before, the job is refused and nothing moves.
fn homed_again(bench: &Bench, card: &ServedCard) -> Result<String, String> {
    let refused = bench.retrace(["resume", "--yes", "--json"]);
    let told = format!("--- after the card was off: {:?}\n{}{}\n", refused.code, refused.out, refused.err);
    // or nothing had begun
    let is_refused = ["E2213", "E2209"].iter().any(|number| refused.err.contains(number));
    if refused.code == Some(2) && is_refused { Ok(told + &card.home(bench)?) } else { Err(told) }
}

/// Number of interruptions by their causes.
static CAUSES: Mutex<BTreeMap<String, u32>> = Mutex::new(BTreeMap::new());

fn count_cause(cause: &str) {
    *CAUSES.lock().expect("no panic").entry(cause.to_owned()).or_default() += 1;
}

/// How a host ended.
struct HostEnd {
    /// Its exit code; `None` where it was killed.
    code: Option<i32>,
    out: String,
    /// Whether the machine, the line or the card was stopped.
    was_stopped: bool,
}

/// Runs a host and kills it at this time, or stops the machine, the line or the card then; kills it where it waits
/// because the torch went out.
fn host_until(
    bench: &Bench,
    arguments: &[&str],
    card: &mut ServedCard,
    (mut stop_s, stop): (f64, Option<&str>),
) -> Result<HostEnd, String> {
    let mut was_stopped = false;
    let mut host = bench.start(arguments, Stdio::null(), "host.txt");
    let begun = Instant::now();
    let read = || std::fs::read_to_string(bench.path("host.txt")).unwrap_or_default();
    loop {
        thread::sleep(Duration::from_millis(20));
        if let Some(status) = host.try_wait().expect("a child") {
            let code = status.code();
            let out = read();
            // an alarm of the silent host before, or no job yet that could be resumed
            let is_known = matches!(code, Some(0 | 2 | 3));
            return if is_known { Ok(HostEnd { code, out, was_stopped }) } else { Err(format!("{code:?}\n{out}")) };
        }
        let waits = ["lost", "not_started", "not_latched", "no_sheet", "sheet_contact"]
            .iter()
            .any(|why| read().contains(&format!("\"reason\":\"{why}\"")));
        if let Some(input) = stop.filter(|_| !waits && begun.elapsed().as_secs_f64() > stop_s) {
            let (begins, ends, most) = match input {
                CABLE => ("unplug".to_owned(), "plug in".to_owned(), 250),
                CARD_OFF => ("power off".to_owned(), "power on".to_owned(), 250),
                // at rest a breakaway stops nothing
                _ => (format!("press {input}"), format!("release {input}"), 25),
            };
            card.operate(&begins);
            for _ in 0..most {
                thread::sleep(Duration::from_millis(20));
                if host.try_wait().expect("a child").is_some() {
                    break;
                }
            }
            card.operate(&ends);
            thread::sleep(Duration::from_millis(100));
            (stop_s, was_stopped) = (f64::INFINITY, true);
            count_cause(input);
            continue;
        }
        if waits || begun.elapsed().as_secs_f64() > stop_s.min(MAX_JOB_S) {
            thread::sleep(Duration::from_millis(100));
            host.kill().expect("it is killed");
            host.wait().expect("it ends");
            count_cause(if waits { "loss" } else { "KILL" });
            let out = read();
            // it may have come to its end meanwhile
            let code = out.contains("\"exit_code\":0").then_some(0);
            return Ok(HostEnd { code, out, was_stopped });
        }
    }
}

fn case(seed: u64) -> Result<Verdict, String> {
    let mut chance = TestRandom::new(seed);
    let bench = Bench::new();
    let kind = MachineKind { senses: seed % SENSING == 1, homes: false };
    let program = bench.file("part.ngc", program(&mut chance));
    let (whole, uninterrupted) = run(&bench, (&program, kind), "", "", "whole.vcd");
    if whole.report["outcome"] != "completed" {
        return Err(format!("the whole job: {}", whole.output.err));
    }
    let length_mm = judge(&uninterrupted, &uninterrupted, &JUDGED).cut_mm;
    let faults = faults(&mut chance, seed, length_mm);
    // or the operator interrupts
    let mut script = match chance.below(5) {
        2 => {
            let (at_s, back_s) = (0.5 + chance.below(60) as f64 / 10.0, 0.2 + chance.below(20) as f64 / 10.0);
            format!("at {at_s:.2}s reverse 100%\nafter {back_s:.2}s forward 100%\n")
        }
        0 => format!("at {:.2}s hold\n", 0.5 + chance.below(60) as f64 / 10.0),
        1 => format!("at {:.2}s cutter off\n", 0.5 + chance.below(60) as f64 / 10.0),
        _ => String::new(),
    };
    let mut last = String::new();
    for _ in 0..40 {
        let (run, trace) = run(&bench, (&program, kind), &faults, &script, "pins.vcd");
        if run.report["outcome"] == "completed" {
            let axes = [160.0, 160.0, 640.0]
                .map(|pulses_per_mm| retrace_tests::limits::Axis { pulses_per_mm, limits: [200.0, 2500.0, 40000.0] });
            let audit = audit(&run.records.clone().with_layer(2), &axes, 0.001);
            if audit.violations != [0; 3] || run.counts() != whole.counts() {
                return Err(format!("limits or counts: {:?}\n{script}\n{faults}", audit.first));
            }
            for event in run.of_kind("cutter_off") {
                count_cause(event["reason"].as_str().unwrap_or_default());
            }
            for part in ["reverse", "lead arc", "lead line"].into_iter().filter(|part| script.contains(part)) {
                count_cause(part);
            }
            let judged = JudgedMachine { has_lead_ins: script.contains("shift"), ..JUDGED };
            let verdict = judge(&uninterrupted, &trace, &judged);
            return if verdict.is_good() {
                Ok(verdict)
            } else {
                Err(format!("{verdict:?}\n{script}\n{faults}\n{}\n{}", run.output.out, run.output.err))
            };
        }
        // since the last interruption, or the last command, the job waits for the operator
        let waits = run.events.iter().filter(|event| is_interruption(event)).filter_map(time_s).fold(0.0, f64::max);
        script += &recovery(&mut chance, waits);
        last = run.output.out;
    }
    Err(format!("it does not end\n{script}\n{faults}\n{last}"))
}

/// Whether the job waits for the operator from here on.
fn is_interruption(event: &Value) -> bool {
    event["event"] == "cutter_off" || event["event"] == "operator"
}

fn time_s(event: &Value) -> Option<f64> {
    event["time_s"].as_f64()
}

#[test]
fn an_interrupted_cut_is_recovered_whole() {
    let first: u64 = std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let count = u64::from(cases(SUITE));
    let mut failures = Vec::new();
    let mut ignitions = 0;
    for seed in first..first + count {
        let result = if seed % SERVED == 0 { served_case(seed) } else { case(seed) };
        match result {
            Ok(verdict) => ignitions += verdict.ignitions,
            Err(why) => {
                println!("WRONG seed {seed}");
                failures.push(format!("seed {seed}: {why}"));
            }
        }
    }
    let causes = CAUSES.lock().expect("no panic");
    println!("{count} jobs, {ignitions} ignitions, {} failed, interrupted by {causes:?}", failures.len());
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}
