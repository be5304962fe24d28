//! An interrupted job is resumed: the counts at its end are those of an uninterrupted run, or it is refused with the
//! reason.

use std::fs;
use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::pins;
use retrace_tests::served::ServedCard;
use serde_json::Value;

/// Straight runs, blends, a loop in a subprogram, switching with a duration.
const PROGRAM: &str = "G21 G90 G94 F3000\nG64 P0.1\nM3 S1000\nG1 X20\nX25 Y5\nX5 Y9\nO100 sub\nO101 repeat \
    [4]\nG91\nG1 X3 Y1\nX-3 Y2 Z-0.5\nG90\n\
    O101 endrepeat\nO100 endsub\nO100 call\nM8\nG4 P0.3\nG1 X30 Y-4\nG3 X40 Y6 I0 J10\nO100 call\nM9\nG1 X0 Y0 \
    Z0\nX11.111 Y7.007 Z-3.3\nM5\nM2\n";
/// Its end, in pulses.
const END: [i64; 3] = [11_111, 7_007, -3_300];
const PATIENT: &str = "[card]\nwatchdog_ms = 2000\n";

fn report(result: &CommandOutput) -> Value {
    let last = result.out.lines().last().unwrap_or_default();
    serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}: {}\n{}", result.out, result.err))
}

fn counts(report: &Value) -> [i64; 3] {
    ["x", "y", "z"].map(|axis| report["position_counts"][axis].as_i64().unwrap_or_else(|| panic!("counts in {report}")))
}

fn assert_completed(result: &CommandOutput) {
    assert_eq!(result.code, Some(0), "{}\n{}", result.out, result.err);
    let report = report(result);
    assert_eq!((report["outcome"].as_str(), counts(&report)), (Some("completed"), END));
    assert_eq!(report["limit_violations"], 0);
}

#[track_caller]
fn assert_refused(result: &CommandOutput, number: &str) {
    assert!(
        result.code.is_some_and(|code| code != 0) && result.err.contains(number),
        "{number}: {}\n{}",
        result.out,
        result.err
    );
    assert!(result.err.contains("help:"), "{}", result.err);
}

/// Runs the program on the card and kills the host after so many control periods of motion are likely to have passed.
fn killed(bench: &Bench, arguments: &[&str], input: Stdio, after: Duration) {
    let mut child = bench.start(arguments, input, "killed.txt");
    let begun = Instant::now();
    while !fs::read_to_string(bench.path("killed.txt")).unwrap_or_default().contains("started") {
        assert!(begun.elapsed() < Duration::from_secs(50), "it begins");
        sleep(Duration::from_millis(1));
    }
    sleep(after);
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("patient.toml", PATIENT);
    bench
}

#[test]
fn a_simulated_job_that_was_stopped_goes_on_any_number_of_times() {
    let bench = bench();
    bench.file("stop.op", "at 0.9s stop\n");
    let result = bench.retrace(["run", "part.ngc", "--operator", "stop.op", "--json"]);
    assert_eq!(result.code, Some(4), "{}", result.err);
    assert!(result.err.contains("retrace resume "), "{}", result.err);
    for _ in 0..2 {
        let result = bench.retrace(["resume", "--yes", "--json", "--operator", "stop.op"]);
        assert_eq!(result.code, Some(4), "{}\n{}", result.out, result.err);
        assert!(result.out.contains("\"event\":\"resume\""), "{}", result.out);
    }
    // the history for reverse run reaches to the job's beginning
    bench.file("back.op", "at 0.2s hold\nafter 0.5s reverse 100%\nafter 8s leave\n");
    let result = bench.retrace(["resume", "--yes", "--json", "--operator", "back.op"]);
    assert_completed(&result);
    assert!(result.out.contains("history_start_reached"), "{}", result.out);
    let result = bench.retrace(["resume"]);
    assert_refused(&result, "E2209");
}

/// A job that was planned with `--plan fast` is resumed with the same plan; the default takes less time.
#[test]
fn a_job_is_resumed_with_the_plan_that_it_began_with() {
    let bench = Bench::new();
    let chord = |k: u32| {
        let (sin, cos) = (f64::from(k) * 0.05).sin_cos();
        format!("G1 X{:.3} Y{:.3}\n", 8.0 * cos - 8.0, 8.0 * sin)
    };
    bench.file("part.ngc", format!("G21 G90 F6000\nG64 P0.05\n{}M2\n", (1..=500).map(chord).collect::<String>()));
    let periods = |arguments: &[&str]| {
        let run = bench.retrace(["run", "part.ngc", "--no-journal", "--json"].iter().chain(arguments));
        assert_eq!(run.code, Some(0), "{}{}", run.out, run.err);
        (counts(&report(&run)), report(&run)["periods"].as_u64().expect("a number"))
    };
    let ((fast_end, fast), (end, best)) = (periods(&["--plan", "fast"]), periods(&[]));
    assert!(fast_end == end && 100 * best < 95 * fast, "{best} periods, {fast}");
    bench.file("fast.toml", "plan = \"fast\"\n");
    assert_eq!(periods(&["--machine", "fast.toml"]), (end, fast));
    assert_eq!(periods(&["--machine", "fast.toml", "--plan", "best"]), (end, best));
    // Killed on a served card, it is resumed as well.
    bench.file("patient.toml", PATIENT);
    let card = ServedCard::with(&["--speed", "5"]);
    let served = ["run", "part.ngc", "--plan", "fast", "--card", &card.port, "--machine", "patient.toml", "--json"];
    killed(&bench, &served, Stdio::null(), Duration::from_millis(300));
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    assert_eq!(counts(&report(&resumed)), end);
    let _ = card.end();
    bench.file("stop.op", "at 1s stop\n");
    let run = bench.retrace(["run", "part.ngc", "--plan", "fast", "--operator", "stop.op", "--json"]);
    assert_eq!(run.code, Some(4), "{}{}", run.out, run.err);
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    assert_eq!(counts(&report(&resumed)), end);
    let begun =
        report(&run)["motion_s"].as_f64().expect("seconds") + report(&resumed)["motion_s"].as_f64().expect("seconds");
    let whole = 1e-3 * fast as f64;
    assert!((whole..1.1 * whole).contains(&begun), "{begun} s in two parts, {fast} periods in one");
}

/// A stop does not wait for the end of a dwell; resumed, the job executes it whole.
#[test]
fn a_stop_ends_a_dwell_and_the_resumed_job_repeats_it() {
    let bench = Bench::new();
    bench.file("part.ngc", "G21 G90 F3000\nG1 X10\nM64 P3\nG4 P30\nG1 X20\nM65 P3\nM2\n");
    let machine = bench.file("jet.toml", format!("{PATIENT}[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\n"));
    bench.file("stop.op", "at 2s stop\n");
    let (vcd, machine) = (bench.path("pins.vcd"), machine.display().to_string());
    let card = ServedCard::with(&["--machine", &machine, "--vcd", &vcd.display().to_string(), "--speed", "5"]);
    let served = ["--card", &card.port, "--machine", "jet.toml"];
    for card in [&[][..], &served] {
        let run = ["run", "part.ngc", "--operator", "stop.op", "--json"];
        let stopped = bench.retrace(run.iter().chain(card));
        assert_eq!(stopped.code, Some(4), "{}{}", stopped.out, stopped.err);
        let stopped = report(&stopped);
        assert_eq!(stopped["position_counts"]["x"], 10_000);
        assert!(stopped["dwell_s"].as_f64().is_some_and(|seconds| seconds < 3.0), "{stopped}");
        let resumed = bench.retrace(["resume", "--yes", "--json"]);
        assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
        let resumed = report(&resumed);
        assert_eq!((&resumed["position_counts"]["x"], &resumed["dwell_s"]), (&20_000.into(), &30.0.into()));
    }
    let _ = card.end();
    // At the card: the jet is on up to the stop, and again for the whole dwell and its cut when the job is resumed.
    let trace = pins::samples(&vcd);
    let switched = trace.windows(2).filter(|pair| pair[0].is_on("out3") != pair[1].is_on("out3"));
    let times: Vec<f64> = switched.map(|pair| pair[1].at_us as f64 / 1e6).collect();
    assert_eq!(times.len(), 4, "{times:?}");
    let (first_s, second_s) = (times[1] - times[0], times[3] - times[2]);
    assert!(first_s < 2.5 && (30.0..31.5).contains(&second_s), "{times:?}");
}

#[test]
fn nobody_who_agrees_means_nothing_moves() {
    let bench = bench();
    bench.file("stop.op", "at 0.9s stop\n");
    let _ = bench.retrace(["run", "part.ngc", "--operator", "stop.op", "--json"]);
    let result = bench.retrace(["resume"]);
    assert_eq!(result.code, Some(2));
    assert_refused(&result, "E2215");
    assert!(result.out.contains("history") && result.out.contains("line"), "{}", result.out);
    // and the journal is unchanged
    assert_completed(&bench.retrace(["resume", "--yes", "--json"]));
}

#[test]
fn a_changed_program_is_refused() {
    let bench = bench();
    bench.file("stop.op", "at 0.9s stop\n");
    let _ = bench.retrace(["run", "part.ngc", "--operator", "stop.op", "--json"]);
    bench.file("part.ngc", PROGRAM.replace("X20", "X21"));
    assert_refused(&bench.retrace(["resume", "--yes"]), "E2210");
    bench.file("part.ngc", PROGRAM);
    assert_completed(&bench.retrace(["resume", "--yes", "--json"]));
}

#[test]
fn a_host_that_is_killed_leaves_a_job_that_goes_on_exactly() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "patient.toml", "--json"];
    // in the spindle's start, a straight run, a blend, the loop, the dwell
    for after in [30, 400, 700, 1200, 2300] {
        killed(&bench, &run, Stdio::null(), Duration::from_millis(after));
        assert_completed(&bench.retrace(["resume", "--yes", "--json"]));
    }
}

#[test]
fn a_job_is_killed_again_while_it_goes_back() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    bench.file("back.op", "at 0.8s hold\nafter 0.2s reverse 50%\n");
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "patient.toml", "--json", "--operator", "back.op"];
    killed(&bench, &run, Stdio::null(), Duration::from_millis(1500));
    killed(&bench, &["resume", "--yes", "--json"], Stdio::null(), Duration::from_millis(200));
    assert_completed(&bench.retrace(["resume", "--yes", "--json"]));
}

#[test]
fn a_stream_is_taken_up_from_what_was_kept_of_it_and_sent_again_where_that_is_not_all() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    let run = ["run", "-", "--card", &card.port, "--machine", "patient.toml", "--json"];
    let whole = fs::File::open(bench.path("part.ngc")).expect("a file");
    killed(&bench, &run, whole.into(), Duration::from_millis(700));
    assert_completed(&bench.retrace(["resume", "--yes", "--json"]));
    // half of it, and then no more data
    let mut child = bench.start(&run, Stdio::piped(), "half.txt");
    let mut pipe = child.stdin.take().expect("a pipe");
    std::io::Write::write_all(&mut pipe, &PROGRAM.as_bytes()[..PROGRAM.len() / 2]).expect("it is taken");
    sleep(Duration::from_millis(1500));
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    assert_refused(&bench.retrace(["resume", "--yes", "--json"]), "E2208");
    bench.file("other.ngc", PROGRAM.replace("X20", "X21"));
    assert_refused(&bench.retrace(["resume", "--yes", "--json", "--program", "other.ngc"]), "E2208");
    assert_completed(&bench.retrace(["resume", "--yes", "--json", "--program", "part.ngc"]));
}

#[test]
fn another_card_is_refused_and_a_machine_that_was_moved_goes_back_to_the_breakpoint() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    bench.file("away.ngc", "G21 G91 F1000\nG1 X1\nM2\n");
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "patient.toml", "--json"];
    killed(&bench, &run, Stdio::null(), Duration::from_millis(700));
    let id = bench.retrace(["jobs", "--json"]);
    let jobs: Value = serde_json::from_str(&id.out).expect("one JSON object");
    let id = jobs["jobs"][0]["id"].as_str().expect("a name").to_owned();
    assert_eq!(bench.retrace(["card", "clear", &card.port, "--machine", "patient.toml"]).code, Some(0));
    assert_eq!(card.run(&bench, "away.ngc").code, Some(0));
    let other = ServedCard::with(&[]);
    assert_refused(&bench.retrace(["resume", &id, "--yes", "--json", "--card", &other.port]), "E2213");
    let result = bench.retrace(["resume", &id]);
    assert!(result.code == Some(2) && result.out.contains("approach"), "{}\n{}", result.out, result.err);
    assert!(result.out.contains("note       the last one in the journal"), "{}", result.out);
    assert_completed(&bench.retrace(["resume", &id, "--yes", "--json"]));
}

/// A machine with a retract plane.
const RETRACTS: &str = "retract_mm = 10\n[card]\nwatchdog_ms = 2000\n";

/// Rows of a records file: increments of X, Y and Z.
fn rows(bench: &Bench) -> Vec<[i64; 3]> {
    let text = fs::read_to_string(bench.path("records.csv")).expect("records");
    let row = |line: &str| {
        let all: Vec<i64> = line.rsplit(',').take(3).map(|cell| cell.parse().expect("a count")).collect();
        [all[2], all[1], all[0]]
    };
    text.lines().skip(1).map(row).collect()
}

/// Checks that while X or Y moves before the tool has finally come down to `down`, Z is at `height`; all from these
/// counts on.
fn assert_safe_order(rows: &[[i64; 3]], from: [i64; 3], height: i64, start: [i64; 3]) {
    let (mut at, mut was_there) = (from, false);
    for row in rows {
        if at == start {
            was_there = true;
            break;
        }
        if row[0] != 0 || row[1] != 0 {
            assert_eq!((at[2], row[2]), (height, 0), "at {at:?}");
        }
        (0..3).for_each(|axis| at[axis] += row[axis]);
    }
    assert!(was_there, "it comes to {start:?}: {at:?}");
}

#[test]
fn a_tool_that_was_moved_away_in_a_pause_goes_back_in_the_safe_order() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    bench.file("mill.toml", RETRACTS);
    bench.file("away.op", "at line 6 pause\nafter 0.1s jog z 2\nafter 0s jog x 3\nafter 0s jog y -1\nafter 1s stop\n");
    let on_card = ["--card", &card.port, "--machine", "mill.toml", "--json", "--operator", "away.op"];
    let result = bench.retrace(["run", "part.ngc"].iter().chain(&on_card));
    assert_eq!(result.code, Some(4), "{}\n{}", result.out, result.err);
    let stands = counts(&report(&result));
    assert_eq!(stands[2], 2_000, "{}", result.out);
    let result = bench.retrace(["resume"]);
    assert!(
        result.code == Some(2) && result.out.contains("approach   Z to 10.000, then X to"),
        "{}\n{}",
        result.out,
        result.err
    );
    let result = bench.retrace(["resume", "--yes", "--json", "--records", "records.csv"]);
    assert_completed(&result);
    let shown: Value = serde_json::from_str(result.out.lines().next().expect("a line")).expect("JSON");
    let back: Vec<[i64; 3]> = serde_json::from_value(shown["return_path"].clone()).expect("counts");
    assert_eq!((back.len(), back[0], back[2][2]), (3, [stands[0], stands[1], 10_000], 0), "{shown}");
    assert_safe_order(&rows(&bench), stands, 10_000, back[2]);
}

#[test]
fn a_machine_that_was_jogged_after_its_host_was_killed_goes_back() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "patient.toml", "--json"];
    killed(&bench, &run, Stdio::null(), Duration::from_millis(1200));
    assert_eq!(bench.retrace(["card", "clear", &card.port, "--machine", "patient.toml"]).code, Some(0));
    for (axis, mm) in [("z", "4"), ("x", "-7.5")] {
        let result = bench.retrace(["jog", axis, mm, "--card", &card.port, "--machine", "patient.toml"]);
        assert_eq!(result.code, Some(0), "{}", result.err);
    }
    assert_completed(&bench.retrace(["resume", "--yes", "--json"]));
}

#[test]
fn a_stop_on_the_way_back_keeps_the_breakpoint() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    bench.file("mill.toml", RETRACTS);
    bench.file("away.op", "at line 6 pause\nafter 0.1s jog z 40\nafter 1s stop\n");
    let on_card = ["--card", &card.port, "--machine", "mill.toml", "--json", "--operator", "away.op"];
    assert_eq!(bench.retrace(["run", "part.ngc"].iter().chain(&on_card)).code, Some(4));
    // The host continues the return.
    let mut child = bench.start(&["resume", "--yes", "--json"], Stdio::null(), "killed.txt");
    while !fs::read_to_string(bench.path("killed.txt")).unwrap_or_default().contains("approach") {
        sleep(Duration::from_millis(1));
    }
    sleep(Duration::from_millis(100));
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    assert_completed(&bench.retrace(["resume", "--yes", "--json"]));
}

#[test]
fn after_a_restart_of_the_card_the_position_has_to_be_confirmed() {
    let bench = bench();
    bench.file("mill.toml", RETRACTS);
    let card = ServedCard::with(&[]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "mill.toml", "--json"];
    killed(&bench, &run, Stdio::null(), Duration::from_millis(1200));
    drop(card);
    let card = ServedCard::with(&[]);
    let resume = ["resume", "--yes", "--json", "--card", &card.port];
    let result = bench.retrace(resume);
    assert_refused(&result, "E2213");
    assert!(
        result.err.contains("--assume-position") && result.err.contains("X 0.000 Y 0.000 Z 0.000"),
        "{}",
        result.err
    );
    let result = bench.retrace(resume.iter().chain(&["--assume-position", "--records", "records.csv"]));
    assert_completed(&result);
    let shown: Value = serde_json::from_str(result.out.lines().next().expect("a line")).expect("JSON");
    let back: Vec<[i64; 3]> = serde_json::from_value(shown["return_path"].clone()).expect("counts");
    assert_safe_order(&rows(&bench), [0; 3], 10_000, *back.last().expect("moves"));
}

#[test]
fn a_program_that_begins_at_a_line_comes_to_its_start_in_the_safe_order() {
    let bench = Bench::new();
    bench.file("mill.toml", RETRACTS);
    bench.file("part.ngc", "G21 G90 F3000\nG1 X20 Y10\nZ-3\nX30\nM2\n");
    let run = ["run", "part.ngc", "--machine", "mill.toml", "--json", "--records", "records.csv", "--start-line", "4"];
    let result = bench.retrace(run);
    assert_eq!((result.code, counts(&report(&result))), (Some(0), [30_000, 10_000, -3_000]), "{}", result.err);
    assert_safe_order(&rows(&bench), [0; 3], 10_000, [20_000, 10_000, -3_000]);
    bench.file("stop.op", "at line 4 stop\n");
    let result = bench.retrace(["run", "part.ngc", "--machine", "mill.toml", "--json", "--operator", "stop.op"]);
    assert_eq!(result.code, Some(4), "{}", result.err);
    let result = bench.retrace(["resume", "--from-line", "4", "--yes", "--json", "--records", "records.csv"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert_safe_order(&rows(&bench), [0; 3], 10_000, [20_000, 10_000, -3_000]);
}

#[test]
fn after_a_restart_of_the_card_homing_is_enough_where_every_axis_has_a_switch() {
    let bench = bench();
    let axis = |name: &str, travel: &str, home: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 1000\nmax_velocity_mm_per_s = \
                100\nmax_acceleration_mm_per_s2 = 1000\n\
             max_jerk_mm_per_s3 = 20000\ntravel_mm = {travel}\nhome = {home}\n"
        )
    };
    let lower = "{ switch = \"lower\", position_mm = -12 }";
    let switch =
        |number: u32, axis: &str| format!("[[card.input]]\nnumber = {number}\nuse = \"home\"\naxis = \"{axis}\"\n");
    let machine = ["retract_mm = 10\n[card]\nwatchdog_ms = 2000\n".into()]
        .into_iter()
        .chain([axis("x", "[-10, 300]", lower), axis("y", "[-10, 300]", lower)])
        .chain([axis("z", "[-100, 20]", "{ switch = \"upper\", position_mm = 21 }")])
        .chain([switch(1, "x"), switch(2, "y"), switch(3, "z")])
        .collect::<String>();
    let path = bench.file("homed.toml", machine).display().to_string();
    let home = |card: &ServedCard| {
        let result = bench.retrace(["home", "--card", &card.port, "--machine", &path]);
        assert_eq!(result.code, Some(0), "{}\n{}", result.out, result.err);
    };
    let card = ServedCard::with(&["--machine", &path]);
    home(&card);
    let to_zero = bench.retrace(["mdi", "G0 X0 Y0 Z0", "--card", &card.port, "--machine", &path]);
    assert_eq!(to_zero.code, Some(0), "{}", to_zero.err);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", &path, "--json"];
    killed(&bench, &run, Stdio::null(), Duration::from_millis(1200));
    drop(card);
    let card = ServedCard::with(&["--machine", &path]);
    let resume = ["resume", "--yes", "--json", "--card", &card.port];
    let result = bench.retrace(resume);
    assert_refused(&result, "E2213");
    assert!(result.err.contains("retrace home"), "{}", result.err);
    home(&card);
    assert_completed(&bench.retrace(resume));
}

/// The card loses its power in the cut and is switched on again: all outputs are off, nothing moves until the operator
/// acts, and the job resumes only after he has confirmed a position, with the jet off during the return.
#[test]
fn after_a_power_loss_in_the_cut_the_jet_stays_off_and_nothing_moves_by_itself() {
    let bench = Bench::new();
    bench.file("part.ngc", "G21 G90 F1200\nG0 X10\nM64 P3\nG1 X60\nM65 P3\nG0 X0\nM2\n");
    let jet = "[[cutter]]\nname = \"jet\"\nkind = \"jet\"\nfire = 3\n";
    bench.file("jet.toml", format!("retract_mm = 10\n{jet}{PATIENT}"));
    let card = ServedCard::with(&[]);
    let run = ["run", "part.ngc", "--card", &card.port, "--machine", "jet.toml", "--json"];
    let mut host = bench.start(&run, Stdio::null(), "killed.txt");
    let begun = Instant::now();
    // M64 is complete: it cuts.
    while !fs::read_to_string(bench.path("killed.txt")).unwrap_or_default().contains("\"switched\"") {
        assert!(begun.elapsed() < Duration::from_secs(50), "it begins");
        sleep(Duration::from_millis(1));
    }
    sleep(Duration::from_millis(800));
    drop(card);
    let vcd = bench.path("again.vcd");
    let card = ServedCard::with(&["--vcd", &vcd.display().to_string()]);
    let ended = host.wait().expect("it ends");
    assert_eq!(ended.code(), Some(3), "the line is lost: {:?}", fs::read_to_string(bench.path("killed.txt")));
    let stands = || {
        let who = card.identify(&bench);
        assert_eq!((&who["at_rest"], &who["counts"][0], &who["place"]), (&true.into(), &0.into(), &0.into()), "{who}");
        assert_eq!(who["outputs_on"], Value::Array(Vec::new()), "{who}");
    };
    stands();
    let resume = ["resume", "--yes", "--json", "--card", &card.port];
    assert_refused(&bench.retrace(resume), "E2213");
    sleep(Duration::from_millis(1500));
    stands();
    let result = bench.retrace(resume.iter().chain(&["--assume-position"]));
    assert_eq!((result.code, report(&result)["outcome"].as_str()), (Some(0), Some("completed")), "{}", result.err);
    let _ = card.end();
    let samples = pins::samples(&vcd);
    let first_motion = samples.iter().find(|sample| sample.rate != 0.0).expect("it moves at last").at_us;
    assert!(first_motion > 1_500_000, "nothing moves before it is resumed: {first_motion} µs");
    let lit: Vec<_> = samples.iter().filter(|sample| sample.is_on("out3")).collect();
    let breakpoint = lit.first().expect("it is lit").place;
    // It is lit at the breakpoint, after the return, and from there on only along the cut.
    let cuts = |sample: &pins::Sample| sample.place == breakpoint || (4..=5).contains(&sample.line);
    assert!(lit.iter().all(|sample| sample.at_us > first_motion && sample.place >= breakpoint && cuts(sample)));
    let cut: Vec<_> = lit.iter().filter(|sample| sample.rate > 0.0).collect();
    assert!(cut.len() > 100, "the rest of the cut is cut: {}", cut.len());
}
