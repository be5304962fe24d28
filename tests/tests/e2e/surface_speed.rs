//! Constant surface speed, G96, at the card's outputs (SPN-9).
//!
//! Invariant: the radius is that of the pulses in the trace; nothing is taken from the plan.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use retrace_tests::command::Bench;
use retrace_tests::pins::{Sample, run_with_pins, samples};
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;
use serde_json::Value;

const PULSES: f64 = 1000.0;
/// Surface speed in mm/min.
const SURFACE: f64 = 150_000.0;
const MAX_RPM: f64 = 3000.0;
/// Facing, a taper, a ball end, and a rapid back; X 0 is at the machine's X 10.
const PROGRAM: &str = "G21 G18 G90 G64 P0.01 F1200\nG10 L2 P1 X10\nG0 X45 Z0\nG96 S150 M3\nG1 X4\nG1 X20 Z-30\n\
    G3 X-1 Z-9 K21\nG0 X45 Z0\nG97 S500\nG1 X40\nM5\nM2\n";

fn machine(more: &str) -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = {PULSES}\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-100, 100]\n"
        )
    };
    format!("{more}[spindle]\nfeed_per_turn = \"commanded\"\nmax_rpm = {MAX_RPM}\n{}{}", axis("x"), axis("z"))
}

fn run(machine: &str, program: &str, script: &str) -> (Run, Vec<Sample>) {
    run_with_pins(machine, program, script, &[])
}

/// S in turns per minute.
fn rpm(sample: &Sample) -> f64 {
    sample.outputs.get("speed").map_or(0.0, |&thousandths| thousandths as f64 / 1000.0)
}

fn radius(sample: &Sample) -> f64 {
    (sample.counts[0] as f64 / PULSES - 10.0).abs()
}

/// Asserts that S is that of the radius, in every period of these lines; returns their number.
fn assert_follows(trace: &[Sample], lines: std::ops::RangeInclusive<u64>) -> usize {
    let turning = trace.windows(2).filter(|pair| lines.contains(&pair[1].line) && pair[1].rate != 0.0);
    turning
        .map(|pair| {
            // The change is where the period of its place begins.
            let exact = [&pair[0], &pair[1]].map(|sample| SURFACE / (TAU * radius(sample)));
            let low = (0.99 * exact[0].min(exact[1])).min(MAX_RPM);
            let high = (1.01 * exact[0].max(exact[1])).min(MAX_RPM);
            assert!((low - 0.01..=high + 0.01).contains(&rpm(&pair[1])), "{low} {high} {:?}", pair[1]);
        })
        .count()
}

#[test]
fn the_speed_of_the_spindle_follows_the_radius_and_the_path_is_the_same() {
    let (run, trace) = self::run(&machine(""), PROGRAM, "");
    run.assert_exact_and_legal();
    assert!(assert_follows(&trace, 5..=8) > 3000);
    let limited = trace.iter().filter(|sample| rpm(sample) == MAX_RPM).count();
    assert!(limited > 100, "near the axis: {limited}");
    assert!(trace.iter().filter(|sample| sample.line == 10).all(|sample| rpm(sample) == 500.0));
    // No stop, no other way: as many records as under G97, with the same pulses.
    let (plain, _) = self::run(&machine(""), &PROGRAM.replace("G96 S150", "G97 S531"), "");
    let path = |run: &Run| run.records.rows.iter().map(|row| (row.line, row.increments.clone())).collect::<Vec<_>>();
    assert!(path(&run) == path(&plain), "{} {}", run.records.rows.len(), plain.records.rows.len());
    // S itself is switched at rest, as the machine file describes; the changes along the path take no time.
    let (slow, _) = self::run(&(machine("") + "[code.S]\nduration_ms = 800\n"), PROGRAM, "");
    let [slow, fast] = [&slow, &run].map(|run| run.number("switch_s"));
    assert!((slow - fast - 1.6).abs() < 0.02, "{slow} {fast}");
}

#[test]
fn a_reverse_run_sees_the_same_speed_at_the_same_place() {
    let script = "at line 8 reverse 100%\nafter 6s leave\n";
    let (run, trace) = self::run(&machine("retrace_outputs = \"replayed\"\n"), PROGRAM, script);
    run.assert_exact_and_legal();
    // The record that is played: up to its end forward, down to its begin backward.
    let record = |sample: &Sample| sample.place.ceil() as i64;
    let in_lines = |sample: &&Sample| (5..=8).contains(&sample.line) && sample.rate != 0.0;
    let mut forward = BTreeMap::new();
    for sample in trace.iter().filter(in_lines).filter(|sample| sample.rate > 0.0) {
        let speed = *forward.entry(record(sample)).or_insert(rpm(sample));
        assert_eq!(speed, rpm(sample), "again forward: {sample:?}");
    }
    let backward: Vec<&Sample> = trace.iter().filter(in_lines).filter(|sample| sample.rate < 0.0).collect();
    for sample in &backward {
        assert_eq!(forward.get(&record(sample)), Some(&rpm(sample)), "{sample:?}");
    }
    let speeds: std::collections::BTreeSet<u64> = backward.iter().map(|sample| rpm(sample) as u64).collect();
    assert!(backward.len() > 3000 && speeds.len() > 100, "{} {}", backward.len(), speeds.len());
    // Left to the operator, as outputs are by default, S stays as it is backward.
    let (_, trace) = self::run(&machine(""), PROGRAM, script);
    let speeds: std::collections::BTreeSet<u64> =
        trace.iter().filter(|sample| sample.rate < 0.0).map(|sample| rpm(sample) as u64).collect();
    assert_eq!(speeds.len(), 1, "{speeds:?}");
}

/// The time of a face is π·(R² − r²) / (F · surface speed).
#[test]
fn a_feed_per_turn_follows_the_speed() {
    let program = "G21 G18 G90 G95 F0.2\nG10 L2 P1 X10\nG0 X45\nG96 S150 M3\nG1 X10\nM5\nM2\n";
    let bench = Bench::new();
    bench.file("m.toml", machine(""));
    bench.file("part.ngc", program);
    let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml", "--json"]);
    let report: Value = serde_json::from_str(checked.out.lines().next_back().unwrap_or_default()).unwrap_or_default();
    let (run, trace) = self::run(&machine(""), program, "");
    run.assert_exact_and_legal();
    assert_follows(&trace, 5..=5);
    let rapid_s = trace.iter().filter(|sample| sample.line == 3).count() as f64 / 1000.0;
    let face_s = TAU / 2.0 * (45.0f64.powi(2) - 10.0f64.powi(2)) / (0.2 * SURFACE) * 60.0;
    for motion_s in [run.number("motion_s"), report["motion_s"].as_f64().unwrap_or_default()] {
        assert!((motion_s - rapid_s - face_s).abs() < 0.01 * face_s, "{motion_s} {rapid_s} {face_s}");
    }
}

#[test]
fn g96_without_a_highest_speed_is_refused() {
    let beam = "[[cutter]]\nname = \"laser\"\nkind = \"beam\"\nfire = 64\npower = {}\n";
    for (machine, highest, number) in [("name = \"lathe\"\n", "", "E4317"), (beam, "D2000", "E4302")] {
        let bench = Bench::new();
        bench.file("m.toml", machine);
        bench.file("part.ngc", format!("G21 G90 F100\nG0 X10\nG96 S100 {highest}\nG1 X5\nM2\n"));
        for command in ["check", "run"] {
            let result = bench.retrace([command, "part.ngc", "--machine", "m.toml", "--json"]);
            let told = format!("{}{}", result.out, result.err);
            assert!(result.code == Some(1) && told.contains(number) && !told.contains("\"started\""), "{told}");
        }
    }
}

/// Behind a measurement X is unknown to the check; the run knows it.
#[test]
fn behind_a_measurement_the_speed_follows_the_measured_position() {
    let bench = Bench::new();
    let probe =
        "[[card.input]]\nnumber = 0\nuse = \"probe\"\n[spindle]\nmax_rpm = 3000\nfeed_per_turn = \"commanded\"\n";
    bench.file("m.toml", probe);
    let program = "G21 G18 G90 F300\nG38.2 X-30\nG0 X[#5061 + 30]\nG95 F0.2 G96 S150 M3\nG1 X[#5061 + 20]\nM5\nM2\n";
    bench.file("part.ngc", program);
    let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml"]);
    assert_eq!(checked.code, Some(0), "{}", checked.err);
    let vcd = bench.path("pins.vcd").display().to_string();
    let arguments = ["run", "part.ngc", "--machine", "m.toml", "--work", "box=-50:-10,-50:50,-50:50", "--vcd", &vcd];
    let result = bench.retrace(arguments);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let trace = samples(&bench.path("pins.vcd"));
    let feed: Vec<&Sample> = trace.iter().filter(|sample| sample.line == 5 && sample.rate != 0.0).collect();
    let exact = |sample: &Sample| (SURFACE / (TAU * sample.counts[0] as f64 / PULSES)).min(3000.0);
    assert!(feed.len() > 100 && feed.iter().all(|sample| (rpm(sample) / exact(sample) - 1.0).abs() < 0.01), "{feed:?}");
}

/// Near the axis the radius changes by more than 1 % in a record: there is one change in it.
#[test]
fn a_record_has_one_change_of_the_speed() {
    let machine = machine("").replace("max_rpm = 3000", "max_rpm = 100000");
    let (run, trace) = self::run(&machine, "G21 G90\nG0 X40\nG96 S150 M3\nG0 X0.5\nG97\nM5\nM2\n", "");
    run.assert_exact_and_legal();
    let changes = run.of_kind("output_changed").filter(|event| event["channel"] == 65);
    let mut records: Vec<u64> = changes.map(|event| event["record"].as_u64().unwrap_or_default()).collect();
    let all = records.len();
    records.dedup();
    assert!(all == records.len() && all > 100, "{all} {}", records.len());
    let last = trace.iter().rfind(|sample| sample.is_on("spindle")).expect("it turns");
    assert!((rpm(last) / (SURFACE / (TAU * 0.5)) - 1.0).abs() < 0.01, "{last:?}");
}

/// A log for people is not flooded by it.
#[test]
fn the_log_shows_the_codes_and_not_each_change_of_the_speed() {
    let bench = Bench::new();
    bench.file("m.toml", machine(""));
    bench.file("part.ngc", PROGRAM);
    let result = bench.retrace(["run", "part.ngc", "--machine", "m.toml"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    let told = format!("{}{}", result.out, result.err);
    assert!(told.contains("S done") && !told.contains("spindle speed"), "{told}");
}

/// Over the serial line.
#[test]
fn a_served_card_has_the_speed_of_the_radius() {
    let bench = Bench::new();
    let vcd = bench.path("pins.vcd");
    bench.file("m.toml", machine("") + "[card]\nwatchdog_ms = 2000\n");
    bench.file("part.ngc", PROGRAM);
    let card = ServedCard::with(&["--vcd", &vcd.display().to_string()]);
    let run = bench.retrace(["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"]);
    assert_eq!(run.code, Some(0), "{}", run.err);
    let _ = card.end();
    assert!(assert_follows(&samples(&vcd), 5..=8) > 3000);
}
