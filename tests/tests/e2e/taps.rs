//! Rigid taps by the command: G33.1, and G84 and G74 with `tapping = "rigid"` (SPN-19).

use retrace_tests::command::Bench;
use retrace_tests::geared_job::{EarlyEnd, assert_refused, end_early};
use retrace_tests::pins::{self, Sample};
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;
use serde_json::Value;

const ENCODER: &str = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\n";
const RIGID: &str = "[spindle]\ncounts_per_turn = 400\nmax_rpm = 3000\ntapping = \"rigid\"\n";
/// Two holes: 12 mm below a start 3 mm above the work.
const TAPS: &str = "G21 G90\nS600 M3\nG0 X5 Z3\nG33.1 Z-12 K1\nG0 X10\nG33.1 Z-12 K1\nG0 X0 Z10\nM5\nM2\n";

/// Runs a program on the simulated card; returns the run, and what was at its pins.
fn run(machine: &str, program: &str, operator: &str) -> (Run, Vec<Sample>) {
    let bench = Bench::new();
    let machine = bench.file("m.toml", machine).display().to_string();
    let (path, script) = (bench.file("part.ngc", program), bench.file("s.op", operator).display().to_string());
    let vcd = bench.path("pins.vcd");
    let run =
        Run::of(&bench, &path, &["--machine", &machine, "--vcd", &vcd.display().to_string(), "--operator", &script]);
    (run, pins::samples(&vcd))
}

/// The deepest place of the tool in each visit below this height, in pulses.
fn holes(samples: &[Sample], below: i64) -> Vec<i64> {
    let mut holes = Vec::new();
    let mut deepest: Option<i64> = None;
    for z in samples.iter().map(|sample| sample.counts[2]) {
        if z < below {
            deepest = Some(deepest.map_or(z, |of| of.min(z)));
        } else if let Some(of) = deepest.take() {
            holes.push(of);
        }
    }
    holes
}

/// G33.1 and both cycles tap each hole to its depth, and go on from where they began, to the pulse: the axes that do
/// not tap stand still below the work.
#[test]
fn holes_are_tapped_to_their_depth_and_left_where_they_began() {
    let cycle = |code: &str, start: &str| {
        format!("G21 G90 G98\nS600 {start}\nG0 X5 Z3\nG95 F1\n{code} X5 Y0 Z-12 R3\nX10\nG80\nG0 X0 Z10\nM5\nM2\n")
    };
    for (machine, program) in [
        (ENCODER, TAPS.to_owned()),
        (ENCODER, TAPS.replace("M3", "M4")),
        (RIGID, cycle("G84", "M3")),
        (RIGID, cycle("G74", "M4")),
        (RIGID, cycle("G84", "M3").replace("G95 F1", "F600")),
    ] {
        let (run, samples) = run(machine, &program, "");
        assert_eq!((&run.report["outcome"], run.counts()), (&"completed".into(), vec![0, 0, 10_000]), "{program}");
        assert_eq!(run.number("limit_violations") + run.number("underruns"), 0.0);
        let turns = |event: &Value| event["reversal_turns"].as_f64().expect("a number");
        let reversals: Vec<f64> = run.of_kind("tapped").map(turns).collect();
        let holes = holes(&samples, 0);
        // Told in turns, which are millimetres here, it is what the hole is deeper.
        for (turns, z) in reversals.iter().zip(&holes) {
            assert!((turns * 1000.0 + (z + 12_000) as f64).abs() <= 30.0, "{turns} {z} {program}");
        }
        assert_eq!(reversals.len(), holes.len());
        // What the drive needs to reverse 600 turns a minute is below the depth.
        assert!(holes.len() == 2 && holes.iter().all(|z| (-13_050..=-12_000).contains(z)), "{holes:?} {program}");
        let above = samples.iter().position(|sample| sample.counts[2] >= 2_900).expect("it rises first");
        for pair in samples[above..].windows(2).filter(|pair| pair[1].counts[2] < 2_900) {
            assert!(pair[0].counts[0] == pair[1].counts[0], "{program}: {:?}", pair[1]);
        }
    }
}

/// `check` tells the way to the pitch, and that a tap is a barrier; reverse run ends there, and goes forward again
/// without tapping once more. A start line behind a tap leaves it out.
#[test]
fn reverse_run_ends_at_a_tap_and_a_start_behind_it_leaves_it_out() {
    let program = "G21 G90\nS600 M3\nG0 X5 Z3\nG33.1 Z-12 K1\nG0 X10\nG1 X40 F600\nM5\nM2\n";
    let bench = Bench::new();
    bench.file("m.toml", ENCODER);
    bench.file("part.ngc", program);
    let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml"]);
    for words in ["cannot be passed backward: rigid tap", "threads: line 4: run-in "] {
        assert!(checked.code == Some(0) && checked.out.contains(words), "{words}: {}{}", checked.out, checked.err);
    }
    let (run, samples) = run(ENCODER, program, "at 5s hold\nafter 0.5s reverse 100%\nafter 3s forward 100%\n");
    assert_eq!((&run.report["outcome"], run.counts()), (&"completed".into(), vec![40_000, 0, 3_000]));
    assert!(run.of_kind("retrace_barrier").any(|event| event["code"] == "rigid tap"), "{}", run.output.out);
    assert_eq!(holes(&samples, 0).len(), 1);
    let behind = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--start-line", "5", "--json"]);
    assert!(behind.code == Some(0) && !behind.out.contains("rigid tap"), "{}{}", behind.out, behind.err);
}

/// With the turns that the reversal takes, the turn is at the depth.
#[test]
fn a_tap_that_is_reversed_early_turns_at_its_depth() {
    let (_, samples) = run(&format!("{ENCODER}reversal_turns = 26\n"), TAPS, "");
    // 600 of 3 000 turns a minute: 1/25 of it
    let holes = holes(&samples, 0);
    assert!(holes.len() == 2 && holes.iter().all(|z| (-12_000..=-11_000).contains(z)), "{holes:?}");
}

/// I of G33.1 is the speed of the way back in parts of that of the way in: on the same helix, to where it began.
#[test]
fn a_tap_comes_back_faster_than_it_went_in() {
    let program = "G21 G90\nS600 M3\nG0 X5 Z5\nG33.1 Z-30 K1 I2\nG0 X10\nM5\nM2\n";
    let (run, samples) = run(ENCODER, program, "");
    assert_eq!((&run.report["outcome"], run.counts()), (&"completed".into(), vec![10_000, 0, 5_000]));
    assert_eq!((&run.report["limit_violations"], holes(&samples, 0).len()), (&0.into(), 1));
    // Time from 20 mm below to 25 mm below, and back: 5 turns at 600 and at 1200 a minute.
    let at = |z: i64, is_back: bool| {
        let mut found = samples.iter().filter(|sample| sample.counts[2] <= z).map(|sample| sample.at_us);
        if is_back { found.next_back() } else { found.next() }.expect("it goes there") as f64 / 1e6
    };
    let [way_in, way_back] = [at(-25_000, false) - at(-20_000, false), at(-20_000, true) - at(-25_000, true)];
    assert!((way_in - 0.5).abs() < 0.01 && (way_back - 0.25).abs() < 0.01, "{way_in} s and {way_back} s");
    for (words, number) in [("I6", "E4322"), ("I0", "E1105"), ("I-1", "E1105")] {
        assert_refused(ENCODER, &format!("S600 M3\nG33.1 Z-30 K1 {words}"), number);
    }
}

/// Without reversal, a floating tap is what the cycles do, as before.
#[test]
fn the_cycles_tap_in_a_floating_holder_without_a_word_about_it() {
    let program = "G21 G90 G98\nS600 M3\nG0 X5 Z3\nG95 F1\nG84 X5 Y0 Z-12 R3\nG80\nG0 X0 Z10\nM5\nM2\n";
    let (run, samples) = run(ENCODER, program, "");
    assert_eq!(run.report["outcome"], "completed");
    assert_eq!(holes(&samples, 0), [-12_000]);
}

#[test]
fn what_cannot_be_tapped_is_refused_before_anything_moves() {
    let stiff = format!("{ENCODER}reversible = false\n");
    for (machine, program, number) in [
        ("[spindle]\nmax_rpm = 3000\n", "S600 M3\nG33.1 Z-12 K1", "E4320"),
        (ENCODER, "M3\nG33.1 Z-12 K1", "E4321"),
        (ENCODER, "S1000 M3\nG33.1 Z-40 K6", "E4322"),
        (ENCODER, "S600 M3\nG33.1 Z-0.2 K1", "E4323"),
        (&stiff, "S600 M3\nG33.1 Z-12 K1", "E4326"),
        (ENCODER, "S600 M3\nG33.1 Z-900 K1", "E4325"),
    ] {
        assert_refused(machine, program, number);
    }
}

/// A hold stops the spindle in the groove, and the tap goes on from there; an order to retrace is refused in it. A stop
/// lets it come out first.
#[test]
fn a_tap_is_held_in_the_groove_and_comes_out_before_a_stop() {
    let script = "at 1.5s hold\nafter 1s reverse 100%\nafter 1s resume\nat 5s hold\nafter 1s resume\n";
    let (held, samples) = run(ENCODER, TAPS, script);
    assert_eq!((&held.report["outcome"], held.counts()), (&"completed".into(), vec![0, 0, 10_000]));
    assert_eq!(held.of_kind("command_rejected").count(), 1);
    let at = |us: u64| samples.iter().rev().find(|sample| sample.at_us <= us).expect("a sample");
    for [rests_us, goes_on_us] in [[2_000_000, 3_450_000], [5_450_000, 5_950_000]] {
        let (rests, goes_on) = (at(rests_us), at(goes_on_us));
        assert!(!rests.is_on("spindle") && rests.counts[2] < 0 && rests.at_rest, "{rests:?}");
        assert_eq!((&rests.counts, goes_on.is_on("spindle")), (&goes_on.counts, false));
    }
    assert_eq!(holes(&samples, 0).len(), 2);
    let (stopped, samples) = run(ENCODER, TAPS, "at 1.5s stop\n");
    assert_eq!(stopped.report["outcome"], "stopped");
    assert_eq!((holes(&samples, 0).len(), stopped.counts()), (1, vec![5_000, 0, 3_000]));
    assert!(samples.last().is_some_and(|of| of.at_rest));
}

/// A job that was stopped between two taps is resumed with the second alone; one that was stopped in a tap that is held
/// is not resumed.
#[test]
fn a_tap_is_cut_once_and_a_job_that_was_left_in_one_is_not_resumed() {
    let bench = Bench::new();
    bench.file("m.toml", ENCODER);
    bench.file("part.ngc", TAPS);
    bench.file("between.op", "at 1.5s stop\n");
    bench.file("inside.op", "at 1.5s hold\nafter 1s stop\n");
    let run = |script: &str| bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--operator", script, "--json"]);
    assert_eq!(run("between.op").code, Some(4));
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    // A tap is two instructions: what the machine does, and the barrier behind it.
    let count = |line: u32| {
        let event = format!("\"code\":\"rigid tap\",\"event\":\"switched\",\"fraction\":0,\"line\":{line},");
        resumed.out.matches(&event).count()
    };
    assert_eq!([count(4), count(6)], [1, 2], "{}", resumed.out);
    assert_eq!(run("inside.op").code, Some(4));
    let refused = bench.retrace(["resume", "--yes", "--json"]);
    assert!(refused.code != Some(0) && refused.err.contains("E2219"), "{}{}", refused.out, refused.err);
}

/// A job that was stopped behind a tap can be stopped again before it moves, and is resumed all the same: the tap is
/// done.
#[test]
fn a_job_that_was_stopped_behind_a_tap_is_resumed_more_than_once() {
    let bench = Bench::new();
    bench.file("m.toml", ENCODER);
    bench.file("part.ngc", "G21 G90\nS600 M3\nG0 X5 Z3\nG33.1 Z-12 K1\nG0 X10\nM5\nM2\n");
    bench.file("late.op", "at 1.5s stop\n");
    bench.file("soon.op", "at 0.001s stop\n");
    let run = bench.retrace(["run", "part.ngc", "--machine", "m.toml", "--operator", "late.op", "--json"]);
    assert_eq!(run.code, Some(4), "{}{}", run.out, run.err);
    for (script, code) in [("soon.op", 4), ("soon.op", 4), ("none.op", 0)] {
        bench.file("none.op", "");
        let resumed = bench.retrace(["resume", "--yes", "--operator", script, "--json"]);
        assert_eq!(resumed.code, Some(code), "{script}: {}{}", resumed.out, resumed.err);
        assert!(!resumed.out.contains("\"tapped\""), "it taps again: {}", resumed.out);
    }
}

/// A stop while the spindle is awaited begins no tap, and the resumed job taps both holes. Where the spindle does not
/// come to its speed, the job can be resumed as well.
#[test]
fn a_stop_before_a_tap_has_begun_begins_none() {
    let bench = Bench::new();
    bench.file("part.ngc", TAPS);
    bench.file("s.op", "at 1s stop\n");
    // The spindle is watched for 2 s.
    let patient = format!("{ENCODER}at_speed_ms = 2000\n");
    for (machine, ended, resumed) in [(patient.clone(), 4, 0), (patient + "at_speed_timeout_s = 0.5\n", 3, 3)] {
        bench.file("m.toml", machine);
        let arguments = ["run", "part.ngc", "--machine", "m.toml", "--vcd", "pins.vcd", "--operator", "s.op", "--json"];
        let run = bench.retrace(arguments);
        assert_eq!(run.code, Some(ended), "{}{}", run.out, run.err);
        assert!(run.out.contains("\"tap_not_begun\""), "{}", run.out);
        let samples = pins::samples(&bench.path("pins.vcd"));
        assert!(samples.iter().all(|sample| sample.counts[2] >= 0));
        assert!(samples.last().is_some_and(|sample| !sample.is_on("spindle")), "{:?}", samples.last());
        let again = bench.retrace(["resume", "--yes", "--json"]);
        assert_eq!(again.code, Some(resumed), "{}{}", again.out, again.err);
        assert_eq!(again.out.matches("\"tapped\"").count(), if resumed == 0 { 2 } else { 0 }, "{}", again.out);
    }
}

/// Over a line, deeper than the card holds records: they come back from the host on the way out.
#[test]
fn a_tap_deeper_than_the_window_of_the_card_comes_back_over_the_line() {
    let bench = Bench::new();
    let machine = bench.file("m.toml", format!("[card]\nwatchdog_ms = 2000\n{ENCODER}")).display().to_string();
    bench.file("part.ngc", "G21 G90\nS600 M3\nG0 X5 Z3\nG33.1 Z-80 K1\nG0 X10\nM5\nM2\n");
    let vcd = bench.path("card.vcd");
    let card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd.display().to_string(), "--speed", "4"]);
    let run = bench.retrace(["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"]);
    assert_eq!(run.code, Some(0), "{}{}", run.out, run.err);
    let _ = card.end();
    let samples = pins::samples(&vcd);
    let holes = holes(&samples, 0);
    assert!(holes.len() == 1 && (-81_100..=-80_000).contains(&holes[0]), "{holes:?}");
    assert_eq!(samples.last().map(|sample| sample.counts[..3].to_vec()), Some(vec![10_000, 0, 3_000]));
}

/// Whatever ends a tap early: the spindle is off, the machine is at rest inside of it, and nothing moves it afterwards,
/// also not a spindle that is turned by hand.
#[test]
fn whatever_ends_a_tap_early_leaves_the_spindle_off_and_the_machine_at_rest() {
    let program = TAPS.replace("Z-12", "Z-40");
    for (event, number) in
        [("encoder dead", "E3033"), ("press emergency-stop", "E3012"), ("unplug", ""), ("kill", ""), ("power off", "")]
    {
        let EarlyEnd { samples } = end_early(ENCODER, &program, ("rigid tap\"", 1500), (event, number));
        let last = samples.last().expect("a trace");
        assert!(!last.is_on("spindle") && (event == "power off" || last.counts[2] < 0), "{event}: {last:?}");
        let switched_off = samples.iter().rposition(|sample| sample.is_on("spindle")).expect("it was on");
        let still = |pair: &[Sample]| pair[0].counts == pair[1].counts;
        let stopped = samples.windows(2).rposition(|pair| !still(pair)).expect("it moved");
        // 600 turns a minute coast to rest in 0.4 s.
        assert!(event == "power off" || stopped <= switched_off + 700, "{event}: moves at {stopped}, {switched_off}");
    }
}
