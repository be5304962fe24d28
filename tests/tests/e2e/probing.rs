//! Programs that ask a probe (PRB-1 to PRB-15), by the command and a card with simulated work.
//!
//! Invariant: a touch is compared with where the work is, in whole pulses.

use std::fs;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::limits::audit;
use retrace_tests::pins::samples;
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
    let seconds = |name: &str| whole.report[name].as_f64().unwrap_or_default();
    let total = whole.report["periods"].as_f64().unwrap_or_default() / 1000.0;
    assert!(seconds("motion_s") > total - 0.02 && seconds("switch_s") < 0.02, "{}", whole.report);
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
        assert!(events(&result, "alarm").iter().all(|alarm| alarm["line"] == 3), "{}", result.out);
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
    // Without a way the state of the probe is asked for.
    let asked = bench(PROBE, "G21 G90 F300\nG38.3 Z0 F300\n(print,#5070)\nG38.5 Z0\n(print,#5070)\nM2\n");
    for (work, answers) in [(far, ["0.000000", "1.000000"]), (contact, ["1.000000", "0.000000"])] {
        let result = asked.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", work, "--json"]);
        assert_eq!(messages(&result), answers, "{}", result.err);
    }
    // away from the work
    let away = bench(PROBE, "G21 G90 F300\nG38.3 Z-6 F300\nG38.4 Z0\n(print,#5063 #5070)\nM2\n");
    let result = away.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", PLANE, "--json"]);
    assert_eq!(messages(&result), ["-5.431000 1.000000"], "{} {}", result.out, result.err);
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

/// Nothing moves while its input says that the probe is unplugged, and a move is stopped in which it is pulled out:
/// nothing was measured, and the resumed job asks again.
#[test]
fn a_probe_that_is_unplugged_does_not_probe() {
    let connected = "[[card.input]]\nnumber = 5\nuse = \"plain\"\n[probe]\nconnected_input = 5\n";
    let machine = format!("[card]\nwatchdog_ms = 2000\n{PROBE}{connected}");
    let bench = bench(&machine, "G21 G90 F300\nG38.2 Z-10 F120\n(print,touch #5063)\nG0 Z2\nM2\n");
    // The simulated probe is plugged in.
    let plain = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", PLANE, "--json"]);
    assert_eq!((plain.code, messages(&plain)), (Some(0), vec!["touch -5.432000".to_owned()]), "{}", plain.err);
    let file = bench.path("m.toml").display().to_string();
    let mut card = ServedCard::with(&["--machine", &file, "--work", PLANE]);
    card.operate("input 5 off");
    thread::sleep(Duration::from_millis(100));
    let port = card.port.clone();
    let run = ["run", "part.ngc", "--card", &port, "--machine", "m.toml", "--json"];
    let refused = bench.retrace(run);
    assert_eq!(refused.code, Some(3), "{}{}", refused.out, refused.err);
    assert_eq!(events(&refused, "alarm")[0]["number"], "E3038", "{}", refused.out);
    assert!(refused.out.contains("\"position_counts\":{\"x\":0,\"y\":0,\"z\":0}"), "{}", refused.out);
    card.operate("input 5 on");
    thread::sleep(Duration::from_millis(100));
    let mut host = bench.start(&run, Stdio::null(), "run.txt");
    let told = || fs::read_to_string(bench.path("run.txt")).unwrap_or_default();
    while !told().contains("\"switching\"") {
        assert!(host.try_wait().expect("a process").is_none(), "{}", told());
        thread::sleep(Duration::from_millis(5));
    }
    thread::sleep(Duration::from_millis(700));
    card.operate("input 5 off");
    assert_eq!(host.wait().expect("it ends").code(), Some(3), "{}", told());
    assert!(told().contains("E3038") && !told().contains("\"probed\""), "{}", told());
    card.operate("input 5 on");
    thread::sleep(Duration::from_millis(100));
    let resumed = bench.retrace(["resume", "--yes", "--card", &port, "--json"]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    assert_eq!(messages(&resumed), ["touch -5.432000"], "{}", resumed.out);
    let _ = card.end();
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

/// Without any of them the move would have reached its end long before the card is asked.
#[test]
fn a_probing_move_ends_at_an_emergency_stop_a_lost_link_and_a_killed_host() {
    let machine = format!("[card]\nwatchdog_ms = 400\n{PROBE}[[card.input]]\nnumber = 13\nuse = \"emergency-stop\"\n");
    for end in ["press emergency-stop", "unplug", "kill"] {
        let bench = bench(&machine, "G21 G90\nG1 Z1 F600\nG38.2 Z-10 F300\nM2\n");
        let (path, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
        let mut card = ServedCard::with(&["--machine", &path, "--vcd", &vcd.display().to_string()]);
        let arguments = ["run", "part.ngc", "--machine", "m.toml", "--card", &card.port, "--json"];
        let mut child = bench.start(&arguments, Stdio::null(), "out.txt");
        let begun = Instant::now();
        let told = || fs::read_to_string(bench.path("out.txt")).unwrap_or_default();
        while !told().contains("\"event\":\"switching\"") {
            assert!(begun.elapsed() < Duration::from_secs(30), "{end}: the move did not begin");
            thread::sleep(Duration::from_millis(5));
        }
        thread::sleep(Duration::from_millis(300));
        match end {
            "kill" => child.kill().expect("it is killed"),
            line => card.operate(line),
        }
        thread::sleep(Duration::from_millis(3000));
        let _ = child.kill();
        child.wait().expect("it ends");
        assert!(end != "press emergency-stop" || told().contains("E3012"), "{end}: {}", told());
        let counted = card.end();
        let trace = samples(&vcd);
        let z = trace.last().map_or(0, |last| last.counts[2]);
        assert!((-9_000..1_000).contains(&z), "{end}: it began, and did not reach its end: {z}");
        // It comes to rest by itself: a second before the card ended nothing moved any more.
        let mut moved = trace.windows(2).filter(|pair| pair[0].counts != pair[1].counts).map(|pair| pair[1].at_us);
        let last_us = moved.next_back().unwrap_or_default();
        let ended_us = counted["periods"].as_u64().unwrap_or_default() * 1000;
        assert!(last_us + 1_000_000 < ended_us, "{end}: {last_us} {ended_us} {counted}");
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

#[test]
fn probed_points_are_written_to_a_file_and_again_by_a_resumed_job() {
    let program = "G21 G90\n(PROBEOPEN points.txt)\nG38.2 Z-10 F300\nG0 Z0\nG38.3 Z-2\nG0 Z0 X3\n\
        G38.2 Z-10 F300\n(PROBECLOSE)\nG0 Z1\nG38.2 Z-10 F300\nG0 Z0\nM2\n";
    let bench = bench(PROBE, program);
    let points = || fs::read_to_string(bench.path("points.txt")).unwrap_or_default();
    let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml"]);
    assert_eq!((checked.code, points().as_str()), (Some(0), ""), "{}", checked.err);
    let zeros = |x: &str| format!("{x} 0.000000 -5.432000{}\n", " 0.000000".repeat(6));
    bench.file("stop.op", "at line 6 stop\n");
    let run = ["run", "part.ngc", "--machine", "m.toml", "--work", PLANE, "--json", "--operator", "stop.op"];
    assert_eq!(bench.retrace(run).code, Some(4));
    assert_eq!(points(), zeros("0.000000"));
    let resumed = bench.retrace(["resume", "--yes", "--json", "--work", PLANE]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    assert_eq!(points(), zeros("0.000000") + &zeros("3.000000"));
    assert_eq!(events(&resumed, "probed").len(), 2, "{}", resumed.out);
}

/// 25 400 pulses a millimetre are no whole number of nanometres each.
#[test]
fn a_bore_is_as_wide_as_it_is_given_and_outputs_stay_as_they_are() {
    let axes = ["x", "y", "z"].map(|axis| {
        format!(
            "[[axis]]\nname = \"{axis}\"\npulses_per_mm = 25400\nmax_velocity_mm_per_s = 30\n\
            max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-200, 200]\n"
        )
    });
    let bench = bench(&(axes.concat() + PROBE), "G21 G90\nM8\nG38.2 X20 F600\nM9\nG1 X0 F600\nM2\n");
    let vcd = bench.path("pins.vcd");
    let trace = vcd.display().to_string();
    let work = "bore=0,0,20,-10:10";
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", work, "--vcd", &trace, "--json"]);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    let touch = events(&result, "probed")[0]["counts"][0].as_i64().unwrap_or_default();
    assert!((touch - 254_000).abs() <= 1, "{touch}");
    let samples = samples(&vcd);
    let outward: Vec<_> = samples.windows(2).filter(|pair| pair[1].counts[0] > pair[0].counts[0]).collect();
    assert!(outward.len() > 900 && outward.iter().all(|pair| pair[1].is_on("flood")), "{}", outward.len());
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

/// Planning again begins with the outputs of the job's begin, not with those of its breakpoint.
#[test]
fn a_job_that_has_probed_and_runs_its_spindle_is_resumed() {
    let program = "G21 G90 F600\nG38.2 Z-10\nM3 S1000\nG1 X20 Z2\nX40\nM5\nG38.2 Z-10\nG0 Z2\nM2\n";
    let bench = bench(PROBE, program);
    bench.file("stop.op", "at line 5 stop\n");
    let run = ["run", "part.ngc", "--machine", "m.toml", "--work", PLANE, "--json", "--operator", "stop.op"];
    assert_eq!(bench.retrace(run).code, Some(4));
    let resumed = bench.retrace(["resume", "--yes", "--json", "--work", PLANE]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    assert_eq!(events(&resumed, "probed").len(), 1, "{}", resumed.out);
}

#[test]
fn the_machine_returns_to_the_touch_where_it_is_told_to() {
    let program = "G21 G90 F600\nG1 X2\nG38.2 X3 Z-10\n(print,#5061 #5063 #5420 #5422)\nG38.5 Z0\n\
        (print,#5063 #5422)\nG38.3 Z-1\n(print,#5063 #5422 #5070)\nM2\n";
    let bench = bench(&format!("{PROBE}[probe]\nafter = \"back\"\n"), program);
    for script in ["", "at line 6 reverse 100%\nafter 9s leave\n"] {
        let run = run(&bench, PLANE, script);
        assert_eq!(run.output.code, Some(0), "{}{}", run.output.out, run.output.err);
        let found = messages(&run.output);
        let numbers: Vec<&str> = found[0].split(' ').collect();
        assert_eq!(numbers[..2], numbers[2..], "{found:?}");
        // Out of the contact it is on the first pulse without; then it ends without a touch.
        assert_eq!(found[1..], ["-5.431000 -5.431000", "-1.000000 -1.000000 0.000000"], "{found:?}");
        assert_eq!(run.counts()[2], -1000);
        assert!(run.output.out.contains("\"limit_violations\":0"), "{}", run.output.out);
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

/// At the highest feed that the check names, the machine comes to rest within the overtravel behind the touch, and
/// no further than the programmed end.
#[test]
fn the_stop_behind_a_touch_is_within_what_the_check_tells() {
    for (period_ms, acceleration, jerk, overtravel_mm) in
        [("0.5", 300, 5_000, 0.2), ("1", 1_000, 20_000, 1.0), ("2", 2_000, 20_000, 5.0), ("5", 1_000, 50_000, 0.5)]
    {
        let axes = ["x", "y", "z"].map(|name| {
            format!(
                "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = 100\n\
                 max_acceleration_mm_per_s2 = {acceleration}\nmax_jerk_mm_per_s3 = {jerk}\ntravel_mm = [-500, 500]\n"
            )
        });
        let probe = format!("[probe]\novertravel_mm = {overtravel_mm}\n");
        let machine = format!("control_period_ms = {period_ms}\n{}{probe}{PROBE}", axes.concat());
        for (end, touch) in [(-50.0, -5.4321), (-5.44, -5.4321)] {
            let bench = bench(&machine, &format!("G21 G90\nG38.2 Z{end} F6000\nM2\n"));
            let refused = bench.retrace(["check", "part.ngc", "--machine", "m.toml"]);
            let told = refused.err.split("at most ").nth(1).and_then(|text| text.split(" mm/min").next());
            let feed: f64 = told.and_then(|text| text.parse().ok()).unwrap_or_else(|| panic!("{}", refused.err));
            bench.file("part.ngc", format!("G21 G90\nG38.2 Z{end} F{feed}\nM2\n"));
            let work = format!("z<{touch}");
            let arguments = ["run", "part.ngc", "--machine", "m.toml", "--work", &work, "--vcd", "pins.vcd", "--json"];
            let result = bench.retrace(arguments);
            assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
            let lowest =
                samples(&bench.path("pins.vcd")).iter().map(|sample| sample.counts[2]).min().unwrap_or_default();
            let (behind_mm, most_mm) = ((TOUCH - lowest) as f64 / 1000.0, f64::min(overtravel_mm, touch - end));
            println!("T {period_ms} ms, F{feed} to Z{end}: {behind_mm} mm behind the touch, at most {most_mm:.3}");
            // A whole pulse on both sides.
            assert!((-0.001..=most_mm + 0.001).contains(&behind_mm), "{behind_mm} of {most_mm}");
            assert!(end > -50.0 || behind_mm > 0.15 * overtravel_mm, "{behind_mm}: the check tells what is needed");
        }
    }
}
