//! Random jobs on jet, plasma, laser and router machines, stopped, held, paused, killed, cut off and resumed: the
//! cutter is off outside of a cut and its pierce, a beam has no power at rest, and no feed begins before the cutter is
//! ready. The pins are checked by an observer that has the program alone.

use std::collections::BTreeMap;
use std::process::Stdio;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, cases};
use retrace_tests::cutter_observer::{Observation, ObservedPins, Rules, observe};
use retrace_tests::sender::TestRandom;
use retrace_tests::served::ServedCard;

/// Factor of the card's time over wall time.
const SPEED: f64 = 5.0;
/// Watchdog of the jobs, in the card's time: it tolerates a computer under load.
const WATCHDOG_MS: f64 = 1500.0;
/// Number of hosts and cards at a time.
const AT_A_TIME: usize = 3;
/// Time in the card before it counts a standstill (`handover_ms`).
const HANDOVER_MS: f64 = 100.0;

/// Jobs that the suite runs: a jet that is killed, and those by which the campaign found a defect.
const SUITE: [u64; 5] = [56, 27, 219, 492, 734];

/// Jobs to be run: those of the suite, or the requested number from a seed on.
fn seeds() -> Vec<u64> {
    let first = std::env::var("RETRACE_FIRST_SEED").ok().and_then(|text| text.parse().ok());
    first.map_or_else(|| SUITE.to_vec(), |first: u64| (first..).take(cases(SUITE.len() as u32) as usize).collect())
}

/// A kind of machine, with the cutter of its template.
struct Kind {
    template: &'static str,
    on: &'static str,
    off: &'static str,
    fire: &'static str,
    /// Shortest duration of the instruction; and longest, with the input that it waits for.
    ready_ms: [f64; 2],
    grace_ms: Option<f64>,
}

const KINDS: [Kind; 4] = [
    Kind {
        template: "waterjet",
        on: "M101",
        off: "M102",
        fire: "out3",
        ready_ms: [1500.0, 1500.0],
        grace_ms: Some(500.0),
    },
    // A start in motion lasts its pilot arc of 300 ms; over a kerf no arc strikes, and an attempt lasts its limit of
    // 500 ms, or up to that and the pierce.
    Kind { template: "plasma", on: "M3 S1", off: "M5", fire: "spindle", ready_ms: [300.0, 910.0], grace_ms: Some(0.0) },
    Kind { template: "laser", on: "S600 M4", off: "M5", fire: "spindle", ready_ms: [50.0, 50.0], grace_ms: Some(0.0) },
    Kind { template: "router", on: "M3 S1000", off: "M5", fire: "spindle", ready_ms: [4000.0, 4000.0], grace_ms: None },
];

/// A program, and the lines that it cuts.
fn program(kind: &Kind, chance: &mut TestRandom) -> (String, Vec<u64>) {
    let (mut lines, mut cut) = (vec!["G21 G90 G94 F1800".to_owned(), "G64 P0.05".to_owned()], Vec::new());
    let place = |chance: &mut TestRandom| (20 + chance.below(60), 20 + chance.below(60));
    for _ in 0..2 + chance.below(2) {
        let (x, y) = place(chance);
        lines.push(format!("G0 X{x} Y{y}"));
        lines.push(kind.on.to_owned());
        for _ in 0..1 + chance.below(3) {
            let (x, y) = place(chance);
            lines.push(format!("G1 X{x} Y{y}"));
            cut.push(lines.len() as u64);
            if chance.below(8) == 0 {
                lines.push("M0".to_owned());
            }
        }
        lines.push(kind.off.to_owned());
    }
    lines.extend(["G0 X10 Y10".to_owned(), "M2".to_owned(), String::new()]);
    (lines.join("\n"), cut)
}

/// Commands of the operator, who resumes in the end.
fn script(chance: &mut TestRandom) -> String {
    let mut lines = Vec::new();
    for _ in 0..chance.below(4) {
        let (after, rest) = (1 + chance.below(40), 1 + chance.below(12));
        let (after, rest) = (format!("after {:.1}s", after as f64 / 10.0), format!("after {:.1}s", rest as f64 / 10.0));
        let back = ["recover", "resume\nafter 0.2s agree"][chance.below(2)];
        lines.push(match chance.below(8) {
            0 | 1 => format!("{after} hold\n{rest} {back}"),
            2 => format!("{after} override 0%\n{rest} override 100%\nafter 0s {back}"),
            3 => format!("{after} hold\nafter 0.4s reverse 100%\n{rest} leave\nafter 0.3s {back}"),
            4 => format!(
                "{after} pause\n{rest} spindle stop\nafter 0s spindle start\nafter 0s online\nafter 0s cycle start"
            ),
            5 => format!("{after} override 30%\n{rest} override 100%"),
            6 => format!("{after} cutter off\n{rest} {back}"),
            _ => format!("{after} hold\n{rest} output 64 off\nafter 0.1s {back}"),
        });
    }
    if chance.below(4) == 0 {
        lines.push(format!("after {:.1}s stop", chance.below(60) as f64 / 10.0));
    } else {
        // resumes what waits for the operator
        lines.extend((0..6).map(|_| "after 1.5s recover".to_owned()));
    }
    lines.join("\n") + "\n"
}

/// The template of a kind, for a machine that need not be homed and is where the program may go.
fn machine(bench: &Bench, kind: &Kind) -> String {
    let result = bench.retrace(["machine", "new", kind.template]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let watchdog = format!("watchdog_ms = {WATCHDOG_MS:.1}");
    // the laser's power follows the speed
    let out = result.out.replace("\n# power =", "\npower =");
    assert_eq!(out.contains("\npower ="), kind.template == "laser");
    let out = out.replace("start_s = 5.0", "start_s = 0.5");
    assert_eq!(out.contains("start_s = 0.5"), kind.template == "plasma");
    out.replace("allow_unhomed = false", "allow_unhomed = true").replace("watchdog_ms = 250.0", &watchdog)
}

/// One job: results of the hosts, and of the observation of the pins.
fn case(seed: u64) -> Result<(Vec<String>, ObservedPins), String> {
    let mut chance = TestRandom::new(seed);
    let kind = &KINDS[chance.below(KINDS.len())];
    let bench = Bench::new();
    let (text, cut_lines) = program(kind, &mut chance);
    let operator = script(&mut chance);
    let (trace, part) = (bench.path("trace.vcd"), bench.file("part.ngc", &text));
    bench.file("machine.toml", machine(&bench, kind));
    bench.file("do.op", &operator);
    let standing_ms = kind.grace_ms.map(|grace| grace + HANDOVER_MS);
    let rules =
        Rules { fire: kind.fire.into(), cut_lines, ready_ms: [kind.ready_ms[0] - 1.0, kind.ready_ms[1]], standing_ms };
    let observation: Observation = observe(trace.clone(), rules);
    let mut served = vec!["--speed".to_owned(), SPEED.to_string(), "--vcd".into(), trace.display().to_string()];
    served.extend(["--machine".into(), bench.path("machine.toml").display().to_string()]);
    let pulls = if chance.below(3) == 0 {
        let (at, ms) = (2000 + chance.below(12_000), 20 + chance.below(900));
        let way = ["up.", "down.", ""][chance.below(3)];
        served.extend(["--faults".into(), format!("{way}lose@{at}+{ms}")]);
        format!(", {way}lose@{at}+{ms}")
    } else {
        String::new()
    };
    let card = ServedCard::with(&served.iter().map(String::as_str).collect::<Vec<_>>());
    let port = card.port.clone();
    let part = part.display().to_string();
    let run = ["run", &part, "--card", &port, "--machine", "machine.toml", "--operator", "do.op", "--json"];
    let mut hosts = vec![hosted(&bench, &run, &mut chance)];
    for _ in 0..chance.below(3) {
        hosts.push(hosted(&bench, &["resume", "--yes", "--json"], &mut chance));
    }
    let (ends, events): (Vec<String>, Vec<String>) = hosts.into_iter().unzip();
    // longer than the watchdog, and than any stop
    thread::sleep(Duration::from_secs_f64((WATCHDOG_MS + 1000.0) / 1000.0 / SPEED));
    let told = card.end();
    let mut seen = observation.ended();
    if seen.on_at_end {
        seen.violations.push("on at the end".to_owned());
    }
    if seen.violations.is_empty() {
        return Ok((ends, seen));
    }
    let found = format!("{}\n{}", seen.violations.join("\n"), seen.before.join("; "));
    Err(format!(
        "seed {seed}: {}{pulls}, {ends:?}\n{found}\n{told}\n{text}\n{operator}\n{}",
        kind.template,
        events.join("\n")
    ))
}

/// Runs a host, killed at some moment or not; returns how it ended, and its events.
fn hosted(bench: &Bench, arguments: &[&str], chance: &mut TestRandom) -> (String, String) {
    let end = run_host(bench, arguments, chance);
    (end, std::fs::read_to_string(bench.path("said.txt")).unwrap_or_default())
}

fn run_host(bench: &Bench, arguments: &[&str], chance: &mut TestRandom) -> String {
    let most = if chance.below(5) < 2 { chance.below(4000) as u64 } else { 9000 };
    let mut child = bench.start(arguments, Stdio::null(), "said.txt");
    let until = Instant::now() + Duration::from_millis(most);
    loop {
        match child.try_wait().expect("a child") {
            Some(status) => return status.code().map_or("signal".into(), |code| format!("exit {code}")),
            None if Instant::now() >= until => break,
            None => thread::sleep(Duration::from_millis(10)),
        }
    }
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    "killed".to_owned()
}

#[derive(Default)]
struct Tally {
    ends: BTreeMap<String, u32>,
    ignitions: u64,
    steps_on: u64,
    steps_back: u64,
    alarms: u64,
    powered: u64,
}

#[test]
fn the_cutter_is_off_outside_of_a_cut_whatever_happens() {
    let (next, seeds, begun) = (AtomicU32::new(0), seeds(), Instant::now());
    let of = seeds.len() as u32;
    let (tally, wrong) = (Mutex::new(Tally::default()), Mutex::new(Vec::new()));
    let report = |jobs: u32| {
        let tally = tally.lock().expect("no panic");
        let Tally { ends, ignitions, steps_on, steps_back, alarms, powered } = &*tally;
        println!(
            "{jobs} jobs in {:.0} s: hosts {ends:?}; {ignitions} ignitions, {steps_on} steps with the cutter on, \
                {steps_back} backward, {alarms} alarms, a beam with power in {powered} periods",
            begun.elapsed().as_secs_f64()
        );
    };
    thread::scope(|scope| {
        for _ in 0..AT_A_TIME {
            scope.spawn(|| {
                while let number = next.fetch_add(1, Ordering::Relaxed)
                    && number < of
                {
                    match case(seeds[number as usize]) {
                        Ok((ends, seen)) => {
                            let mut tally = tally.lock().expect("no panic");
                            ends.into_iter().for_each(|end| *tally.ends.entry(end).or_default() += 1);
                            tally.ignitions += seen.ignitions;
                            tally.steps_on += seen.steps_on;
                            tally.steps_back += seen.steps_back;
                            tally.alarms += seen.alarms;
                            tally.powered += seen.powered;
                        }
                        Err(what) => {
                            println!("WRONG {what}");
                            wrong.lock().expect("no panic").push(what);
                        }
                    }
                    if number % 20 == 19 {
                        report(number + 1);
                    }
                }
            });
        }
    });
    report(of);
    let wrong = wrong.into_inner().expect("no panic");
    assert!(wrong.is_empty(), "{} of {of} jobs:\n{}", wrong.len(), wrong.join("\n\n"));
}
