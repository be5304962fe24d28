//! A tool that is changed in a pause: the return, the path and everything behind it use the new length, until the
//! program sets another one.

use std::fs;
use std::time::Duration;

use retrace_tests::command::Bench;
use retrace_tests::page_client::{Page, PageServer};
use retrace_tests::records::Records;
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;
use serde_json::Value;

/// Two tools of 10 and 20 mm.
const TOOLS: &str = "T1 P1 Z10 D2 ;first\nT2 P2 Z20 D2 ;second\n";
/// A square with tool 1; line 7 takes five seconds.
const SQUARE: &str = "G21 G90 G17 G61.1\nT1 M6 G43 H1\nG0 Z5\nS1000 M3\nG0 X10 Y10\nG1 Z-2 F600\nG1 X60\nG1 Y40\nG1 \
    X10\nG0 Z5\nM5\nM2\n";

fn pause(length: &str) -> String {
    format!(
        "at line 7 override 100%\nafter 1s pause\nafter 0s spindle stop\nafter 0s jog z 30\nafter 0s {length}\nafter \
            0s spindle start\n\
         after 0s online\nafter 0s cycle start\n"
    )
}

fn run_on(program: &str, script: &str, is_low: bool) -> Run {
    let bench = Bench::new();
    let (program, script) = (bench.file("part.ngc", program), bench.file("shift.op", script));
    let tools = bench.file("tools.tbl", TOOLS);
    let machine = bench.file("machine.toml", LOW);
    let (script, tools, machine) = (script.to_string_lossy(), tools.to_string_lossy(), machine.to_string_lossy());
    let mut arguments = vec!["--operator", &*script, "--tools", &*tools];
    if is_low {
        arguments.extend(["--machine", &*machine]);
    }
    Run::of(&bench, &program, &arguments)
}

fn run(program: &str, script: &str) -> (Run, Records) {
    let run = run_on(program, script, false);
    let records = run.records.clone();
    (run, records)
}

/// Position of the machine at the end of each row, and the line of the row.
fn places(records: &Records) -> Vec<(u64, [i64; 3])> {
    let mut at = [0; 3];
    let row = |row: &retrace_tests::records::Row| {
        (0..3).for_each(|axis| at[axis] += row.increments[axis]);
        (row.line, at)
    };
    records.rows.iter().map(row).collect()
}

fn end_of(records: &Records, line: u64) -> [i64; 3] {
    let places = places(records);
    places.iter().rev().find(|(of, _)| *of == line).expect("the line was executed").1
}

fn refusals(run: &Run) -> Vec<String> {
    run.of_kind("command_rejected").map(|event| event["reason"].as_str().unwrap_or_default().to_owned()).collect()
}

#[test]
fn the_way_back_and_the_path_go_by_the_new_length_backward_too() {
    let script =
        pause("tool length 12.5") + "at line 8 override 100%\nafter 1s hold\nafter 1s reverse 100%\nafter 5s leave\n";
    let (run, records) = run(SQUARE, &script);
    assert_eq!((run.output.code, refusals(&run)), (Some(0), vec![]), "{}\n{}", run.output.err, run.output.out);
    let entered = run.of_kind("tool_length").next().expect("it is told");
    assert_eq!(
        (&entered["by_mm"], &entered["by_counts"], &entered["length_mm"]),
        (&2.5.into(), &2500.into(), &12.5.into())
    );
    assert_eq!(run.counts(), [10_000, 40_000, 17_500], "{}", run.report);
    assert_eq!(run.report["commanded_mm"]["z"], 17.5, "{}", run.report);
    // in the cut before it, and behind it: the tip at −2 with either tool
    let in_cut: Vec<i64> = places(&records).iter().filter(|(line, _)| *line == 8).map(|(_, at)| at[2]).collect();
    assert!(in_cut.len() > 100 && in_cut.iter().all(|&z| z == 10_500), "{:?}", in_cut.first());
    let before = places(&records).iter().find(|(line, at)| *line == 7 && at[0] > 15_000).expect("the cut").1;
    assert_eq!(before[2], 8_000);
    assert!(run.number("retrace_s") > 2.0 && run.number("limit_violations") == 0.0, "{}", run.report);
}

#[test]
fn machine_coordinates_are_those_of_the_machine_and_another_offset_ends_the_length() {
    let program = SQUARE.replace(
        "G0 Z5\nM5\nM2\n",
        "G53 G0 Z0\nG0 X0\nG0 X5 Z5\nG1 Z-1\nG53 G0 X1\nG1 Z-2\nG43 H1\nG18 G2 X3 Z-2 I1 K0\nT2 M6 G43 H2\nG0 X7\nG28 \
            X0\nG0 Z5\nM5\nM2\n",
    );
    let (run, records) = run(&program, &pause("tool length 12.5"));
    assert_eq!((run.output.code, refusals(&run)), (Some(0), vec![]), "{}\n{}", run.output.err, run.output.out);
    let z = |line| end_of(&records, line)[2];
    assert_eq!((z(9), z(10), z(11), z(12), z(13)), (10_500, 0, 0, 17_500, 11_500), "{}", run.output.out);
    // an axis that is not moved does not change, and the same offset again changes nothing
    assert_eq!((z(14), z(15), z(17)), (11_500, 10_500, 10_500));
    let lowest = places(&records).iter().filter(|(line, _)| *line == 17).map(|(_, at)| at[2]).min();
    assert_eq!(lowest, Some(9_500), "an arc in the tool axis");
    // another tool and another offset
    assert_eq!((z(19), z(20), z(21)), (10_500, 10_500, 25_000));
    assert_eq!(run.counts()[2], 25_000);
    assert_eq!((run.number("limit_violations"), &run.report["commanded_mm"]["z"]), (0.0, &25.0.into()));
}

/// Many programs call the same tool and offset again before each operation: the tool in the spindle is still the new
/// one.
#[test]
fn the_same_tool_and_offset_again_have_the_new_length() {
    let again = "G53 G0 Z0\nG49\nG0 X0\nT1 M6\nG43 H1\nG0 Z5\nG49\nG0 Z1\nG43 H1\nG0 Z3\nM5\nM2\n";
    let (run, records) = run(&SQUARE.replace("G0 Z5\nM5\nM2\n", again), &pause("tool length 12.5"));
    assert_eq!((run.output.code, refusals(&run)), (Some(0), vec![]), "{}\n{}", run.output.err, run.output.out);
    let z = |line| end_of(&records, line)[2];
    assert_eq!((z(10), z(12), z(15), z(17), z(19)), (0, 0, 17_500, 1_000, 15_500));
    // on a straight line, too: the path is at rest where the offset changes
    let (run, _) = self::run(&SQUARE.replace("G0 Z5\nM5", "G49\nG43 H1\nG0 Z5\nM5"), &pause("tool length 12.5"));
    assert_eq!((run.output.code, run.counts()[2]), (Some(0), 17_500), "{}", run.output.err);
}

#[test]
fn where_machine_coordinates_are_planned_already_it_is_refused() {
    let program = SQUARE.replace("G1 Y40\n", "G53 G0 Z0\nG1 Y40\n");
    let script = "at line 7 override 100%\nafter 4.7s pause\nafter 0s spindle stop\nafter 0s tool length 12.5\nafter \
        0s spindle start\n\
        after 0s online\nafter 0s cycle start\n";
    let (run, records) = run(&program, script);
    assert_eq!(run.output.code, Some(0), "{}\n{}", run.output.err, run.output.out);
    let why = refusals(&run);
    assert!(why.len() == 1 && why[0].contains("machine coordinates (G53, G28, G30)"), "{why:?}");
    assert_eq!((run.counts()[2], end_of(&records, 8)[2]), (15_000, 0));
    // behind them it can be entered
    let (run, _) = self::run(&program, &pause("tool length 12.5").replace("line 7", "line 9"));
    assert_eq!((run.output.code, run.counts()[2], refusals(&run).len()), (Some(0), 17_500, 0), "{}", run.output.out);
}

/// The whole move is to machine coordinates, also where S changes along it.
#[test]
fn within_a_move_to_machine_coordinates_it_is_refused_under_g96_too() {
    for mode in ["S1000", "G96 D3000 S100"] {
        let program = SQUARE.replace("S1000", mode).replace("G1 X60\n", "G53 G1 X60\n");
        let (run, _) = run(&program, &pause("tool length 12.5"));
        let why = refusals(&run);
        assert!(why.len() == 1 && why[0].contains("machine coordinates (G53, G28, G30)"), "{mode}: {why:?}");
        assert_eq!((run.output.code, run.counts()[2]), (Some(0), 15_000), "{}\n{}", run.output.err, run.output.out);
    }
}

/// Z ends at 20 mm.
const LOW: &str = "[[axis]]\nname = \"x\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = \
    100\nmax_acceleration_mm_per_s2 = 1000\n\
    max_jerk_mm_per_s3 = 20000\ntravel_mm = [-100, 100]\n[[axis]]\nname = \"y\"\npulses_per_mm = \
    1000\nmax_velocity_mm_per_s = 100\n\
    max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-100, 100]\n[[axis]]\nname = \
    \"z\"\npulses_per_mm = 1000\n\
    max_velocity_mm_per_s = 100\nmax_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-100, \
    20]\n";

#[test]
fn no_move_leaves_the_soft_limits_by_it() {
    let low = |script: &str| run_on(SQUARE, script, true);
    // at once: the cut itself would
    let run = low(&pause("tool length 40").replace("jog z 30", "jog z 5"));
    assert_eq!((run.output.code, run.counts()[2]), (Some(0), 15_000), "{}\n{}", run.output.err, run.output.out);
    assert!(refusals(&run)[0].contains("with this tool axis Z would go beyond its soft limit"), "{:?}", refusals(&run));
    // the rest is in the ring already: the way up would
    let script = pause("tool length 16").replace("jog z 30", "jog z 5").replace("after 1s pause", "after 4.85s pause");
    let run = run_on(&SQUARE.replace("G1 Y40\nG1 X10\n", ""), &script, true);
    assert_eq!((run.output.code, run.counts()[2]), (Some(0), 15_000), "{}\n{}", run.output.err, run.output.out);
    assert!(refusals(&run)[0].contains("with this tool axis Z would go beyond its soft limit"), "{:?}", refusals(&run));
    // later: the way up behind the cut would, and ends the program before it
    let run = low(&pause("tool length 16").replace("jog z 30", "jog z 5"));
    assert_eq!((run.output.code, refusals(&run).len()), (Some(1), 0), "{}\n{}", run.output.err, run.output.out);
    assert!(run.output.err.contains("E4304") && run.output.err.contains("21.000 mm"), "{}", run.output.err);
    assert_eq!(run.counts(), [10_000, 40_000, 14_000]);
    // behind it: the history ends where it would
    let script = pause("tool length 15.5").replace("jog z 30", "jog z 5")
        + "at line 8 override 100%\nafter 1s reverse 100%\nafter 60s leave\n";
    let run = low(&script);
    assert!(
        run.output.out.contains("the soft limit with the new tool length"),
        "{}\n{}",
        run.output.err,
        run.output.out
    );
}

#[test]
fn without_an_offset_only_a_difference_can_be_entered_and_the_spindle_stands_for_it() {
    let bare = SQUARE.replace(" G43 H1", "");
    let (run, _) = run(&bare, &pause("tool length 12.5"));
    assert_eq!((run.output.code, run.counts()[2]), (Some(0), 5_000), "{}", run.output.err);
    assert!(refusals(&run)[0].contains("no tool length offset (G43) is in force"), "{:?}", refusals(&run));
    let (run, _) = self::run(&bare, &pause("tool length by -0.75"));
    assert_eq!((run.output.code, run.counts()[2], refusals(&run).len()), (Some(0), 4_250, 0), "{}", run.output.err);
    // twice: they add up
    let twice = pause("tool length 12.5\nafter 0s tool length by 0.25\nafter 0s tool length 11");
    let (run, _) = self::run(SQUARE, &twice);
    assert_eq!((run.output.code, run.counts()[2], refusals(&run).len()), (Some(0), 16_000, 0), "{}", run.output.err);
    let turning = pause("jog z 1").replace("spindle stop", "tool length 12.5\nafter 0s spindle stop");
    let (run, _) = self::run(SQUARE, &turning);
    assert_eq!((run.output.code, run.counts()[2]), (Some(0), 15_000), "{}", run.output.err);
    assert!(refusals(&run)[0].contains("spindle stop comes first"), "{:?}", refusals(&run));
    let (run, _) = self::run(SQUARE, "at 2s tool length 12.5\n");
    assert!(refusals(&run)[0].contains("pause comes first"), "{:?}", refusals(&run));
}

#[test]
fn a_job_with_a_new_tool_length_is_resumed_with_it() {
    let (bench, card) = (Bench::new(), ServedCard::with(&[]));
    bench.file("part.ngc", SQUARE.replace("F600", "F3000").replace("M5\n", "G53 G0 Z0\nG0 X11\nG0 Z4\nM5\n"));
    bench.file("tools.tbl", TOOLS);
    bench.file("machine.toml", "[card]\nwatchdog_ms = 2000\n");
    let report =
        |out: &str| -> Value { serde_json::from_str(out.lines().last().unwrap_or_default()).expect("a report") };
    let z = |out: &str| report(out)["position_counts"]["z"].as_i64();
    // stopped in the pause, with the tool away, and in the cut behind it
    let scripts =
        ["after 2s stop\n", "after 0s spindle start\nafter 0s online\nafter 0s cycle start\nat line 8 stop\n"];
    for (ends, stands) in scripts.into_iter().zip([None, Some(10_500)]) {
        let to_zero = bench.retrace(["mdi", "G0 X0 Y0 Z0", "--card", &card.port, "--machine", "machine.toml"]);
        assert_eq!(to_zero.code, Some(0), "{}", to_zero.err);
        let begin = "at line 7 override 100%\nafter 0.3s pause\nafter 0s spindle stop\nafter 0s jog z 30\nafter 0s \
            tool length 12.5\n";
        bench.file("shift.op", format!("{begin}{ends}"));
        let run =
            ["run", "part.ngc", "--card", &card.port, "--machine", "machine.toml", "--tools", "tools.tbl", "--json"];
        let result = bench.retrace(run.iter().chain(&["--operator", "shift.op"]));
        assert_eq!(result.code, Some(4), "{}\n{}", result.out, result.err);
        assert!(stands.is_none() || z(&result.out) == stands, "{}", result.out);
        let shown = bench.retrace(["resume"]);
        assert!(shown.out.contains("new tool   length entered in a pause, +2.500 mm"), "{}\n{}", shown.out, shown.err);
        // the tool table does not contain it
        let from_line = bench.retrace(["resume", "--from-line", "3"]);
        assert!(from_line.code == Some(2) && from_line.err.contains("E2218"), "{}", from_line.err);
        let result = bench.retrace(["resume", "--yes", "--json", "--records", "records.csv"]);
        assert_eq!((result.code, z(&result.out)), (Some(0), Some(16_500)), "{}\n{}", result.out, result.err);
        let text = fs::read_to_string(bench.path("records.csv")).expect("records");
        let records = Records::parse(&text).expect("records");
        let mut at = if stands.is_some() { 10_500 } else { 38_000 };
        let depths: Vec<i64> = records
            .rows
            .iter()
            .map(|row| {
                at += row.increments[2];
                at
            })
            .zip(&records.rows)
            .filter(|(_, row)| row.line == 8)
            .map(|(z, _)| z)
            .collect();
        assert!(depths.len() > 100 && depths.iter().all(|&z| z == 10_500), "{:?}", depths.first());
    }
}

#[test]
fn a_resumed_job_goes_no_further_back_than_the_soft_limits() {
    let bench = Bench::new();
    bench.file("part.ngc", SQUARE);
    bench.file("tools.tbl", TOOLS);
    bench.file("machine.toml", LOW);
    let pause = pause("tool length 15.5").replace("jog z 30", "jog z 5");
    bench.file("stop.op", format!("{pause}at line 8 stop\n"));
    let run =
        ["run", "part.ngc", "--machine", "machine.toml", "--tools", "tools.tbl", "--operator", "stop.op", "--json"];
    let result = bench.retrace(run);
    assert_eq!(result.code, Some(4), "{}\n{}", result.out, result.err);
    bench.file("back.op", "after 0.5s reverse 100%\nafter 60s leave\n");
    let result = bench.retrace(["resume", "--yes", "--json", "--operator", "back.op", "--records", "records.csv"]);
    assert!(result.out.contains("the soft limit with the new tool length"), "{}\n{}", result.out, result.err);
    let text = fs::read_to_string(bench.path("records.csv")).expect("records");
    let records = Records::parse(&text).expect("records");
    let mut z = 13_500;
    let highest = records.rows.iter().map(|row| {
        z += row.increments[2];
        z
    });
    assert!(highest.max().is_some_and(|z| (19_900..=20_000).contains(&z)), "{}", result.err);
}

/// Without a probe: the operator jogs the tip of the new tool down to the work and says which Z that is (PRB-21). The
/// path from the breakpoint on is shifted by as much as the new tool is longer; nothing moves by the entry.
#[test]
fn a_tool_is_touched_off_by_eye_in_a_pause() {
    let bench = Bench::new();
    let tools = bench.file("tools.tbl", TOOLS).display().to_string();
    let (_server, mut page) = PageServer::in_control(&bench, SQUARE, &["--tools", &tools]);
    let done = |answer: Value| assert_eq!(answer["t"], "done", "{answer}");
    done(page.order("cycle start"));
    page.wait_until("the long cut", |page| page.machine_mm(0) > 15.0);
    // Tool 1 is 10 mm long: at Z-2 the machine is at Z8.
    let cutting_mm = page.machine_mm(2);
    done(page.order("pause"));
    page.wait_until("the pause", |page| page.last("state")["word"] == "PAUSED" && page.last("live")["at_rest"] == true);
    done(page.order("spindle stop"));
    page.wait_until("the spindle", |page| page.last("state")["pause"]["stopped"] == true);
    done(page.order("jog z 3.5"));
    page.wait_until("up", |page| {
        page.last("live")["at_rest"] == true && (page.machine_mm(2) - cutting_mm - 3.5).abs() < 0.01
    });
    let work = |page: &Page| page.last("live")["work"][2].as_f64().expect("a position");
    assert!((work(&page) - 1.5).abs() < 0.01, "with the old tool: {}", work(&page));
    // The tip of the new one touches the surface at Z0: it is 1.5 mm longer.
    done(page.order("tool length at 0"));
    page.wait_until("the length", |page| work(page).abs() < 0.01);
    assert!((page.machine_mm(2) - cutting_mm - 3.5).abs() < 0.01, "nothing has moved");
    for order in ["spindle start", "online", "cycle start"] {
        done(page.order_when_free(order));
        page.listen(Duration::from_millis(300));
    }
    page.wait_until("the cut again", |page| page.last("state")["word"] == "RUNNING" && page.machine_mm(0) > 40.0);
    assert!((page.machine_mm(2) - cutting_mm - 1.5).abs() < 0.01, "{} {cutting_mm}", page.machine_mm(2));
    page.wait_for_word("ENDED");
}
