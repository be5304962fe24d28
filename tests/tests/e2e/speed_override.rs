//! The override of the speed of the spindle (SPN-7), at the pins of the card.
//!
//! Invariant: S is that of the output, in every period.

use std::f64::consts::TAU;

use retrace_tests::pins::{Sample, run_with_pins};
use retrace_tests::records::RATE_ONE;
use retrace_tests::run::Run;

const MACHINE: &str = "[spindle]\nmin_rpm = 300\nmax_rpm = 3000\nfeed_per_turn = \"commanded\"\n";
/// Control periods in which a command is in force.
const SETTLED: usize = 5;

fn rpm(sample: &Sample) -> f64 {
    sample.outputs.get("speed").map_or(0.0, |&thousandths| thousandths as f64 / 1000.0)
}

fn run(program: &str, script: &str) -> (Run, Vec<Sample>) {
    let (run, trace) = run_with_pins(MACHINE, program, script, &[]);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    run.assert_exact_and_legal();
    (run, trace)
}

/// S in the motion of a line, without the first periods of it, each value once.
fn speeds(trace: &[Sample], line: u64) -> Vec<f64> {
    let moving = trace.iter().filter(|sample| sample.line == line && sample.rate != 0.0).skip(SETTLED);
    let mut speeds: Vec<f64> = moving.map(rpm).collect();
    speeds.dedup();
    speeds
}

/// Within the range of the spindle, also for an S that comes later, and with the same path.
#[test]
fn s_follows_the_override_within_the_range_of_the_spindle() {
    const PROGRAM: &str =
        "G21 G90 F1200\nS1000 M3\nG1 X20\nG1 X40\nS2000\nG1 X60\nG1 X80\nS1000\nG1 X100\nM5\nG4 P0.1\nM2\n";
    let script = "at line 4 speed override 150%\nat line 6 speed override 170%\nat line 7 speed override 20%\n\
        at line 9 speed override 250%\nafter 0.1s speed override 100%\n";
    let (changed, trace) = run(PROGRAM, script);
    assert_eq!(speeds(&trace, 3), [1000.0]);
    assert_eq!(speeds(&trace, 4), [1500.0]);
    assert_eq!(speeds(&trace, 6), [3000.0], "170 % of 2000 is beyond the range");
    assert_eq!(speeds(&trace, 7), [400.0]);
    // What is beyond 200 % is refused, and changes nothing; 20 % of 1000 is below the range.
    assert_eq!(speeds(&trace, 9), [300.0, 1000.0]);
    assert!(changed.of_kind("command_rejected").any(|event| event["reason"].to_string().contains("200 %")));
    assert!(trace.last().is_some_and(|last| !last.is_on("spindle")), "M5 is M5");
    let (plain, _) = run(PROGRAM, "");
    let path = |run: &Run| run.records.rows.iter().map(|row| row.increments.clone()).collect::<Vec<_>>();
    assert!(path(&changed) == path(&plain), "the records are the same");
}

/// M51 P0 and M49 switch it off from their place on, M51 and M48 on again; the request is kept.
#[test]
fn the_program_switches_the_speed_override_off_and_on() {
    const PROGRAM: &str =
        "G21 G90 F1200\nS1000 M3\nG1 X20\nM51 P0\nG1 X40\nM51\nG1 X60\nM49\nG1 X80\nM48\nG1 X100\nM2\n";
    let (_, trace) = run(PROGRAM, "at 0s speed override 70%\n");
    for (line, is_on) in [(3, true), (5, false), (7, true), (9, false), (11, true)] {
        assert_eq!(speeds(&trace, line), [if is_on { 700.0 } else { 1000.0 }], "line {line}");
    }
}

/// Under G96 every change of S is that of the radius, times the override.
#[test]
fn a_surface_speed_is_overridden_at_every_place() {
    const PROGRAM: &str = "G21 G90 F3000\nG0 X40\nG96 S100 D2500 M3\nG1 X15\nG97 S500\nM5\nM2\n";
    let (_, trace) = run(PROGRAM, "at 0s speed override 80%\n");
    let moving: Vec<&Sample> = trace.iter().filter(|sample| sample.line == 4 && sample.rate != 0.0).collect();
    assert!(moving.len() > 300);
    for sample in &moving[SETTLED..] {
        let exact = 0.8 * 100_000.0 / (TAU * sample.counts[0] as f64 / 1000.0);
        assert!((rpm(sample) / exact - 1.0).abs() < 0.015, "{exact} {sample:?}");
    }
}

/// A feed per turn is never above F: a slower spindle takes the feed with it, a faster one does not.
#[test]
fn a_slower_spindle_takes_the_feed_per_turn_with_it() {
    const PROGRAM: &str = "G21 G90\nS1000 M3\nG95 F0.5\nG1 X20\nG1 X40\nG94 F600\nG1 X60\nM5\nM2\n";
    let (run, _) = run(PROGRAM, "at 0s speed override 50%\nat line 5 speed override 200%\n");
    let fastest = |line: u64| {
        let rows = run.records.rows.iter().filter(|row| row.line == line);
        rows.skip(200).map(|row| row.rate_nano).max().unwrap_or_default()
    };
    assert_eq!([4, 5, 7].map(fastest), [500_000_000, RATE_ONE, RATE_ONE]);
}

/// A hold, and the way back along the path, ask nothing of the operator because S is overridden.
#[test]
fn an_overridden_speed_is_no_output_that_differs() {
    const PROGRAM: &str = "G21 G90 F1200\nS1000 M3\nG1 X20\nG1 X60\nM5\nM2\n";
    let script = "at line 4 speed override 60%\nafter 0.2s hold\nafter 1s speed override 90%\nafter 0.5s resume\n\
        after 0.3s reverse 50%\nafter 0.3s speed override 80%\nafter 0.3s leave\n";
    let (run, trace) = run(PROGRAM, script);
    assert_eq!(run.of_kind("outputs_differ").count(), 0, "{}", run.output.out);
    let last = trace.iter().rfind(|sample| sample.line == 4 && sample.rate > 0.0).expect("a sample");
    assert_eq!(rpm(last), 800.0);
    assert!(trace.iter().filter(|sample| sample.line == 4).all(|sample| sample.is_on("spindle")));
    // Nor where the program has switched S under the override.
    let before =
        "at 0s speed override 60%\nat line 4 hold\nafter 1s resume\nafter 0.3s reverse 50%\nafter 0.3s leave\n";
    let (run, trace) = self::run(PROGRAM, before);
    assert_eq!(run.of_kind("outputs_differ").count(), 0, "{}", run.output.out);
    assert_eq!(speeds(&trace, 4), [600.0]);
}

/// In a thread S is that of the program.
#[test]
fn a_thread_is_cut_at_the_programmed_speed() {
    let machine = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\n";
    let program = "G21 G90\nS1000 M3\nG0 X2 Z5\nG33 Z-20 K1.5\nG0 X4\nG0 Z5\nG4 P0.5\nG1 X9 F600\nM5\nM2\n";
    let (run, trace) = run_with_pins(machine, program, "at 0s speed override 130%\n", &[]);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    assert_eq!(speeds(&trace, 4), [1000.0]);
    assert_eq!(speeds(&trace, 8), [1300.0]);
}

/// With `thread_override = "limited"` it acts in the thread, up to the speed it is planned for: the path is the same.
#[test]
fn a_thread_is_cut_at_the_overridden_speed_up_to_its_plan() {
    let machine = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\nthread_override = \"limited\"\n";
    let program = "G21 G90\nS1000 M3\nG0 X2 Z5\nG33 Z-60 K1.5\nG0 X4\nG0 Z5\nG4 P0.5\nG1 X9 F600\nM5\nM2\n";
    let script = "at 0s speed override 130%\nat 1.2s speed override 70%\n";
    let (run, trace) = run_with_pins(machine, program, script, &[]);
    assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
    assert_eq!(speeds(&trace, 4), [1250.0, 700.0]);
    assert_eq!(speeds(&trace, 8), [700.0]);
    assert_eq!(run.report["limit_violations"], 0, "{}", run.report);
    let counts = trace.last().expect("a sample").counts;
    assert_eq!(counts, [9_000, 0, 5_000]);
}

/// A stop, and a program that ends in an alarm, switch the spindle off; no override switches anything behind it.
#[test]
fn a_stop_and_an_alarm_switch_the_spindle_off() {
    const PROGRAM: &str = "G21 G90 F1200\nS1000 M3\nG1 X20\nG1 X60\nM5\nM2\n";
    const PROBE: &str = "[[card.input]]\nnumber = 0\nuse = \"probe\"\n[probe]\nspindle = \"may-turn\"\n";
    const TOUCH: &str = "G21 G90 F1200\nS1000 M3\nG1 X20\nG38.2 X30\nM5\nM2\n";
    for (machine, program, script, outcome) in [
        ("", PROGRAM, "at line 4 speed override 60%\nafter 0.2s stop\nafter 0s speed override 150%\n", "stopped"),
        (PROBE, TOUCH, "at line 3 speed override 60%\nafter 0.2s speed override 150%\n", "alarm"),
    ] {
        let (run, trace) = run_with_pins(&format!("{machine}{MACHINE}"), program, script, &[]);
        assert_eq!(run.report["outcome"], outcome, "{}", run.output.err);
        assert!(trace.iter().any(|sample| rpm(sample) == 600.0 && sample.is_on("spindle")));
        let off = trace.iter().rposition(|sample| sample.is_on("spindle")).map_or(0, |last| last + 1);
        assert!(off < trace.len() && trace[off..].iter().all(|sample| sample.at_rest), "{outcome}");
    }
}
