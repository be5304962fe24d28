//! Orienting the spindle, M19, at the card's outputs (SPN-10).
//!
//! Invariant: the spindle and its orientation are never on in one sample of the trace.

use std::fs;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::pause::pause;
use retrace_tests::pins::{Sample, run_with_pins, samples};
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;

const MACHINE: &str = "[spindle]\norient_output = 7\norient_input = 4\norient_angle_deg = 90\n\
    [[card.input]]\nnumber = 4\nuse = \"plain\"\n[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n";

const PROGRAM: &str = "G21 G90 F600\nG1 X2\nM19 R90\nG1 X50\nM2\n";

fn run(program: &str, script: &str) -> (Run, Vec<Sample>) {
    let (run, trace) = run_with_pins(MACHINE, program, script, &[]);
    assert!(!trace.iter().any(|sample| sample.is_on("spindle") && sample.is_on("out7")), "both are on");
    let end = trace.last().expect("a sample");
    assert!(!end.is_on("spindle") && !end.is_on("out7"), "on at the end: {end:?}");
    (run, trace)
}

/// Times in ms at which the orientation is switched on and off.
fn switched_ms(trace: &[Sample]) -> Vec<(bool, u64)> {
    let changes = trace.windows(2).filter(|pair| pair[0].is_on("out7") != pair[1].is_on("out7"));
    changes.map(|pair| (pair[1].is_on("out7"), pair[1].at_us / 1000)).collect()
}

#[test]
fn m19_stops_the_spindle_and_waits_for_the_drive() {
    let program = "G21 G90 F600 S500 M3\nG1 X5\nM19 R90 P1\nG1 X10\nM3\nG1 X15\nM19 R90 Q2\nG0 X20\nM5\nG1 X25\nM2\n";
    let (run, trace) = run(program, "");
    run.assert_exact_and_legal();
    let switched = switched_ms(&trace);
    assert_eq!(switched.iter().map(|change| change.0).collect::<Vec<_>>(), [true, false, true, false], "{switched:?}");
    // The drive of the simulated machine takes 50 ms.
    for (line, (_, on_ms)) in [(4, switched[0]), (8, switched[2])] {
        let first = trace.iter().find(|sample| sample.line == line && sample.rate != 0.0).expect("motion");
        assert!(first.at_us / 1000 >= on_ms + 50 && first.is_on("out7") && !first.is_on("spindle"), "{first:?}");
    }
    // It is held through the moves, and released before M3 and M5.
    let moving = |line: u64| trace.iter().filter(move |sample| sample.line == line && sample.rate != 0.0);
    assert!(moving(4).chain(moving(8)).all(|sample| sample.is_on("out7")));
    assert!(moving(6).all(|sample| sample.is_on("spindle")) && moving(10).all(|sample| !sample.is_on("out7")));
}

#[test]
fn a_drive_that_does_not_report_the_angle_is_an_alarm() {
    // It takes 50 ms.
    let (run, trace) = run("G21 G90 F600 S500 M3\nG1 X5\nM19 R90 Q0.02\nG1 X10\nM2\n", "");
    assert_eq!(run.report["outcome"], "alarm", "{}", run.report);
    let alarm = trace.iter().find(|sample| sample.alarm != 0).expect("an alarm");
    let (_, on_ms) = switched_ms(&trace)[0];
    assert!((19..25).contains(&(alarm.at_us / 1000 - on_ms)), "{on_ms} {alarm:?}");
    assert!(trace.iter().all(|sample| sample.line < 4), "no move behind it");
}

#[test]
fn a_stop_releases_the_spindle() {
    let (run, trace) = run(PROGRAM, "at 2s stop\n");
    assert_eq!(run.report["outcome"], "stopped");
    let switched = switched_ms(&trace);
    assert!(switched.len() == 2 && switched[1].1 >= 2000, "{switched:?}");
}

/// The card does it by itself: the orientation is one of its safe outputs.
#[test]
fn an_emergency_stop_and_a_lost_link_release_the_spindle() {
    for is_stopped in [true, false] {
        let bench = Bench::new();
        bench.file("m.toml", format!("{MACHINE}[card]\nwatchdog_ms = 1000\n"));
        bench.file("part.ngc", PROGRAM);
        let [machine, vcd] = ["m.toml", "pins.vcd"].map(|name| bench.path(name).display().to_string());
        let mut card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd]);
        let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json"];
        let mut child = bench.start(&arguments, Stdio::null(), "told.txt");
        let begun = Instant::now();
        while !fs::read_to_string(bench.path("told.txt")).unwrap_or_default().contains("\"event\":\"switched\"") {
            assert!(begun.elapsed() < Duration::from_secs(30), "the spindle is not oriented");
            thread::sleep(Duration::from_millis(5));
        }
        pause(Duration::from_millis(200));
        if is_stopped {
            card.operate("input 13 on");
        } else {
            child.kill().expect("it is killed");
        }
        pause(Duration::from_millis(1500));
        let _ = card.end();
        let _ = child.kill();
        let _ = child.wait();
        let trace = samples(&bench.path("pins.vcd"));
        let switched = switched_ms(&trace);
        assert_eq!(switched.iter().map(|change| change.0).collect::<Vec<_>>(), [true, false], "{switched:?}");
        let first = trace.iter().find(|sample| sample.alarm != 0).expect("an alarm");
        assert!(switched[1].1.abs_diff(first.at_us / 1000) <= 2, "{is_stopped} {switched:?} {first:?}");
    }
}

#[test]
fn an_angle_that_the_drive_does_not_have_is_refused() {
    for (machine, orient, parts) in [
        (MACHINE, "M19 R0", ["E4318", "90"]),
        (MACHINE, "M19 P1", ["E4318", "90"]),
        ("name = \"mill\"\n", "M19 R90", ["E4302", "orient_output"]),
    ] {
        let bench = Bench::new();
        bench.file("m.toml", machine);
        bench.file("part.ngc", format!("G21 G90 F100\n{orient}\nG1 X5\nM2\n"));
        for command in ["check", "run"] {
            let result = bench.retrace([command, "part.ngc", "--machine", "m.toml", "--json"]);
            assert_eq!(result.code, Some(1), "{}", result.out);
            assert_contains(&format!("{}{}", result.out, result.err), &parts);
            assert!(!result.out.contains("\"started\""), "{}", result.out);
        }
    }
}
