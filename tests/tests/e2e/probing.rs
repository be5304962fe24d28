//! Programs that ask a probe (PRB-1 to PRB-15), by the command and a card with simulated work.
//!
//! Invariant: a touch is compared with where the work is, in whole pulses.

use std::fs;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::limits::audit;
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;
use serde_json::Value;

const PROBE: &str = "[[card.input]]\nnumber = 0\nuse = \"probe\"\n";
/// The plane is at the next pulse; below and on it the probe is in contact.
const PLANE: &str = "z<-5.4321";
const TOUCH: i64 = -5432;
const PART: &str = "G21 G90 F300\nG1 X2\nG38.2 Z-10 F300\n(print,touch #5063 flag #5070)\nG1 X5\nG1 Z2\nM2\n";

fn bench(machine: &str, program: &str) -> Bench {
    let bench = Bench::new();
    bench.file("m.toml", machine);
    bench.file("part.ngc", program);
    bench
}

fn events(result: &CommandOutput, kind: &str) -> Vec<Value> {
    let events = result.out.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    events.filter(|event| event["event"] == kind).collect()
}

fn messages(result: &CommandOutput) -> Vec<String> {
    events(result, "message").iter().map(|event| event["text"].as_str().unwrap_or_default().to_owned()).collect()
}

fn run(bench: &Bench, work: &str, script: &str) -> Run {
    let operator = bench.file("s.op", script).display().to_string();
    let machine = bench.path("m.toml").display().to_string();
    Run::of(bench, &bench.path("part.ngc"), &["--machine", &machine, "--work", work, "--operator", &operator])
}

/// 1 000 touches at 10 mm/s with control periods of 0.5 to 5 ms, each begun at another height.
#[test]
fn a_touch_is_the_same_pulse_at_any_control_period() {
    let program = "G21 G90\no100 repeat [250]\n#1 = [#1 + 1]\nG0 Z[0.0013 * #1]\nG38.2 Z-1 F600\n\
        (print,#5063 #5070)\no100 endrepeat\nG0 Z0\nM2\n";
    for (period_ms, bounce_ms) in [("0.5", 0), ("1", 3), ("2", 0), ("5", 2)] {
        let bench = bench(&format!("control_period_ms = {period_ms}\n{PROBE}"), program);
        let work = format!("z<-0.4321;bounce-ms={bounce_ms}");
        let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", &work, "--json"]);
        assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
        let found = messages(&result);
        assert!(found.iter().all(|text| text == &found[0]), "{period_ms} {work}: {found:?}");
        assert_eq!((found.len(), &*found[0]), (250, "-0.432000 1.000000"), "{period_ms} {work}");
    }
}

#[test]
fn the_path_of_a_probing_move_is_retraced_and_run_again_to_the_pulse() {
    let bench = bench(PROBE, PART);
    let whole = run(&bench, PLANE, "");
    assert_eq!(whole.output.code, Some(0), "{}", whole.output.err);
    assert_eq!(messages(&whole.output), ["touch -5.432000 flag 1.000000"]);
    assert_eq!(events(&whole.output, "probed")[0]["counts"][2], TOUCH);
    let back = run(&bench, PLANE, "at line 6 reverse 100%\nafter 9s leave\n");
    assert_eq!(back.output.code, Some(0), "{}", back.output.err);
    // nothing is measured again
    assert_eq!(events(&back.output, "probed").len(), 1, "{}", back.output.out);
    assert_eq!((whole.counts(), back.counts()), (vec![5000, 0, 2000], vec![5000, 0, 2000]));
    let mut sum = [0; 3];
    let mut has_moved = false;
    let mut returned = false;
    for row in &back.records.rows {
        sum.iter_mut().zip(&row.increments).for_each(|(sum, n)| *sum += n);
        has_moved |= sum[0] > 2000;
        returned |= has_moved && sum == [0; 3];
    }
    assert!(returned, "the machine was not back at the begin of the path");
    let axes = vec![BUILT_IN; 3];
    for run in [&whole, &back] {
        assert_eq!(
            audit(&run.records, &axes, 0.001).violations,
            [0; 3],
            "{:?}",
            audit(&run.records, &axes, 0.001).first
        );
    }
}

const BUILT_IN: retrace_tests::limits::Axis =
    retrace_tests::limits::Axis { limits: [100.0, 1000.0, 20_000.0], pulses_per_mm: 1000.0 };

#[test]
fn a_probe_that_finds_nothing_or_is_in_contact_already_ends_or_goes_on_as_its_code_says() {
    let refused = |code: &str, start: &str, work: &str| {
        let bench = bench(PROBE, &format!("G21 G90 F300\n{start}\n{code} Z-2 F300\n(print,#5063 #5070)\nM2\n"));
        let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", work, "--json"]);
        let number = events(&result, "alarm").first().map(|alarm| alarm["number"].clone()).unwrap_or_default();
        (result.code, number.as_str().unwrap_or_default().to_owned(), messages(&result))
    };
    let none: Vec<String> = Vec::new();
    let alarm = |number: &str| (Some(3), number.to_owned(), none.clone());
    let goes_on = |text: &str| (Some(0), String::new(), vec![text.to_owned()]);
    let (far, contact) = ("z<-5", "z<1");
    assert_eq!(refused("G38.2", "", far), alarm("E3029"));
    assert_eq!(refused("G38.2", "", contact), alarm("E3030"));
    assert_eq!(refused("G38.3", "", far), goes_on("-2.000000 0.000000"));
    assert_eq!(refused("G38.3", "", contact), goes_on("0.000000 1.000000"));
    assert_eq!(refused("G38.4", "", contact), alarm("E3029"));
    assert_eq!(refused("G38.4", "", far), alarm("E3030"));
    assert_eq!(refused("G38.5", "", contact), goes_on("-2.000000 0.000000"));
    assert_eq!(refused("G38.5", "", far), goes_on("0.000000 1.000000"));
    // away from the work
    let away = bench(PROBE, "G21 G90 F300\nG38.3 Z-6 F300\nG38.4 Z0\n(print,#5063 #5070)\nM2\n");
    let result = away.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", PLANE, "--json"]);
    assert_eq!(messages(&result), ["-5.431000 1.000000"], "{}", result.err);
}

#[test]
fn what_cannot_be_probed_is_refused_before_anything_moves() {
    let refused = |machine: &str, program: &str| {
        let bench = bench(machine, program);
        let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--json"]);
        assert!(!result.out.contains("\"started\""), "{}", result.out);
        (result.code, result.err)
    };
    for (number, machine, program) in [
        ("E4310", "control_period_ms = 1\n", "G38.2 Z-1 F60\nM2\n"),
        ("E4311", "[probe]\novertravel_mm = 0.1\n", "G38.2 Z-1 F600\nM2\n"),
        ("E4312", "", "M3 S100\nG38.2 Z-1 F60\nM5\nM2\n"),
        ("E1719", "", "G38.2 Z0 F60\nM2\n"),
    ] {
        let inputs = if number == "E4310" { "[[card.input]]\nnumber = 0\nuse = \"plain\"\n" } else { PROBE };
        let (code, err) = refused(&format!("{machine}{inputs}"), &format!("G21 G90\n{program}"));
        assert!(code == Some(1) && err.contains(number), "{number}: {code:?} {err}");
    }
}

#[test]
fn a_probe_that_trips_in_another_move_stops_the_machine() {
    let bench = bench(PROBE, "G21 G90 F300\nG0 Z-8\nM2\n");
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", PLANE, "--json"]);
    assert_eq!(result.code, Some(3), "{}", result.err);
    assert_eq!(events(&result, "alarm")[0]["number"], "E3028", "{}", result.out);
    bench.file("m.toml", format!("{PROBE}[probe]\nguard = false\n"));
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", PLANE, "--json"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
}

#[test]
fn a_hold_leaves_the_latch_armed_and_overrides_do_not_act() {
    let bench = bench(PROBE, PART);
    let whole = run(&bench, PLANE, "");
    let held = run(&bench, PLANE, "at line 3 override 40%\nat line 3 hold\nafter 2s resume\n");
    for run in [&whole, &held] {
        assert_eq!(run.output.code, Some(0), "{}", run.output.err);
        assert_eq!(messages(&run.output), ["touch -5.432000 flag 1.000000"]);
    }
    assert!(held.report["held_s"].as_f64().is_some_and(|held| (1.5..2.5).contains(&held)), "{}", held.report);
}

/// The host is killed behind the first of two touches, or within the second: what was answered is not asked again, and
/// the job ends where an uninterrupted one does.
#[test]
fn a_job_that_is_killed_while_it_probes_is_resumed_without_asking_twice() {
    let program = "G21 G90 F300\nG38.2 Z-10 F300\n#7 = #5063\nG0 Z0\nG1 X2\nG38.2 Z-10 F120\n\
        (print,#7 #5063)\nG0 Z1\nG1 X5 F300\nM2\n";
    let machine = format!("[card]\nwatchdog_ms = 2000\n{PROBE}");
    for (event, times, answered) in [("probed", 1, 1), ("switching", 2, 1), ("probed", 2, 2)] {
        let bench = bench(&machine, program);
        let path = bench.path("m.toml").display().to_string();
        let card = ServedCard::with(&["--machine", &path, "--work", PLANE, "--speed", "4"]);
        let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json", "--journal", "jobs"];
        let mut child = bench.start(&arguments, Stdio::null(), "out.txt");
        let begun = Instant::now();
        let is_there = |text: &str| text.matches(&format!("\"event\":\"{event}\"")).count() == times;
        while !fs::read_to_string(bench.path("out.txt")).is_ok_and(|text| is_there(&text)) {
            assert!(begun.elapsed() < Duration::from_secs(30), "{event} {times} was not reached");
            thread::sleep(Duration::from_millis(5));
        }
        thread::sleep(Duration::from_millis(80));
        child.kill().expect("it is killed");
        child.wait().expect("it ends");
        let result = bench.retrace(["resume", "--journal", "jobs", "--yes", "--json"]);
        assert_eq!(result.code, Some(0), "{event} {times}: {}{}", result.out, result.err);
        assert_eq!(events(&result, "probed").len(), 2 - answered, "{event} {times}: {}", result.out);
        let report = events(&result, "report").pop().expect("a report");
        assert_eq!((&report["position_counts"]["x"], &report["position_counts"]["z"]), (&5000.into(), &1000.into()));
        let counts = card.identify(&bench)["counts"].clone();
        assert_eq!((&counts[0], &counts[2]), (&5000.into(), &1000.into()), "{event} {times}");
    }
}

/// Offset, rotation, inches and diameter: the parameter, turned back, is the pulse.
#[test]
fn a_touch_is_told_in_the_coordinates_and_units_of_its_block() {
    let program = "G20 G90 F10\nG10 L2 P1 X1 Y2 Z0.5 R30\nG54\nG43.1 Z0.25\nG38.2 Z-2\n\
        (print,#5061 #5062 #5063 #5070)\n(print,#5063 #5023 #5422)\nM2\n";
    let bench = bench(PROBE, program);
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", PLANE, "--json"]);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    let numbers: Vec<Vec<f64>> = messages(&result)
        .iter()
        .map(|text| text.split(' ').map(|word| word.parse().expect("a number")).collect())
        .collect();
    // The machine stands at its origin; the program's X and Y there are those of the rotated system.
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    let expected = [-cos - 2.0 * sin, sin - 2.0 * cos, f64::from(TOUCH as i32) / 25_400.0 - 0.75, 1.0];
    for (found, expected) in numbers[0].iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{numbers:?} {expected}");
    }
    // As programs compute it: the machine position of the touch, with the tool offset.
    let [touch, machine, rest] = numbers[1][..] else { panic!("{numbers:?}") };
    let counts = (touch + machine - rest) * 25_400.0;
    assert!((counts - TOUCH as f64).abs() < 0.1, "{counts}");
}

/// What a program prints behind its last motion is printed before the job ends.
#[test]
fn a_message_behind_the_last_motion_is_printed() {
    for program in ["(MSG,hello)\nM2\n", "G21\nG1 X1 F600\n(MSG,hello)\nM2\n", "G21\nG38.3 Z-1 F600\n(MSG,hello)\nM2\n"]
    {
        let bench = bench(PROBE, program);
        let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--json"]);
        assert_eq!((result.code, messages(&result)), (Some(0), vec!["hello".to_owned()]), "{program}: {}", result.out);
    }
}

#[test]
fn the_example_finds_the_corner_of_its_plate() {
    let bench = bench(PROBE, "");
    let program = retrace_tests::command::root().join("examples/probing/touch-off.ngc").display().to_string();
    let result = bench.retrace(["run", &program, "--work", "box=10:40,10:30,-20:-4.2", "--json"]);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    assert_eq!(messages(&result), ["edge at X11.000000, top at Z-4.200000"]);
}
