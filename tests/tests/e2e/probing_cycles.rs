//! Probing cycles, in programs and as `retrace probe` (PRB-20), by the command and a card with simulated work.
//!
//! Invariant: a result is compared with where the work is, to a pulse of 1 µm.

use retrace_tests::command::{Bench, CommandOutput, root};
use retrace_tests::served::ServedCard;
use serde_json::Value;

const MACHINE: &str = "[card]\nwatchdog_ms = 2000\n[[card.input]]\nnumber = 0\nuse = \"probe\"\n[probe]\n\
    ball_diameter_mm = 2\nsetter_mm = [100, 100, -80]\n";
const WORK: &str =
    "box=10:40,10:30,-20:-4.2;bore=72,49,28,-20:-4;boss=121,51,24,-20:-4;box=95:105,95:105,-100:-50;ball=2";

fn bench(program: &str) -> Bench {
    let bench = Bench::new();
    bench.file("m.toml", MACHINE);
    bench.file("part.ngc", program);
    bench.file("tools.tbl", "T1 P1 D6 Z0\nT2 P2 D6 Z0\n");
    bench
}

fn run(bench: &Bench) -> CommandOutput {
    bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--tools", "tools.tbl", "--work", WORK, "--json"])
}

fn events(result: &CommandOutput) -> impl Iterator<Item = Value> {
    result.out.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok())
}

/// Numbers of the messages that begin with the number of their call.
fn results(result: &CommandOutput) -> Vec<(String, Vec<f64>)> {
    let messages = events(result).filter(|event| event["event"] == "message");
    let texts = messages.map(|event| event["text"].as_str().unwrap_or_default().to_owned());
    let named = texts.filter_map(|text| {
        let (name, numbers) = text.split_once('=').filter(|(name, _)| name.parse::<usize>().is_ok())?;
        Some((name.to_owned(), numbers.split(' ').map(|number| number.parse().expect("a number")).collect()))
    });
    named.collect()
}

/// Runs each call from its place, and compares what it leaves.
fn assert_results(prefix: &str, calls: &[(&str, &str, &str, &[f64])]) {
    let mut program = format!("G21 G90\n{prefix}");
    for (name, (place, call, printed, _)) in calls.iter().enumerate() {
        program += &format!("{place}\no<{call}\n(print,{name}={printed})\nG90 G53 G0 Z0\n");
    }
    let bench = bench(&(program + "M2\n"));
    let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml", "--tools", "tools.tbl"]);
    assert_eq!(checked.code, Some(0), "{}", checked.err);
    let result = run(&bench);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    let found = results(&result);
    assert_eq!(found.len(), calls.len(), "{found:?}");
    for ((_, found), (_, call, _, expected)) in found.iter().zip(calls) {
        let is_near = |(found, expected): (&f64, &f64)| (found - expected).abs() < 0.0011;
        assert!(found.len() == expected.len() && found.iter().zip(*expected).all(is_near), "{call}: {found:?}");
    }
    assert!(result.out.contains("\"limit_violations\":0"), "{}", result.out);
}

#[test]
fn each_cycle_finds_its_work_to_the_pulse() {
    let size = "#<_probe_x> #<_probe_y> #<_probe_size>";
    let middle = "#<_probe_result> #<_probe_size>";
    assert_results(
        "",
        &[
            ("G0 X20 Y20", "probe_surface> call [-3] [15]", "#<_probe_result>", &[-4.2]),
            ("G0 X5 Y20\nG0 Z-6", "probe_surface> call [1] [15]", "#<_probe_result>", &[10.0]),
            ("G0 X20 Y20", "probe_edge> call [-1] [30] [8]", "#<_probe_result>", &[40.0]),
            ("G0 X20 Y20", "probe_edge> call [2] [15] [8]", "#<_probe_result> #<_x> #<_z>", &[10.0, 20.0, 0.0]),
            ("G0 X20 Y20", "probe_outside_corner> call [1] [-1] [15] [8]", "#<_probe_x> #<_probe_y>", &[10.0, 30.0]),
            ("G0 X70 Y50", "probe_bore> call [30] [8]", size, &[72.0, 49.0, 28.0]),
            ("G0 X70 Y49", "probe_slot> call [1] [30] [8]", middle, &[72.0, 28.0]),
            ("G0 X120 Y50", "probe_boss> call [24] [8] [8]", size, &[121.0, 51.0, 24.0]),
            ("G0 X121 Y50", "probe_web> call [2] [24] [8] [8]", middle, &[51.0, 24.0]),
            ("G0 X72 Y49", "probe_inside_corner> call [1] [-1] [20] [8]", "#<_probe_x> #<_probe_y>", &[86.0, 35.0]),
            ("G0 X20 Y20", "probe_angle> call [2] [10] [15] [8]", "#<_probe_angle>", &[0.0]),
            ("G0 X70 Y50", "probe_calibrate> call [28] [8]", "#<_probe_result>", &[2.0]),
        ],
    );
}

#[test]
fn results_become_work_offsets_in_inches_and_in_a_rotated_system_too() {
    let origin = "#5241 #5242 #5243";
    assert_results(
        "",
        &[
            ("G0 X20 Y20", "probe_surface> call [-3] [15] [2]", origin, &[0.0, 0.0, -4.2]),
            ("G0 X20 Y20", "probe_outside_corner> call [1] [1] [15] [8] [2]", origin, &[10.0, 10.0, -4.2]),
            ("G0 X70 Y50", "probe_bore> call [30] [8] [2]", origin, &[72.0, 49.0, -4.2]),
            ("G20 G0 X0.8 Y0.8", "probe_edge> call [-1] [1.2] [0.3] [2]", "#<_probe_result>", &[40.0 / 25.4]),
            ("G21", "probe_radius> call", "#5241 #<_metric> #<_absolute>", &[40.0, 1.0, 1.0]),
            // The system is turned, and the edge then turns it back.
            ("G0 X20 Y20\nG10 L2 P1 R10", "probe_angle> call [-1] [-4] [27] [8] [1]", "#<_probe_angle>", &[-10.0]),
            ("", "probe_radius> call", "#5230", &[0.0]),
        ],
    );
}

#[test]
fn tools_are_measured_into_the_tool_table_and_in_force() {
    assert_results(
        "M61 Q1\n",
        &[
            ("G0 X50 Y50", "probe_tool_setter> call [60]", "#<_probe_result> #5403 #5420", &[30.0, 30.0, 100.0]),
            ("M61 Q2\nG53 G0 X20 Y20\nG91", "probe_tool_at_work> call [20] [0.5]", "#<_absolute> #5403", &[0.0, -4.7]),
        ],
    );
    // The machine's own table keeps the length.
    let bench = bench("G21 G90\nM61 Q2\nG0 Z0\no<probe_tool_setter> call [60]\nG53 G0 Z0\nM2\n");
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--work", WORK, "--json"]);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    let report = events(&result).find(|event| event["event"] == "report").expect("a report");
    let table = std::fs::read_to_string(report["tool_table"].as_str().expect("a path")).expect("the table");
    assert!(table.lines().any(|line| line.starts_with("T2") && line.contains("Z30")), "{table}");
}

#[test]
fn what_is_in_the_way_or_not_known_ends_the_program_at_rest() {
    // The way down beside the work leads onto it.
    let bench = bench("G21 G90\nG0 X20 Y20\no<probe_edge> call [1] [5] [8]\nG0 X0\nM2\n");
    let result = run(&bench);
    assert_eq!(result.code, Some(1), "{}", result.out);
    assert!(result.err.contains("E1728") && result.err.contains("--> probe_descend.ngc:"), "{}", result.err);
    let report = events(&result).find(|event| event["event"] == "report").expect("a report");
    assert_eq!(report["position_counts"], serde_json::json!({"x": 15_000, "y": 20_000, "z": 0}), "{report}");
    // Nothing moves where the ball or the setter is not known, or the call is wrong.
    bench.file("plain.toml", "[[card.input]]\nnumber = 0\nuse = \"probe\"\n");
    for (call, what) in [
        ("o<probe_bore> call [20] [5]", "probe.ball_diameter_mm"),
        ("o<probe_tool_setter> call [20]", "probe.setter_mm"),
        ("o<probe_surface> call [4] [5]", "the direction is 4"),
        ("o<probe_surface> call [3]", "the maximum travel is 0"),
    ] {
        bench.file("part.ngc", format!("G21 G90\nG0 X1\n{call}\nM2\n"));
        let result = bench.retrace(["run", "part.ngc", "--machine", "plain.toml", "--json"]);
        assert!(result.code == Some(1) && result.err.contains(what), "{call}: {}{}", result.out, result.err);
        assert!(!result.out.contains("\"started\""), "{call}: {}", result.out);
    }
}

#[test]
fn a_job_that_is_stopped_in_a_cycle_is_resumed_without_asking_twice() {
    let bench = bench("G21 G90\nG0 X70 Y50\no<probe_bore> call [30] [8] [2]\nG0 X0\nM2\n");
    let whole = run(&bench);
    assert_eq!(whole.code, Some(0), "{}{}", whole.out, whole.err);
    let questions = |text: &str| text.matches("\"event\":\"probed\"").count();
    let end = |result: &CommandOutput| {
        let report = events(result).find(|event| event["event"] == "report").expect("a report");
        (report["position_counts"].clone(), report["outcome"].clone())
    };
    bench.file("s.op", "after 9s stop\n");
    let machine = ["--machine", "m.toml", "--tools", "tools.tbl", "--work", WORK, "--json"];
    let start: Vec<&str> =
        ["run", "part.ngc", "--journal", "jobs", "--operator", "s.op"].into_iter().chain(machine).collect();
    let stopped = bench.retrace(start);
    assert_eq!(stopped.code, Some(4), "{}{}", stopped.out, stopped.err);
    let resumed = bench.retrace(["resume", "--journal", "jobs", "--yes", "--work", WORK, "--json"]);
    assert_eq!(end(&resumed), end(&whole), "{}", resumed.err);
    assert!(questions(&stopped.out) > 0, "{}", stopped.out);
    assert_eq!(questions(&stopped.out) + questions(&resumed.out), questions(&whole.out), "{}", resumed.out);
}

#[test]
fn the_command_probes_and_sets_a_work_offset_on_a_card() {
    let bench = bench("");
    bench.file("m.toml", format!("{MACHINE}slow_feed_mm_per_min = 200\n"));
    let machine = bench.path("m.toml").display().to_string();
    let card = ServedCard::with(&["--machine", &machine, "--work", "box=-30:30,-20:20,-20:-4.2;ball=2"]);
    let probe = |arguments: &[&str]| {
        let usual = ["--card", &card.port, "--machine", "m.toml", "--params", "offsets.var"];
        bench.retrace(["probe"].iter().chain(arguments).chain(&usual))
    };
    let dry = probe(&["surface", "z-", "15", "--dry-run"]);
    assert_eq!((dry.code, card.identify(&bench)["counts"][2].as_i64()), (Some(0), Some(0)), "{}", dry.err);
    let result = probe(&["surface", "z-", "15", "G55"]);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    let result = probe(&["edge", "x+", "40", "6", "g55"]);
    assert_eq!(result.code, Some(0), "{}{}", result.out, result.err);
    let offsets = std::fs::read_to_string(bench.path("offsets.var")).expect("the parameters");
    assert!(offsets.contains("5243\t-4.2") && offsets.contains("5241\t-30.0"), "{offsets}");
    for wrong in [
        &["surface", "q", "5"][..],
        &["bore", "0", "5"],
        &["outside-corner", "y+", "x+", "5", "5"],
        &["angle", "y+", "-40"],
    ] {
        assert_eq!(probe(wrong).code, Some(2), "{wrong:?}");
    }
}

#[test]
fn the_examples_find_their_corner_and_the_length_of_their_tool() {
    let bench = bench("");
    let example = |name: &str| root().join("examples/probing").join(name).display().to_string();
    std::fs::copy(example("tools.tbl"), bench.path("own.tbl")).expect("copies");
    let (corner, tool, machine) = (example("corner.ngc"), example("measure-tool.ngc"), example("probe.toml"));
    let work = "box=10:40,10:30,-20:-4.2;box=95:105,95:105,-100:-50;ball=2";
    let run = |program: &str| {
        bench.retrace(["run", program, "--machine", &machine, "--tools", "own.tbl", "--work", work, "--json"])
    };
    // The second run begins with the offset that the first one has left.
    for _ in 0..2 {
        let result = run(&corner);
        assert!(result.code == Some(0) && result.out.contains("at machine X10.000000 Y10.000000"), "{}", result.out);
    }
    let result = run(&tool);
    assert!(result.code == Some(0) && result.out.contains("length of tool 1.000000: 30.000000"), "{}", result.out);
}
