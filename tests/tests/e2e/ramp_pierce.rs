//! Pierces in motion and ramps: the feed begins with the arc, and the heights follow beside it (CUT-13, CUT-18,
//! CUT-24), seen at the card's pins.
//!
//! Invariant: what is asserted of the tool axis is its path and its layer together, which is what its steps make.

use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::Bench;
use retrace_tests::limits::audit;
use retrace_tests::pins::{Sample, assert_steps_are_path_and_layer, samples};
use retrace_tests::run::Run;
use retrace_tests::sensing_torch::{PATIENT, SENSE, SHEET, machine};
use retrace_tests::served::{ServedCard, resume_to_end};

/// The float switch opens one pulse above the position where it closes.
const OPENS: i64 = 1;
const PIERCE: i64 = 1600;
const RAMP: i64 = 1000;
const CUT: i64 = 600;
const LIFT: i64 = 4000;
const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nkerf_mm = 1.4\n\
    pierce_height_mm = 4\npierce_delay_s = 0.4\ncut_height_mm = 1.5\nfeed_mm_per_min = 1800\n";
/// The figures of M159 in the sample of QtPlasmaC, but for its times and feed rates.
const M159: &str = "m159 p601 q2\nm159 p602 q50\nm159 p603 q2.5\nm159 p604 q0.6\nm159 p605 q980\nm159 p606 q5\n\
    m159 p607 q600\nm159 p608 q5\n";
/// The same, of a material.
const RAMPS: &str = "pierces_in_motion = true\nramp_delay_percent = 50\nramp_height_mm = 2.5\nramp_hold_s = 0.6\n\
    pierce_mm = 5\npierce_feed_mm_per_min = 980\ncreep_mm = 10\ncreep_feed_mm_per_min = 600\n";

/// Two cuts of 60 mm; the figures of the first end before its end, as in the sample.
fn program(figures: &str, reset: &str) -> String {
    format!(
        "G21 G90 F1800\n{figures}G0 X10\nM3 $0 S1\nG1 X70\n{reset}M5 $0\nG0 X100\nM3 $0\nG1 X160\nM5 $0\nG0 X0\nM2\n"
    )
}

fn bench(program: &str, materials: &str) -> Bench {
    let bench = Bench::new();
    let machine = machine(SENSE).replace("fire = 64\n", "fire = 64\nspindle = 0\n");
    for (name, text) in [("part.ngc", program), ("m.toml", &machine), ("materials.toml", materials)] {
        bench.file(name, text);
    }
    bench
}

fn run(bench: &Bench, faults: &str, script: &str) -> (Run, Vec<Sample>) {
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
    let arguments = ["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
    let run = Run::of(bench, &bench.path("part.ngc"), &arguments);
    assert!(assert_steps_are_path_and_layer(&vcd, "z") > 2000);
    let violations = audit(&run.records.clone().with_layer(2), &run.axes(), 1e-3);
    assert_eq!(violations.violations, [0; 3], "{script}: {:?}", violations.first);
    (run, samples(&vcd))
}

/// Position of the tool axis.
fn tool(sample: &Sample) -> i64 {
    sample.counts[2] + sample.layer
}

fn height(sample: &Sample) -> i64 {
    tool(sample) - SHEET - OPENS
}

/// The samples of each time that the torch was on.
fn lit(trace: &[Sample]) -> Vec<&[Sample]> {
    trace.chunk_by(|a, b| a.is_on("spindle") == b.is_on("spindle")).filter(|of| of[0].is_on("spindle")).collect()
}

/// The moment of the first sample that satisfies this, in ms.
fn ms(samples: &[Sample], what: impl Fn(&Sample) -> bool) -> f64 {
    samples.iter().find(|sample| what(sample)).map_or(f64::NAN, |sample| sample.at_us as f64 / 1000.0)
}

/// Mean speed of X between these two places of a contour that begins at `from_mm`, in mm per minute.
fn speed(samples: &[Sample], from_mm: f64, [begin, end]: [f64; 2]) -> f64 {
    let at = |mm: f64| ms(samples, |sample| sample.counts[0] as f64 / 200.0 - from_mm >= mm);
    (end - begin) * 60_000.0 / (at(end) - at(begin))
}

/// Asserts that the feed of a contour begins with its arc, and that its heights and feed rates are those of the ramp.
fn assert_ramp(of: &[Sample], from_mm: f64) {
    let arc_ms = ms(of, |sample| sample.inputs >> 5 & 1 == 1);
    let begins_ms = ms(of, |sample| sample.place > of[0].place);
    assert!((0.0..40.0).contains(&(begins_ms - arc_ms)), "arc at {arc_ms}, motion at {begins_ms}");
    assert_eq!(height(&of[0]), PIERCE);
    let near = |at_ms: f64, wanted: f64| assert!((at_ms - begins_ms - wanted).abs() < 6.0, "{at_ms} {begins_ms}");
    near(ms(of, |sample| height(sample) < PIERCE), 200.0);
    let down_ms = ms(of, |sample| height(sample) == RAMP);
    assert!(down_ms - begins_ms < 400.0, "down at {down_ms}");
    near(ms(of, |sample| height(sample) < RAMP), 1000.0);
    let cut_ms = ms(of, |sample| height(sample) == CUT);
    let behind = of.iter().filter(|sample| sample.at_us as f64 / 1000.0 >= cut_ms);
    assert!(behind.clone().all(|sample| height(sample) == CUT) && behind.count() > 500);
    for (range, wanted) in [([0.5, 4.5], 980.0), ([5.5, 9.5], 600.0), ([12.0, 58.0], 1800.0)] {
        let speed = speed(of, from_mm, range);
        assert!((speed / wanted - 1.0).abs() < 0.05, "{range:?}: {speed} for {wanted}");
    }
    // The path never rests between its ends.
    let moving =
        of.iter().filter(|sample| sample.place > of[0].place && sample.counts[0] as f64 / 200.0 < from_mm + 59.0);
    assert!(moving.into_iter().all(|sample| sample.rate == 1.0));
}

/// M159 of the program, and the same figures of its material; behind `M159 P609` the torch pierces at rest again.
#[test]
fn a_ramp_is_cut_from_the_arc_on_with_its_heights_and_feed_rates() {
    let (of_program, of_material) = (program(M159, "m159 p609\n"), program("", ""));
    for (program, materials) in [(of_program, MATERIALS.to_owned()), (of_material, format!("{MATERIALS}{RAMPS}"))] {
        let is_reset = program.contains("609");
        let bench = bench(&program, &materials);
        let (run, trace) = run(&bench, "", "");
        run.assert_exact_and_legal();
        let lit = lit(&trace);
        assert_eq!((lit.len(), run.number("not_cut_mm")), (2, 0.0));
        assert_ramp(lit[0], 10.0);
        if is_reset {
            let begins_ms = ms(lit[1], |sample| sample.place > lit[1][0].place);
            let arc_ms = ms(lit[1], |sample| sample.inputs >> 5 & 1 == 1);
            assert!(begins_ms - arc_ms > 400.0 && ms(lit[1], |sample| height(sample) == CUT) < begins_ms);
        } else {
            assert_ramp(lit[1], 100.0);
        }
        assert_eq!((trace.last().map(tool), trace.last().map(|sample| sample.layer)), (Some(0), Some(0)));
        let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml", "--json"]);
        assert!(checked.code == Some(0) && !checked.out.contains("W1011"), "{}", checked.out);
        let summary: serde_json::Value =
            serde_json::from_str(checked.out.lines().last().unwrap_or_default()).expect("a summary");
        let (estimate, really) = (summary["total_s"].as_f64().expect("a time"), run.number("periods") / 1000.0);
        assert!((estimate / really - 1.0).abs() < 0.01, "{estimate} s, and {really} s");
    }
}

/// The heights belong to places of the path: they are the same at any override.
#[test]
fn the_heights_of_a_ramp_are_at_the_same_places_at_any_override() {
    for percent in [100, 50, 30] {
        let bench = bench(&program(M159, "m159 p609\n"), MATERIALS);
        let (run, trace) = run(&bench, "", &format!("at 1s override {percent}%\n"));
        assert_eq!((&run.report["outcome"], run.number("not_cut_mm")), (&"completed".into(), 0.0), "{percent}");
        let first = lit(&trace)[0];
        let leaves = |from: i64| {
            let place = first.iter().find(|sample| height(sample) < from).expect("it falls").place;
            place - first[0].place
        };
        for (from, at) in [(PIERCE, 200.0), (RAMP, 1000.0)] {
            let late = leaves(from) - at;
            assert!((0.0..7.0).contains(&late), "{percent}: {from} is left {late} records behind {at}");
        }
    }
}

/// A contour that is shorter than its ramp leaves none of its heights behind for the next one.
#[test]
fn a_contour_shorter_than_its_ramp_leaves_nothing_behind() {
    let program = format!(
        "G21 G90 F1800\n{M159}G0 X10\nM3 $0 S1\nG1 X11\nm159 p609\nM5 $0\nG0 X30\nM3 $0\nG1 X100\nM5 $0\nG0 X0\nM2\n"
    );
    let bench = bench(&program, &MATERIALS.replace("pierce_delay_s = 0.4", "pierce_delay_s = 3"));
    let (run, trace) = run(&bench, "", "");
    run.assert_exact_and_legal();
    let lit = lit(&trace);
    assert_eq!((lit.len(), trace.last().map(tool)), (2, Some(0)));
    assert!(lit[0].iter().all(|sample| height(sample) == PIERCE));
    let cuts = lit[1].iter().filter(|sample| sample.place > lit[1][0].place);
    assert!(cuts.clone().count() > 2000 && cuts.into_iter().all(|sample| height(sample) == CUT));
}

/// A hold, a loss, `cutter off` and reverse run at any moment of the ramp: the torch goes off, the tool comes to rest
/// and is lifted, and the cut is recovered whole, at the pulses of the run without them. A restart pierces at rest.
#[test]
fn a_ramp_that_is_interrupted_is_recovered() {
    let program = program(M159, "m159 p609\n");
    let (whole, trace) = run(&bench(&program, MATERIALS), "", "");
    let first = lit(&trace)[0];
    let begins_s = ms(first, |sample| sample.place > first[0].place) / 1000.0;
    let mut cases: Vec<(String, String)> =
        ["0.5", "3", "4.5", "9", "14"].map(|mm| (format!("lose@{mm}"), "at 8s recover\n".to_owned())).to_vec();
    for delay_s in [0.05, 0.21, 0.25, 0.3, 0.6, 1.01, 1.05, 1.1] {
        let at_s = begins_s + delay_s;
        let back = if delay_s > 0.1 { "back 1 mm\nafter 4s recover" } else { "hold\nafter 1s recover" };
        for script in ["hold\nafter 2s recover", "cutter off\nafter 2s recover", back] {
            cases.push((String::new(), format!("at {at_s}s {script}\n")));
        }
    }
    for (faults, script) in cases {
        let case = format!("{faults} {script}");
        let (run, trace) = run(&bench(&program, MATERIALS), &faults, &script);
        let end = |run: &Run| (run.report["outcome"].clone(), run.counts());
        assert_eq!(end(&run), end(&whole), "{case}: {}", run.output.out);
        // Two cells of the simulated sheet, each of which the slow feed passes in several periods.
        assert!(run.number("not_cut_mm") <= 0.1, "{case}: {}", run.report);
        assert_eq!(trace.last().map(|sample| [tool(sample), sample.layer]), Some([0, 0]), "{case}");
        let lit = lit(&trace);
        assert_eq!(lit.len(), 3, "{case}");
        assert!(lit.iter().flat_map(|of| *of).all(|sample| (CUT..=PIERCE).contains(&height(sample))), "{case}");
        let between = trace
            .iter()
            .filter(|sample| (lit[0].last().map_or(0, |of| of.at_us)..lit[1][0].at_us).contains(&sample.at_us));
        assert!(between.clone().any(|sample| height(sample) == LIFT), "{case}: it is lifted");
        // A torch that begins in motion, in the kerf, does without a pierce; at the place of the pierce it pierces.
        let height_at_restart = height(&lit[1][0]);
        assert!(height_at_restart == CUT || height_at_restart == PIERCE, "{case}: {height_at_restart}");
    }
}

/// An emergency stop, a killed host and a pulled cable in the ramp: the torch is off, every axis comes to rest; a job
/// whose host was killed is resumed and ends at the path of the tool.
#[test]
fn a_ramp_ends_at_an_emergency_stop_a_killed_host_and_a_lost_link() {
    for cause in ["input 13 on", "unplug", "kill"] {
        let bench = bench(&program(M159, "m159 p609\n"), MATERIALS);
        let text = std::fs::read_to_string(bench.path("m.toml")).expect("a machine file");
        bench.file("m.toml", text.replace(PATIENT, "watchdog_ms = 1000"));
        let (vcd, machine) = (bench.path("pins.vcd"), bench.path("m.toml").display().to_string());
        let mut card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd.display().to_string(), "--speed", "2"]);
        let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
        let mut host = bench.start(&run, Stdio::null(), "told.txt");
        let told = || std::fs::read_to_string(bench.path("told.txt")).unwrap_or_default();
        let begun = Instant::now();
        while !told().contains("\"state\":\"cutting\"") {
            assert!(begun.elapsed() < Duration::from_secs(30), "{cause}: {}", told());
            thread::sleep(Duration::from_millis(2));
        }
        // Between 0.2 s and 1 s behind the arc.
        thread::sleep(Duration::from_millis(150));
        match cause {
            "kill" => host.kill().expect("it is killed"),
            command => card.operate(command),
        }
        host.wait().expect("it ends");
        // The watchdog of a second, and the way to rest.
        thread::sleep(Duration::from_millis(1000));
        if cause == "kill" {
            resume_to_end(&bench).unwrap_or_else(|why| panic!("{why}"));
        }
        let _ = card.end();
        assert!(assert_steps_are_path_and_layer(&vcd, "z") > 1000);
        let trace = samples(&vcd);
        let first = lit(&trace)[0];
        let off_us = first.last().map_or(0, |sample| sample.at_us);
        let place = first.last().map_or(0.0, |sample| sample.place) - first[0].place;
        assert!((201.0..1000.0).contains(&place), "{cause}: it ends in the ramp: {place}");
        let ended = trace.iter().position(|sample| sample.at_us > off_us + 600_000).unwrap_or(trace.len() - 1);
        let rests = &trace[..=ended];
        assert!(rests.last().is_some_and(|sample| sample.at_rest), "{cause}");
        assert!(first.iter().all(|sample| (CUT..=PIERCE).contains(&height(sample))), "{cause}");
        if cause == "kill" {
            assert_eq!(trace.last().map(|sample| [tool(sample), sample.layer]), Some([0, 0]), "{cause}");
        } else {
            assert_eq!(lit(&trace).len(), 1, "{cause}");
            assert!((CUT..=PIERCE).contains(&height(trace.last().expect("a sample"))), "{cause}");
        }
    }
}
