//! For any commands of the operator, the job reaches its regular end, and no limit is exceeded on the way.

use proptest::prelude::*;
use retrace_tests::command::{Bench, root};
use retrace_tests::records::RATE_ONE;
use retrace_tests::run::Run;
use serde_json::Value;

fn example(name: &str) -> std::path::PathBuf {
    root().join("examples").join(name)
}

fn backed_up() -> Run {
    let (operator, machine) = (example("02-back-up.op"), example("02-back-up.toml"));
    let paths = [operator.to_string_lossy(), machine.to_string_lossy()];
    Run::of(&Bench::new(), &example("02-back-up.ngc"), &["--operator", &paths[0], "--machine", &paths[1]])
}

#[test]
fn backing_up_changes_nothing_of_where_the_job_ends() {
    let plain = Run::of(&Bench::new(), &example("02-back-up.ngc"), &[]);
    let run = backed_up();
    run.assert_exact_and_legal();
    assert_eq!(run.counts(), plain.counts());
    // The first passage takes as long, except for the ramps: twice it is stopped on new ground and started again, and
    // each of these four costs about half of the periods that the rate takes to change; at 25 mm/s these are not a
    // hundred.
    let ramps_s = run.number("motion_s") - plain.number("motion_s");
    assert!((0.0..=4.0 * 0.085).contains(&ramps_s), "{ramps_s}");
    // Time of the second from hold to resume that is spent braking.
    let held_s = run.number("held_s");
    assert!((0.89..=0.92).contains(&held_s) && run.number("retrace_s") > 8.0, "{}", run.report);
    assert!(run.number("reversals") >= 5.0, "{}", run.report);
    assert_eq!(run.of_kind("history_start_reached").count(), 1, "the end of the history is reached and told once");
    let rows = &run.records.rows;
    assert!(run.records.places_visited_twice().is_ok_and(|twice| twice > 2000));
    assert!(rows.iter().any(|row| row.rate_nano == -RATE_ONE), "full reverse is reached");
}

#[test]
fn history_ends_where_the_machine_file_says() {
    let run = backed_up();
    let rows = &run.records.rows;
    let mut furthest = 0;
    let mut deepest = 0;
    for row in rows {
        furthest = furthest.max(row.record + u64::from(row.fraction > 0));
        deepest = deepest.max(furthest - row.record);
    }
    // 4 s in periods of 1 ms; never less, and no more than one window beyond.
    assert!((4000..=4001).contains(&deepest), "{deepest}");
    let oldest = run.of_kind("history_start_reached").next().expect("it stands at the oldest record");
    assert_eq!(oldest["fraction"], 0, "it stands exactly on it");
}

#[test]
fn a_hold_stops_on_the_path_and_a_stop_keeps_what_was_counted() {
    let bench = Bench::new();
    let script = bench.file("stop.op", "at 1s hold\nafter 2s resume\nafter 1s stop\n");
    let run = Run::of(&bench, &example("01-first-cut.ngc"), &["--operator", &script.to_string_lossy()]);
    assert_eq!((run.output.code, run.report["outcome"].as_str()), (Some(4), Some("stopped")), "{}", run.output.err);
    run.assert_consistent();
    let standing = run.records.rows.iter().filter(|row| row.rate_nano == 0).count();
    assert!((1000..2000).contains(&standing), "2 s, less the braking, of standing: {standing}");
}

#[test]
fn override_scales_time_and_not_the_path() {
    let plain = Run::of(&Bench::new(), &example("03-arcs.ngc"), &[]);
    let bench = Bench::new();
    let script = bench.file("half.op", "at 0s override 50%\n");
    let run = Run::of(&bench, &example("03-arcs.ngc"), &["--operator", &script.to_string_lossy()]);
    run.assert_exact_and_legal();
    assert_eq!(run.counts(), plain.counts());
    let ratio = run.number("motion_s") / plain.number("motion_s");
    assert!((1.9..2.05).contains(&ratio), "{ratio}");
}

#[test]
fn the_handwheel_moves_the_machine_as_it_is_turned() {
    let bench = Bench::new();
    let script = bench.file("wheel.op", "at 3s wheel -100 for 2s\nafter 1s wheel 50 for 1s\nafter 2s leave\n");
    let run = Run::of(&bench, &example("01-first-cut.ngc"), &["--operator", &script.to_string_lossy()]);
    run.assert_exact_and_legal();
    let at = |time_s: f64| &run.records.rows[(time_s * 1000.0) as usize];
    assert_eq!(at(4.5).rate_nano, -RATE_ONE, "100 counts a second are rate 1");
    assert_eq!(at(5.9).rate_nano, 0, "wheel at rest, machine at rest");
    assert_eq!(at(6.9).rate_nano, RATE_ONE / 2);
}

#[test]
fn a_single_block_stops_at_its_end() {
    let bench = Bench::new();
    let script = bench.file(
        "single.op",
        "at 0s single\nafter 10s cycle start\nafter 10s cycle start\nafter 10s single\nafter 0s cycle start\n",
    );
    let run = Run::of(&bench, &example("01-first-cut.ngc"), &["--operator", &script.to_string_lossy()]);
    run.assert_exact_and_legal();
    let lines: Vec<_> = run.of_kind("single_block").filter_map(|event| event["line"].as_u64()).collect();
    assert_eq!(lines, [3, 4, 5], "{:?}", run.events);
}

/// A possible next command of the operator, with its time.
pub(crate) fn timed(command: impl Strategy<Value = String>, longest_s: f64) -> impl Strategy<Value = String> {
    let when = prop_oneof![
        (0_u32..1500).prop_map(|periods| format!("after {periods} periods")),
        (0.0..longest_s).prop_map(|seconds| format!("after {seconds:.3}s")),
    ];
    (when, command).prop_map(|(when, command)| format!("{when} {command}"))
}

fn operator_commands() -> impl Strategy<Value = String> {
    let deed = prop_oneof![
        3 => Just("hold".to_owned()),
        3 => Just("resume".to_owned()),
        4 => (1_u32..=100).prop_map(|rate| format!("reverse {rate}%")),
        1 => (100_u32..=800).prop_map(|rate| format!("reverse {rate}%")),
        3 => (1_u32..=100).prop_map(|rate| format!("forward {rate}%")),
        3 => (5_u32..=250).prop_map(|rate| format!("override {rate}%")),
        3 => (-300_i32..300, 0.1..2.0_f64).prop_map(|(counts, time)| format!("wheel {counts} for {time:.2}s")),
        3 => Just("leave".to_owned()),
        1 => Just("agree".to_owned()),
        1 => Just("output 1 on".to_owned()),
        1 => Just("single".to_owned()),
    ];
    timed(deed, 2.0)
}

/// Corners, arcs, blends, a dwell and switching, within some seconds.
const MIXED: &str = "\
G21 G90 G17 G64 P0.05
F3600
G0 X5 Y5
M62 P1
G1 X25 Y5
G3 X35 Y15 I0 J10
G1 X35 Y25
X20 Y32.5
M63 P1
G61
X10 Y20.123
G2 X10 Y20.123 I-3 J0
M8
G4 P0.2
G1 X0 Y0 Z-3
G0 Z10
M9
M2
";

proptest! {
    #![proptest_config(ProptestConfig {
        cases: retrace_tests::command::cases(24),
        max_shrink_iters: 40,
        // No file is written into the source tree.
        failure_persistence: None,
        ..ProptestConfig::default()
    })]
    #[test]
    fn whatever_the_operator_does_the_job_ends_exactly(deeds in prop::collection::vec(operator_commands(), 1..14)) {
        let bench = Bench::new();
        let program = bench.file("mixed.ngc", MIXED);
        let machine = bench.file("machine.toml", "history_hours = 0.0005\n");
        let mut script = deeds.join("\n");
        // In the end the operator always resumes: out of every mode, and block by block if need be.
        script.push_str("\nafter 3s leave\nafter 3s resume\nafter 0s override 100%\nafter 30s leave\n");
        script.push_str(&"after 8s resume\n".repeat(20));
        let script = bench.file("script.op", script);
        let more = ["--operator", &script.to_string_lossy(), "--machine", &machine.to_string_lossy()];
        let run = Run::of(&bench, &program, &more);
        run.assert_exact_and_legal();
    }
}

#[test]
fn events_call_outputs_by_the_names_that_the_machine_file_gives_them() {
    let bench = Bench::new();
    bench.file(
        "m.toml",
        "[[output]]\nnumber = 1\nname = \"air\"\n[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\n",
    );
    bench.file("p.ngc", "G21 G90 F3000\nM62 P1\nG1 X1\nM64 P3\nG1 X9\nM63 P1\nG1 X10\nM65 P3\nM2\n");
    bench.file("p.op", "at line 5 hold\nafter 2s resume\nafter 1s agree\n");
    let run = ["run", "p.ngc", "--machine", "m.toml", "--operator", "p.op"];
    let text = bench.retrace(run);
    for part in ["air := 1", "air := 0", "jet off: the machine is at rest", "outputs differ: jet is 0, program wants 1"]
    {
        assert!(text.out.contains(part), "{part} is not in\n{}", text.out);
    }
    assert!(!text.out.contains("output 1 ") && !text.out.contains("output 3 "), "{}", text.out);
    let result = bench.retrace([&run[..], &["--json"]].concat());
    let events: Vec<Value> = result.out.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let passing: Vec<_> = events.iter().filter(|event| event["event"] == "output_changed").collect();
    assert_eq!((&passing[0]["channel"], &passing[0]["name"]), (&1.into(), &"air".into()), "{passing:?}");
    let differ = events.iter().find(|event| event["event"] == "outputs_differ").expect("it asks");
    assert_eq!((&differ["outputs"][0]["channel"], &differ["outputs"][0]["name"]), (&3.into(), &"jet".into()));
}
