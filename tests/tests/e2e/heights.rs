//! A torch that senses the sheet and cuts at the heights of its material (CUT-13 to CUT-15), seen at the card's pins.
//!
//! Invariant: what is asserted of the tool axis is its path and its layer together, which is what its steps make.

use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::limits::audit;
use retrace_tests::pins::{Sample, assert_steps_are_path_and_layer, samples};
use retrace_tests::run::Run;
use retrace_tests::sensing_torch::{PATIENT, SENSE, SHEET, TOOL_PULSES, machine};
use retrace_tests::served::{ServedCard, resume_to_end};
use serde_json::Value;

/// Two cuts of 60 mm.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3 S1\nG1 X70\nM5\nG0 X100\nM3\nG1 X160\nM5\nG0 X0\nM2\n";
const MATERIALS: &str = "units = \"mm\"\ndefault = 1\n[[material]]\nnumber = 1\nname = \"Steel\"\nkerf_mm = 1.4\n\
    pierce_height_mm = 3.8\npierce_delay_s = 0.4\ncut_height_mm = 1.5\nfeed_mm_per_min = 1800\n";
/// The float switch opens one pulse above the position where it closes.
const OPENS: i64 = 1;
const PIERCE: i64 = 1520;
const CUT: i64 = 600;
const SAFE: i64 = 6000;
const LIFT: i64 = 4000;

fn bench() -> Bench {
    let bench = Bench::new();
    for (name, text) in [("part.ngc", PROGRAM), ("m.toml", &machine(SENSE)), ("materials.toml", MATERIALS)] {
        bench.file(name, text);
    }
    bench
}

fn run(faults: &str, script: &str) -> (Run, Vec<Sample>) {
    let bench = bench();
    let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
    let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
    let arguments = ["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
    let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
    (run, samples(&vcd))
}

/// Position of the tool axis.
fn tool(sample: &Sample) -> i64 {
    sample.counts[2] + sample.layer
}

/// Asserts what holds of every run: heights of the cuts and of the rapids, and the limits of all axes.
fn assert_heights(run: &Run, trace: &[Sample], sheet: i64) {
    let opened = sheet - (1.2 * TOOL_PULSES) as i64 + OPENS;
    let travel = (1.2 * TOOL_PULSES) as i64;
    for pair in trace.windows(2) {
        let (height, moves) = (tool(&pair[1]) - opened - travel, pair[0].counts[0] != pair[1].counts[0]);
        let is_lit = pair[0].is_on("spindle") && pair[1].is_on("spindle");
        assert!(!is_lit || (CUT..=PIERCE).contains(&height), "lit at {height}: {:?}", pair[1]);
        assert!(!(is_lit && moves) || height == CUT, "cuts at {height}: {:?}", pair[1]);
        assert_eq!(pair[0].counts[2], pair[1].counts[2], "the path of the tool axis stays");
    }
    let physical = run.records.clone().with_layer(2);
    let audit = audit(&physical, &run.axes(), 1e-3);
    assert_eq!(audit.violations, [0; 3], "{:?}", audit.first);
}

/// States of the torch, in order.
fn states(run: &Run) -> Vec<String> {
    run.of_kind("cutter_state").map(|event| event["state"].as_str().unwrap_or_default().to_owned()).collect()
}

/// The torch is lit at the pierce height over the sheet as it was found, cuts at the height of the cut, and the tool
/// axis ends where it began.
#[test]
fn a_program_is_cut_at_the_heights_of_its_material() {
    for (faults, offset_mm) in [("", 0.0), ("sheet=4.5", 4.5), ("sheet=-6.25", -6.25)] {
        let sheet = SHEET + (offset_mm * TOOL_PULSES) as i64;
        let (run, trace) = run(faults, "");
        run.assert_exact_and_legal();
        assert_heights(&run, &trace, sheet);
        let first = trace.iter().find(|sample| sample.is_on("spindle")).expect("it is lit");
        assert_eq!(tool(first) - sheet - OPENS, PIERCE, "{faults}");
        let rapids = trace.iter().filter(|sample| sample.line == 6 && sample.rate > 0.0);
        assert!(rapids.clone().count() > 0 && rapids.clone().all(|s| tool(s) - sheet - OPENS == SAFE), "{faults}");
        assert_eq!(trace.last().map(tool), Some(0));
        assert_eq!(states(&run)[..4], ["sensing", "igniting", "piercing", "cutting"]);
    }
    let (run, _) = run("", "");
    let bench = bench();
    let checked = bench.retrace(["check", "part.ngc", "--machine", "m.toml", "--json"]);
    let summary: Value = serde_json::from_str(checked.out.lines().last().unwrap_or_default()).expect("a summary");
    let (estimate, really) = (summary["total_s"].as_f64().expect("a time"), run.number("periods") / 1000.0);
    assert!((estimate / really - 1.0).abs() < 0.01, "{estimate} s, and {really} s");
}

/// Behind the pierce the feed begins, and beside it the torch waits at the puddle height, and goes to that of the cut;
/// so does a cut that is lost and recovered, and one that begins at a line.
#[test]
fn a_puddle_is_passed_at_its_height() {
    const PUDDLE: i64 = 3 * PIERCE / 2;
    let figures = format!("{MATERIALS}puddle_percent = 150\npuddle_s = 0.3\n");
    for (faults, script, line) in [("", "", "1"), ("lose@20", "at 6s recover\n", "1"), ("", "", "4")] {
        let bench = bench();
        bench.file("materials.toml", &figures);
        let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
        let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
        let arguments = [
            "--machine",
            &machine,
            "--vcd",
            &trace,
            "--source-faults",
            faults,
            "--operator",
            &operator,
            "--start-line",
            line,
        ];
        let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
        assert_eq!(run.report["outcome"], "completed", "{faults} {line}: {}", run.output.err);
        assert!(assert_steps_are_path_and_layer(&vcd, "z") > 5000);
        let violations = audit(&run.records.clone().with_layer(2), &run.axes(), 1e-3).violations;
        assert_eq!(violations, [0; 3], "{faults} {line}");
        let trace = samples(&vcd);
        assert_eq!(trace.last().map(tool), Some(0), "{faults} {line}");
        let height = |sample: &Sample| tool(sample) - SHEET - OPENS;
        let (mut waits_ms, mut beside, mut is_down) = (Vec::new(), 0, false);
        for pair in trace.windows(2) {
            let moves = pair[0].place != pair[1].place;
            if !(pair[0].is_on("spindle") && pair[1].is_on("spindle")) {
                is_down = false;
                continue;
            }
            assert!((CUT..=PUDDLE).contains(&height(&pair[1])), "{faults} {line}: {:?}", pair[1]);
            assert!(!is_down || height(&pair[1]) == CUT, "{faults} {line}: {:?}", pair[1]);
            assert!(moves || height(&pair[1]) <= PIERCE, "{faults} {line}: it waits in motion: {:?}", pair[1]);
            is_down |= height(&pair[1]) == CUT;
            beside += u32::from(moves && pair[0].layer != pair[1].layer);
            if height(&pair[0]) == PUDDLE {
                waits_ms.push((pair[1].at_us - pair[0].at_us) / 1000);
            }
        }
        // one of each start of the program; a restart goes to the height of the cut at once
        let starts = if line == "1" { 2.0 } else { 1.0 };
        let waited_s = waits_ms.iter().sum::<u64>() as f64 / 1000.0;
        assert!((waited_s / (0.3 * starts) - 1.0).abs() < 0.1, "{faults} {line}: {waited_s} s");
        assert!(f64::from(beside) > 200.0 * starts, "{faults} {line}: {beside} periods");
    }
}

/// A start in the middle of a contour, or between two, with the tool high or near the sheet: the tool is lifted before
/// the rapid there, and the sheet is sensed before the torch is lit.
#[test]
fn a_start_at_a_line_senses_the_sheet_first() {
    for (line, sheet_mm) in [("4", -70), ("6", -70), ("4", -5), ("6", -5)] {
        let (bench, case) = (bench(), format!("line {line}, sheet at {sheet_mm} mm"));
        let machine = machine(&SENSE.replace("-70", &sheet_mm.to_string())).replace("[-100, 0]", "[-100, 50]");
        let (machine, vcd) = (bench.file("m.toml", machine).display().to_string(), bench.path("pins.vcd"));
        let trace = vcd.display().to_string();
        let arguments = ["--machine", &machine, "--vcd", &trace, "--start-line", line];
        let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
        assert_eq!(run.report["outcome"], "completed", "{}", run.output.err);
        let trace = samples(&vcd);
        for pair in trace.windows(2) {
            let height = tool(&pair[1]) - sheet_mm * TOOL_PULSES as i64 - OPENS;
            let moves = pair[0].counts[0] != pair[1].counts[0];
            let is_lit = pair[0].is_on("spindle") && pair[1].is_on("spindle");
            assert!(!is_lit || (CUT..=PIERCE).contains(&height), "{case}: lit at {height}: {:?}", pair[1]);
            assert!(!(is_lit && moves) || height == CUT, "{case}: cuts at {height}: {:?}", pair[1]);
            assert!(is_lit || !moves || height >= SAFE - OPENS, "{case}: rapid at {height}: {:?}", pair[1]);
        }
        assert!(trace.iter().any(|sample| sample.is_on("spindle")), "{case}");
        assert_eq!(trace.last().map(tool), Some(0), "{case}");
    }
}

/// In a dry run nothing is sensed or lit, and the tool passes the whole program at the safe height over the expected
/// sheet, or higher.
#[test]
fn a_dry_run_stays_at_the_safe_height() {
    let begins_with_a_cut = PROGRAM.replace("G0 X10\n", "");
    for (sheet_mm, lift_mm, program) in [(-70, 0, PROGRAM), (-5, 10, PROGRAM), (-5, 10, &begins_with_a_cut)] {
        let (bench, case) = (bench(), format!("sheet at {sheet_mm} mm"));
        bench.file("part.ngc", program);
        let machine = machine(&SENSE.replace("-70", &sheet_mm.to_string())).replace("[-100, 0]", "[-100, 50]");
        let (machine, vcd) = (bench.file("m.toml", machine).display().to_string(), bench.path("pins.vcd"));
        let trace = vcd.display().to_string();
        let run = Run::of(&bench, &bench.path("part.ngc"), &["--machine", &machine, "--vcd", &trace, "--dry-run"]);
        assert_eq!(run.report["outcome"], "completed", "{case}: {}", run.output.err);
        let trace = samples(&vcd);
        for pair in trace.windows(2).filter(|pair| pair[0].counts[0] != pair[1].counts[0]) {
            assert_eq!(tool(&pair[1]), lift_mm * TOOL_PULSES as i64, "{case}: {:?}", pair[1]);
        }
        assert!(trace.iter().all(|sample| !sample.is_on("spindle") && sample.inputs >> 7 & 1 == 0), "{case}");
        assert_eq!(trace.last().map(tool), Some(0), "{case}");
    }
}

/// No sheet, or one that is higher than where it is sensed from: nothing is lit, nothing is fed, and the operator may
/// try again, skip the contour or stop.
#[test]
fn a_sheet_that_is_not_found_is_told_and_nothing_is_lit() {
    for (faults, reason) in [("no-sheet", "no_sheet"), ("sheet=-30", "no_sheet"), ("sheet=25", "sheet_contact")] {
        let (run, trace) = run(faults, "at 8s recover\nafter 8s skip contour\nafter 14s stop\n");
        assert_eq!(run.report["outcome"], "stopped");
        let off: Vec<&Value> = run.of_kind("cutter_off").map(|event| &event["reason"]).collect();
        assert!(off.len() >= 2 && off.iter().all(|told| *told == reason), "{faults}: {off:?}");
        assert!(trace.iter().all(|sample| !sample.is_on("spindle")), "{faults}");
        let passes = trace.windows(2).filter(|pair| pair[0].counts[0] != pair[1].counts[0]);
        assert!(trace.iter().any(|sample| sample.line >= 6), "{faults}: the contour was skipped");
        assert!(passes.clone().count() > 0 && passes.clone().all(|pair| tool(&pair[1]) >= SHEET + SAFE), "{faults}");
    }
}

/// A start that is ended while the tool touches the sheet leaves it there; it is lifted before it senses again.
#[test]
fn a_start_that_ends_on_the_sheet_is_begun_anew() {
    let (whole, _) = run("", "");
    let mut rests_on_sheet = 0;
    for at_ms in (2600..3500).step_by(75) {
        let (run, trace) = run("", &format!("at {}s cutter off\nafter 2s recover\n", at_ms as f64 / 1000.0));
        let end = |run: &Run| (run.report["outcome"].clone(), run.counts());
        assert_eq!(end(&run), end(&whole), "{at_ms} ms: {}", run.output.out);
        assert_heights(&run, &trace, SHEET);
        let held = trace.iter().rev().find(|sample| sample.at_us < (at_ms + 1900) * 1000).expect("a sample");
        rests_on_sheet += u32::from(held.inputs >> 7 & 1 == 1);
    }
    assert!(rests_on_sheet > 0);
}

/// An arc that is lost, and one that is put out by hand: the cut is continued at the height of the cut.
#[test]
fn a_lost_cut_is_continued_at_its_height() {
    let (whole, _) = run("", "");
    for (faults, script) in [
        ("lose@20", "at 7s recover\n"),
        ("", "at 5s hold\nafter 1s recover\n"),
        ("", "at 5s cutter off\nafter 2s recover\n"),
    ] {
        let (run, trace) = run(faults, script);
        assert_eq!(
            (&run.report["outcome"], run.counts()),
            (&whole.report["outcome"], whole.counts()),
            "{}",
            run.output.out
        );
        assert_heights(&run, &trace, SHEET);
        assert_eq!(run.number("not_cut_mm"), 0.0);
        assert_eq!(trace.last().map(tool), Some(0));
    }
}

/// Where a cut is interrupted the tool is lifted at rest, and the path is retraced at that height, backward and
/// forward, also for a shifted start; a stop waits for the lift. The torch is off meanwhile.
#[test]
fn an_interrupted_cut_is_lifted_off_and_retraced_at_height() {
    let (whole, _) = run("", "");
    let back = "back 12 mm\nafter 2s forward 50%\nafter 0.4s hold\nafter 1s recover\n";
    for (faults, script, passes) in [
        ("lose@20", "at 7s recover\n".to_owned(), 1),
        ("", "at 5s hold\nafter 0.2s recover\n".to_owned(), 0),
        ("", "at 5s cutter off\nafter 2s recover\n".to_owned(), 0),
        ("", format!("at 5s {back}"), 1),
        ("lose@20", format!("at 7s {back}"), 1),
        ("lose@20", "at 7s back to cut end\nafter 3s shift 0 4\nafter 0s cut\n".to_owned(), 1),
    ] {
        let (run, trace) = run(faults, &script);
        assert_eq!(run.report["outcome"], "completed", "{script}: {}", run.output.out);
        assert_eq!((run.counts(), run.number("not_cut_mm")), (whole.counts(), 0.0), "{script}");
        assert_heights(&run, &trace, SHEET);
        assert!(run.of_kind("tool_lifted").count() > 0, "{script}");
        let height = |sample: &Sample| tool(sample) - SHEET - OPENS;
        let off = trace.windows(2).filter(|pair| {
            let moves = pair[0].counts[..2] != pair[1].counts[..2];
            moves && pair[1].place != pair[0].place && !pair[0].is_on("spindle") && !pair[1].is_on("spindle")
        });
        let in_cut = |pair: &&[Sample]| pair[1].line == 4 || pair[1].line == 8;
        let retraced: Vec<i64> = off.filter(in_cut).map(|pair| height(&pair[1])).collect();
        // Besides the last pulses on the way to rest.
        let low = retraced.iter().filter(|&&height| height != LIFT).count();
        assert!(low <= 200 && retraced.len() >= 300 * passes, "{script}: {low} of {}", retraced.len());
        assert_eq!(trace.last().map(tool), Some(0), "{script}");
    }
    let (stopped, trace) = run("lose@20", "at 4.95s hold\nat 5.55s stop\n");
    assert_eq!(stopped.report["outcome"], "stopped");
    let stands = trace.last().map(tool).expect("a sample");
    assert_eq!((stopped.report["position_counts"]["z"].as_i64(), stands), (Some(stands), SHEET + OPENS + LIFT));
}

/// A hold while the sheet is sensed: the tool axis rests, and goes on with the program.
#[test]
fn a_hold_while_the_sheet_is_sensed_rests() {
    // Nobody comes.
    let (abandoned, _) = run("", "at 1s hold\n");
    assert_eq!(abandoned.report["outcome"], "stopped");
    let (run, trace) = run("", "at 1s hold\nafter 2s resume\n");
    assert_heights(&run, &trace, SHEET);
    let at = |us: u64| trace.iter().rev().find(|sample| sample.at_us <= us).map(tool);
    assert_eq!((at(1_600_000), at(1_600_000)), (at(2_900_000), at(2_000_000)));
    assert!(trace.iter().all(|sample| sample.at_us > 3_000_000 || !sample.is_on("spindle")));
    assert_eq!((&run.report["outcome"], trace.last().map(tool)), (&"completed".into(), Some(0)));
}

/// In a pause the tool stays at its height until an axis is jogged; before the program goes on, it returns to its path,
/// and the sheet is sensed again.
#[test]
fn a_pause_in_a_cut_ends_with_the_sheet_sensed_again() {
    let (whole, _) = run("", "");
    for jog in ["", "after 1s jog z 12\nafter 4s jog x 30\n"] {
        let goes_on = "after 1s spindle start\nafter 1s online\nafter 0s cycle start\nafter 12s recover\n";
        let script = format!("at 5s pause\nafter 0s spindle stop\n{jog}after 4s online\n{goes_on}");
        let (run, trace) = run("", &script);
        assert_eq!(
            (&run.report["outcome"], run.counts()),
            (&whole.report["outcome"], whole.counts()),
            "{}",
            run.output.out
        );
        assert!(states(&run).iter().filter(|state| *state == "sensing").count() >= 3, "{:?}", states(&run));
        assert_eq!((trace.last().map(tool), run.number("not_cut_mm")), (Some(0), 0.0));
    }
}

/// *Park* goes up and across, *change done* back across and down; the cut that was lost is then continued where it
/// ended, and one that was whole where the machine stood. A hold stops the axes on the way.
#[test]
fn consumables_are_changed_at_the_park_position() {
    let (whole, _) = run("", "");
    let park = "[manual]\npark_mm = { x = 300, y = 40 }\n";
    for (faults, script) in [
        ("lose@20", "at 7s park\nafter 8s change done\nafter 10s recover\n"),
        ("lose@20", "at 7s park\nafter 1.5s hold\nafter 1s park\nafter 8s change done\nafter 10s recover\n"),
        ("", "at 5s park\nafter 8s change done\nafter 10s recover\n"),
    ] {
        let bench = bench();
        bench.file("m.toml", format!("retract_mm = -10\n{}{park}", machine(SENSE)));
        let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
        let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
        let arguments = ["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
        let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
        let end = |run: &Run| (run.report["outcome"].clone(), run.counts(), run.number("not_cut_mm"));
        assert_eq!(end(&run), end(&whole), "{script}: {}", run.output.out);
        let stopped: Vec<&Value> = run.of_kind("parked").map(|event| &event["stopped"]).collect();
        assert_eq!(stopped.last(), Some(&&Value::Bool(false)), "{script}");
        assert_eq!(stopped.len() > 1, script.contains("hold"), "{script}");
        let trace = samples(&vcd);
        let parked = |sample: &Sample| sample.counts[..2] == [300 * 200, 40 * 200];
        assert!(trace.iter().any(|sample| parked(sample) && tool(sample) == -10 * 400), "{script}");
        for pair in trace.windows(2).filter(|pair| pair[0].counts[1] != pair[1].counts[1]) {
            assert!(tool(&pair[1]) >= -10 * 400 && !pair[1].is_on("spindle"), "{script}: {:?}", pair[1]);
        }
        assert_eq!(trace.last().map(tool), Some(0), "{script}");
    }
    let (unparked, _) = run("", "at 5s park\nafter 0s hold\nafter 1s recover\n");
    assert_eq!(unparked.report["outcome"], "completed");
    let why = unparked.of_kind("command_rejected").map(|event| event["reason"].to_string()).next();
    assert!(why.is_some_and(|why| why.contains("park_mm")));
}

/// *Pointer* moves the pointer over where the tool stood, or would start after a shift; its output is on only at rest
/// there, and *change done* brings the tool back. Where the offset lies beyond a limit nothing moves.
#[test]
fn the_pointer_shows_where_the_tool_starts() {
    let (whole, _) = run("", "");
    let end = |run: &Run| (run.report["outcome"].clone(), run.counts(), run.number("not_cut_mm"));
    for (script, shift) in [
        ("at 7s pointer\nafter 8s change done\nafter 10s recover\n", [0, 0]),
        (
            "at 7s shift 2 -3\nafter 0.1s pointer\nafter 8s change done\nafter 10s shift 0\nafter 1s recover\n",
            [400, -600],
        ),
        ("at 7s pointer\nafter 1.5s hold\nafter 1s pointer\nafter 8s change done\nafter 10s recover\n", [0, 0]),
    ] {
        let bench = bench();
        let pointer = "[manual]\npointer_mm = { x = -60, y = 25.5 }\npointer_output = 6\n";
        bench.file("m.toml", format!("retract_mm = -10\n{}{pointer}", machine(SENSE)));
        let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
        let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
        let faults = "lose@20";
        let arguments = ["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
        let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
        assert_eq!(end(&run), end(&whole), "{script}: {}", run.output.out);
        let stopped: Vec<&Value> = run.of_kind("pointer_there").map(|event| &event["stopped"]).collect();
        assert_eq!(stopped.len(), if script.contains("hold") { 2 } else { 1 }, "{script}");
        assert_eq!(stopped.last(), Some(&&Value::Bool(false)), "{script}");
        let latched = run.of_kind("paused").next().map(|event| event["counts"].clone());
        let latched: Vec<i64> = serde_json::from_value(latched.unwrap_or_default()).unwrap_or_default();
        let over = [latched[0] + 60 * 200 + shift[0], latched[1] - 5100 + shift[1]];
        let trace = samples(&vcd);
        assert!(trace.iter().any(|sample| sample.is_on("out6")), "{script}");
        for pair in trace.windows(2).filter(|pair| pair[0].is_on("out6") || pair[1].is_on("out6")) {
            assert_eq!(pair[1].counts[..2], over, "{script}");
            assert!(!pair[1].is_on("spindle") && tool(&pair[1]) >= -10 * 400, "{script}");
        }
    }
    let refused = |pointer: &str| {
        let bench = bench();
        bench.file("m.toml", format!("retract_mm = -10\n{}{pointer}", machine(SENSE)));
        let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
        let (operator, trace) = (
            bench.file("s.op", "at 5s pointer\nafter 8s change done\nafter 10s recover\n").display().to_string(),
            vcd.display().to_string(),
        );
        let arguments = ["--machine", &machine, "--vcd", &trace, "--operator", &operator];
        let run = Run::of(&bench, &bench.path("part.ngc"), &arguments);
        assert_eq!(end(&run), end(&whole), "{}", run.output.out);
        assert!(run.of_kind("pointer_there").next().is_none());
        let why = run.of_kind("command_rejected").map(|event| event["reason"].to_string()).next();
        why.unwrap_or_default()
    };
    assert!(refused("").contains("pointer_mm"));
    let beyond = refused("[manual]\npointer_mm = { x = 1000 }\n");
    assert!(beyond.contains('X'), "{beyond}");
}

/// A contour far behind is gone back to directly: up, across and down, where that is faster than along the path. The
/// rest of it is cut, and what is cut behind it is passed with the torch off. A hold on the way stops the axes; `change
/// done` continues.
#[test]
fn a_contour_far_behind_is_gone_back_to_directly() {
    let zigzag: String =
        (1..12).map(|n| format!("G1 Y{}\nG1 X{}\n", 3 * n, if n % 2 == 0 { 100 } else { 160 })).collect();
    let program =
        format!("G21 G90 F1800\nG0 X10\nM3 S1\nG1 X70\nM5\nG0 X100\nM3\nG1 X160\n{zigzag}M5\nG0 X0 Y0\nG4 P30\nM2\n");
    let run = |script: &str, faults: &str| {
        let bench = bench();
        bench.file("part.ngc", &program);
        bench.file("m.toml", format!("retract_mm = -10\n{}", machine(SENSE)));
        let (machine, vcd) = (bench.path("m.toml").display().to_string(), bench.path("pins.vcd"));
        let (operator, trace) = (bench.file("s.op", script).display().to_string(), vcd.display().to_string());
        let arguments = ["--machine", &machine, "--vcd", &trace, "--source-faults", faults, "--operator", &operator];
        (Run::of(&bench, &bench.path("part.ngc"), &arguments), samples(&vcd))
    };
    let (whole, _) = run("", "");
    let cut = "after 8s cut\n";
    // At rest, held on the way, and while the machine still brakes with the torch on.
    for (wait, more) in [("0.5s", ""), ("0.5s", "after 1.5s hold\nafter 1s change done\n"), ("0.02s", "")] {
        let script = format!("at 7s skip contour\nat 50s hold\nafter {wait} back to contour 1\n{more}{cut}");
        let (run, trace) = run(&script, "lose@20");
        let what = format!("{script}: {}", run.output.out);
        assert_eq!(run.report["outcome"], "completed", "{what}");
        assert_eq!((run.counts(), run.number("not_cut_mm")), (whole.counts(), 0.0), "{what}");
        let time = |kind: &str| run.of_kind(kind).last().and_then(|event| event["time_s"].as_f64()).unwrap_or(0.0);
        let (arrived_s, reached_s) = (time("arrived"), time("back_target_reached"));
        assert!(arrived_s > 50.5 && arrived_s < 57.0 && (reached_s - arrived_s).abs() < 0.1, "{what}");
        let way = trace.windows(2).filter(|pair| (50_500_000..(arrived_s * 1e6) as u64).contains(&pair[1].at_us));
        let moves = way.filter(|pair| pair[0].counts[..2] != pair[1].counts[..2]);
        assert!(moves.clone().count() > 0, "{what}");
        for pair in moves {
            assert!(tool(&pair[1]) >= -10 * 400 && !pair[1].is_on("spindle"), "{:?} {what}", pair[1]);
        }
        // The layer becomes part of the counts there: together they are continuous, at 60 mm/s at most.
        for pair in trace.windows(2) {
            let periods = ((pair[1].at_us - pair[0].at_us) / 1000).max(1) as i64;
            assert!((tool(&pair[1]) - tool(&pair[0])).abs() <= 25 * periods, "{:?} {what}", pair[1]);
        }
        assert_eq!(trace.last().map(tool), Some(0), "{what}");
    }
}

/// In the restart after a loss a hold ends the start; the next one begins it anew.
#[test]
fn a_hold_while_the_sheet_is_sensed_again_rests() {
    let (run, trace) = run("lose@20", "at 7s recover\nafter 2s hold\nafter 3s recover\n");
    assert_heights(&run, &trace, SHEET);
    let at = |us: u64| trace.iter().rev().find(|sample| sample.at_us <= us).map(tool);
    let sensing = run.of_kind("cutter_state").filter(|event| event["state"] == "sensing").nth(1).expect("it senses");
    assert!(sensing["time_s"].as_f64().is_some_and(|at_s| (7.0..9.0).contains(&at_s)), "{sensing}");
    assert_eq!(at(9_700_000), at(11_900_000));
    assert!(trace.iter().all(|sample| !(9_500_000..12_000_000).contains(&sample.at_us) || !sample.is_on("spindle")));
    assert_eq!((&run.report["outcome"], run.number("not_cut_mm")), (&"completed".into(), 0.0));
}

/// A job that is stopped leaves the tool at its height, which is then part of its position.
#[test]
fn a_stopped_job_tells_where_the_tool_is() {
    let (run, trace) = run("", "at 5s stop\n");
    assert_eq!(run.report["outcome"], "stopped");
    let stands = trace.last().map(tool).expect("a sample");
    assert_eq!(run.report["position_counts"]["z"], stands, "{}", run.report);
    assert_eq!(stands, SHEET + OPENS + CUT);
}

/// A job that begins where another was stopped, near the sheet, lifts the tool before its first rapid.
#[test]
fn a_job_that_begins_near_the_sheet_lifts_the_tool_first() {
    let bench = bench();
    let (vcd, machine) = (bench.path("pins.vcd"), bench.path("m.toml").display().to_string());
    bench.file("s.op", "at 5s stop\n");
    let card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd.display().to_string(), "--speed", "2"]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
    assert_eq!(bench.retrace([&run[..], &["--operator", "s.op"]].concat()).code, Some(4));
    // On metal that is not cut yet.
    bench.file("part.ngc", PROGRAM.replace("G0 X10\n", "G0 X10 Y50\n").replace("G0 X0\n", "G0 X0 Y0\n"));
    let again = bench.retrace(run);
    assert_eq!(again.code, Some(0), "{}{}", again.out, again.err);
    let _ = card.end();
    let trace = samples(&vcd);
    let rapids = trace.windows(2).filter(|pair| pair[0].counts[0] != pair[1].counts[0] && !pair[1].is_on("spindle"));
    // Besides the last pulses of the cut that was stopped.
    let low = rapids.filter(|pair| tool(&pair[1]) < SHEET + SAFE - 1).count();
    assert!(low < 200, "{low}");
    assert_eq!(trace.last().map(tool), Some(SHEET + OPENS + CUT), "where it began");
}

/// The host is killed in the cut, and while the sheet is sensed; the tool axis returns to its path, and the sheet is
/// sensed anew.
#[test]
fn a_killed_host_leaves_a_job_that_is_cut_at_its_heights() {
    for state in ["sensing", "cutting"] {
        let bench = bench();
        let (vcd, machine) = (bench.path("pins.vcd"), bench.path("m.toml").display().to_string());
        let card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd.display().to_string(), "--speed", "2"]);
        let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json"];
        let mut host = bench.start(&run, Stdio::null(), "killed.txt");
        let told = || std::fs::read_to_string(bench.path("killed.txt")).unwrap_or_default();
        let begun = Instant::now();
        while !told().contains(&format!("\"state\":\"{state}\"")) {
            assert!(begun.elapsed() < Duration::from_secs(30), "{state}: {}", told());
            thread::sleep(Duration::from_millis(5));
        }
        thread::sleep(Duration::from_millis(100));
        host.kill().expect("it is killed");
        host.wait().expect("it ends");
        resume_to_end(&bench).unwrap_or_else(|why| panic!("{state}: {why}"));
        let _ = card.end();
        let trace = samples(&vcd);
        assert_eq!(trace.last().map(tool), Some(0), "{state}");
        let height = |sample: &Sample| tool(sample) - SHEET - OPENS;
        let lit = trace.windows(2).filter(|pair| pair[0].is_on("spindle") && pair[1].is_on("spindle"));
        assert!(lit.clone().all(|pair| (CUT..=PIERCE).contains(&height(&pair[1]))), "{state}");
        let cuts = |pair: &&[Sample]| pair[0].counts[0] != pair[1].counts[0];
        assert!(lit.filter(cuts).all(|pair| height(&pair[1]) == CUT), "{state}");
    }
}

/// What cannot work is refused before anything moves.
#[test]
fn a_machine_that_cannot_sense_is_refused() {
    let bench = bench();
    for (sense, why) in [
        ("contacts = [7], sheet_mm = -70, start_mm = 80", "beyond the travel"),
        ("contacts = [7], sheet_mm = -95", "beyond the travel"),
        ("contacts = [5], sheet_mm = -70", "another use"),
        ("contacts = [13], sheet_mm = -70", "another use"),
        ("contacts = [7], sheet_mm = -70, probe_mm_per_s = 0", "probe_mm_per_s"),
    ] {
        bench.file("refused.toml", machine(sense));
        let refused = bench.retrace(["run", "part.ngc", "--machine", "refused.toml"]);
        assert_eq!(refused.code, Some(2), "{sense}");
        assert_contains(&refused.err, &[why]);
    }
    bench.file("materials.toml", MATERIALS.replace("cut_height_mm = 1.5", "cut_height_mm = 0"));
    let refused = bench.retrace(["check", "part.ngc", "--machine", "m.toml"]);
    assert!(refused.code != Some(0), "{}", refused.out);
    assert_contains(&(refused.out + &refused.err), &["heights"]);
}

/// While the tool is lifted, parked and returned directly, the emergency stop, a killed host and a pulled cable bring
/// every axis to rest with the torch off, and the card has an alarm latched.
#[test]
fn the_moves_off_a_cut_end_at_an_emergency_stop_a_killed_host_and_a_lost_link() {
    let zigzag: String =
        (1..6).map(|n| format!("G1 Y{}\nG1 X{}\n", 3 * n, if n % 2 == 0 { 100 } else { 160 })).collect();
    let program = format!("G21 G90 F1800\nG0 X10\nM3 S1\nG1 X70\nM5\nG0 X100\nM3\nG1 X160\n{zigzag}M5\nG0 X0 Y0\nM2\n");
    let direct = "at 7s skip contour\nat line 18 override 100%\nafter 0.5s hold\nafter 0.5s back to contour 1\n";
    for (moving, script, told, delay_ms, causes) in [
        ("lift", "", "\"state\":\"lost\"", 30, ["input 13 on", "kill"]),
        ("park", "at 7s park\n", "\"event\":\"paused\"", 300, ["input 13 on", "unplug"]),
        ("return", direct, "\"event\":\"approaching\"", 300, ["input 13 on", "kill"]),
    ] {
        for cause in causes {
            let (bench, case) = (bench(), format!("{moving}, {cause}"));
            bench.file("part.ngc", &program);
            let with_park = "[manual]\npark_mm = { x = 300, y = 40 }\n";
            bench.file(
                "m.toml",
                // Enough is planned ahead for a card at four times the speed whose host is kept from running.
                format!(
                    "retract_mm = -10\nlook_ahead_s = 2\n{}{with_park}",
                    machine(SENSE).replace(PATIENT, "watchdog_ms = 1000")
                ),
            );
            bench.file("s.op", script);
            let (vcd, machine) = (bench.path("pins.vcd"), bench.path("m.toml").display().to_string());
            let trace = vcd.display().to_string();
            let card = ["--machine", &machine, "--vcd", &trace, "--source-faults", "lose@20", "--speed", "4"];
            let mut card = ServedCard::with(&card);
            let run = ["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--json", "--operator", "s.op"];
            let mut host = bench.start(&run, Stdio::null(), "told.txt");
            let read = || std::fs::read_to_string(bench.path("told.txt")).unwrap_or_default();
            let begun = Instant::now();
            while !read().contains(told) {
                assert!(begun.elapsed() < Duration::from_secs(60), "{case}: {}", read());
                thread::sleep(Duration::from_millis(2));
            }
            thread::sleep(Duration::from_millis(delay_ms / 4));
            match cause {
                "kill" => host.kill().expect("it is killed"),
                command => card.operate(command),
            }
            // The watchdog of a second, and the way to rest.
            thread::sleep(Duration::from_millis(800));
            let ended = host.wait().expect("it ends");
            assert!(cause == "kill" || ended.code() == Some(3), "{case}: {ended:?} {}", read());
            let _ = card.end();
            let trace = samples(&vcd);
            let last = trace.last().expect("a sample");
            let moves = |pair: &[Sample]| pair[0].counts != pair[1].counts || pair[0].layer != pair[1].layer;
            let stopped = trace.windows(2).rposition(moves).map_or(0, |at| trace[at + 1].at_us);
            let alarm_us = trace.iter().find(|sample| sample.alarm != 0).expect("an alarm").at_us;
            assert!(last.at_rest && stopped <= alarm_us + 500_000, "{case}: moves at {stopped}, alarm at {alarm_us}");
            let lost = trace.windows(2).rposition(|pair| pair[0].is_on("spindle") && !pair[1].is_on("spindle"));
            assert!(trace[lost.expect("it was on") + 1..].iter().all(|sample| !sample.is_on("spindle")), "{case}");
            assert!(last.alarm != 0, "{case}");
        }
    }
}
