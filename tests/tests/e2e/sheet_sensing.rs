//! Starts that do without sensing the sheet, and ohmic contacts beside a float switch (CUT-13), seen at the pins.
//!
//! Invariant: what is asserted of the tool axis is its path and its layer together, which is what its steps make.

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::limits::audit;
use retrace_tests::pins::{Sample, samples};
use retrace_tests::run::Run;
use retrace_tests::sensing_torch::{SENSE, SHEET, TOOL_PULSES, machine};
use serde_json::Value;

/// Four cuts of 30 mm, which begin at X10, X60, X200 and X210.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3 S1\nG1 X40\nM5\nG0 X60\nM3\nG1 X90\nM5\nG0 X200\nM3\nG1 X230\nM5\n\
    G0 X210 Y20\nM3\nG1 X240\nM5\nG0 X0 Y0\nM2\n";
const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 1.4\n\
    pierce_height_mm = 3.8\npierce_delay_s = 0.2\ncut_height_mm = 1.5\nfeed_mm_per_min = 1800\n";
/// A contact opens one pulse above the position where it closes.
const OPENS: i64 = 1;
const PIERCE: i64 = 1520;
const CUT: i64 = 600;
const FLOAT: u64 = 1 << 7;
const OHMIC: u64 = 1 << 8;

fn bench(sense: &str, program: &str) -> Bench {
    let bench = Bench::new();
    for (name, text) in
        [("part.ngc", program), ("m.toml", &machine(&format!("{SENSE}, {sense}"))), ("materials.toml", MATERIALS)]
    {
        bench.file(name, text);
    }
    bench
}

fn run(sense: &str, program: &str, faults: &str, script: &str) -> (Run, Vec<Sample>) {
    let bench = bench(sense, program);
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
    let arguments = ["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
    let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
    assert_eq!(run.report["outcome"], "completed", "{sense} {faults} {script}: {}", run.output.err);
    (run, samples(&vcd))
}

/// Places in mm at which this contact was closed, once for each time.
fn touches(trace: &[Sample], contact: u64) -> Vec<f64> {
    let rises = trace.windows(2).filter(|pair| pair[0].inputs & contact == 0 && pair[1].inputs & contact != 0);
    rises.map(|pair| pair[1].counts[0] as f64 / 200.0).collect()
}

/// Asserts the heights of the cuts, and the limits of all axes.
fn assert_heights(run: &Run, trace: &[Sample], sheet: i64) {
    for pair in trace.windows(2) {
        let height = pair[1].counts[2] + pair[1].layer - sheet - OPENS;
        let moves = pair[0].counts[0] != pair[1].counts[0];
        let is_lit = pair[0].is_on("spindle") && pair[1].is_on("spindle");
        assert!(!is_lit || (CUT..=PIERCE).contains(&height), "lit at {height}: {:?}", pair[1]);
        assert!(!(is_lit && moves) || height == CUT, "cuts at {height}: {:?}", pair[1]);
        assert!(is_lit || !moves || height >= CUT, "rapid at {height}: {:?}", pair[1]);
    }
    assert_eq!(trace.last().map(|sample| sample.counts[2] + sample.layer), Some(0));
    let audit = audit(&run.records.clone().with_layer(2), &run.axes(), 1e-3);
    assert_eq!(audit.violations, [0; 3], "{:?}", audit.first);
}

/// A start near the place where the sheet was sensed takes its height, also where the sheet is not as expected.
#[test]
fn a_start_near_the_last_one_does_not_sense() {
    for (skip_mm, sensed) in [(0.0, [10, 60, 200, 210].as_slice()), (50.0, &[10, 60, 200]), (50.1, &[10, 200])] {
        for offset_mm in ["0", "4.5", "-6.25"] {
            let (run, trace) = run(&format!("skip_mm = {skip_mm}"), PROGRAM, &format!("sheet={offset_mm}"), "");
            run.assert_exact_and_legal();
            let sheet = SHEET + (offset_mm.parse::<f64>().expect("a number") * TOOL_PULSES) as i64;
            assert_heights(&run, &trace, sheet);
            let places: Vec<i64> = touches(&trace, FLOAT).iter().map(|mm| mm.round() as i64).collect();
            assert_eq!(places, sensed, "{skip_mm} {offset_mm}");
            let checked = bench(&format!("skip_mm = {skip_mm}"), PROGRAM);
            let checked = checked.retrace(["check", "part.ngc", "--machine", "m.toml", "--json"]);
            let summary: Value =
                serde_json::from_str(checked.out.lines().last().unwrap_or_default()).expect("a summary");
            assert_eq!(summary["sensings"], sensed.len(), "{skip_mm} {offset_mm}");
            assert_eq!(summary["consumable_starts"], serde_json::json!([{ "cutter": "torch", "starts": 4 }]));
            let (estimate, really) = (summary["total_s"].as_f64().expect("a time"), run.number("periods") / 1000.0);
            assert!(offset_mm != "0" || (estimate / really - 1.0).abs() < 0.02, "{estimate} s, and {really} s");
        }
    }
}

/// Behind a loss, a hold, the operator's cutter off and a program stop, every start senses until the place of the last
/// sensing is left. A restart in motion takes the height that the torch had there; with `skip_mm = 0` it senses.
#[test]
fn a_start_behind_a_fault_senses() {
    let held = "at line 4 override 100%\nafter 0.5s hold\nafter 2s recover\n";
    for (faults, script, program) in [
        ("lose@20", "at 9s recover\nafter 9s recover\n", PROGRAM.to_owned()),
        ("", held, PROGRAM.to_owned()),
        ("", &held.replace("hold", "cutter off"), PROGRAM.to_owned()),
        ("", "at 9s resume\nafter 9s resume\n", PROGRAM.replace("G0 X60", "M0\nG0 X60")),
    ] {
        let places_sensed =
            |trace: &[Sample]| -> Vec<i64> { touches(trace, FLOAT).iter().map(|mm| mm.round() as i64).collect() };
        let (run, trace) = run("skip_mm = 100", &program, faults, script);
        assert_heights(&run, &trace, SHEET);
        assert_eq!(run.number("not_cut_mm"), 0.0, "{faults} {script}");
        let places = places_sensed(&trace);
        assert_eq!((places[0], places.contains(&60), places.contains(&200)), (10, true, true), "{script} {places:?}");
        // X200 is sensed by the program, so that X210 does without it.
        assert!(!places.contains(&210), "{script}: {places:?}");
        let senses_within = |places: &[i64]| places.iter().any(|place| (11..=40).contains(place));
        assert!(!senses_within(&places), "{script}: the restart: {places:?}");
        if !program.contains("M0") {
            let (always, trace) = self::run("", &program, faults, script);
            assert_heights(&always, &trace, SHEET);
            assert!(senses_within(&places_sensed(&trace)), "{script}: without skip_mm");
        }
    }
}

/// The ohmic contact finds the sheet before the float switch; where it does not close, it is tried again, and then the
/// float switch counts. The heights are the same.
#[test]
fn an_ohmic_contact_finds_the_sheet_and_the_float_switch_stands_in() {
    for offset in ["0", "0.25", "-0.5"] {
        let sense = format!("ohmic = [8], ohmic_tries = 2, ohmic_offset_mm = {offset}");
        for (faults, ohmic, float) in [("sheet=1.5", 4, 0), ("sheet=1.5,no-ohmic", 0, 4 * 3)] {
            let (run, trace) = run(&sense, PROGRAM, faults, "");
            run.assert_exact_and_legal();
            assert_heights(&run, &trace, SHEET + 600);
            assert_eq!(
                (touches(&trace, OHMIC).len(), touches(&trace, FLOAT).len()),
                (ohmic, float),
                "{sense} {faults}"
            );
        }
    }
    let lost = run("ohmic = [8]", PROGRAM, "lose@20,no-ohmic", "at 15s recover\nafter 9s recover\n");
    assert_heights(&lost.0, &lost.1, SHEET);
    // What cannot work is refused.
    for (sense, why) in [
        ("ohmic = [5]", "ohmic = [5]"),
        ("ohmic = [7]", "ohmic = [7]"),
        ("ohmic = [8], ohmic_tries = 21", "ohmic_tries"),
        ("ohmic = [8], ohmic_offset_mm = -1.3", "ohmic_offset_mm"),
        ("skip_mm = -1", "skip_mm"),
    ] {
        let refused = bench(sense, PROGRAM).retrace(["run", "part.ngc", "--machine", "m.toml"]);
        assert_eq!(refused.code, Some(2), "{sense}");
        assert_contains(&refused.err, &[why]);
    }
}
