//! Offsets and tool data persist after the command that set them, and a job is resumed with those that it began with.

use std::fs;
use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
use std::path::PathBuf;

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::served::ServedCard;
use retrace_tests::terminal::Terminal;
use serde_json::Value;

const MILL: &str = "[card]\nwatchdog_ms = 2000\n";
const PART: &str = "G21 G90 G94 G54 G61 F3000\nG1 X10\nG1 X20\nG1 X20 Y5\nM2\n";

fn report(result: &CommandOutput) -> Value {
    let last = result.out.lines().last().unwrap_or_default();
    serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}: {}\n{}", result.out, result.err))
}

fn counts(result: &CommandOutput) -> [i64; 3] {
    let report = report(result);
    ["x", "y", "z"].map(|axis| report["position_counts"][axis].as_i64().unwrap_or_else(|| panic!("counts in {report}")))
}

/// The machine's own tables in the state folder.
fn own_tables(bench: &Bench) -> Vec<PathBuf> {
    let folder = fs::read_dir(bench.path("state/retrace/machines"));
    folder.into_iter().flatten().map(|entry| entry.expect("an entry").path()).collect()
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.file("mill.toml", MILL);
    bench.file("part.ngc", PART);
    bench
}

#[test]
fn what_is_set_at_the_screen_is_there_after_quitting() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    let state = bench.path("state").display().to_string();
    let [machine, part] = ["mill.toml", "part.ngc"].map(|name| bench.path(name).display().to_string());
    let screen = |keys: &[(&str, &str)]| {
        let arguments = ["run", &part, "--tui", "--card", &card.port, "--machine", &machine];
        let mut terminal = Terminal::with(&arguments, 100, 30, &[("XDG_STATE_HOME", &state)]);
        terminal.wait_for_text("READY");
        for (keys, shown) in keys {
            terminal.keys(keys);
            terminal.wait_for_state("READY", shown);
        }
        terminal.keys("q");
        terminal.wait_for_end();
    };
    screen(&[
        ("mG0 X5 Y2\r", "Y       2.000       2.000"),
        ("z\r", "X       5.000       0.000"),
        ("mG92 Z-3\r", "Z       0.000      -3.000"),
        ("mT4 M6 G10 L1 P4 Z12.5\r", "coolant off · T4"),
    ]);
    // The next screen begins with it, and so does a run without one, which reports the file.
    screen(&[("mG0 X1\r", "X       6.000       1.000")]);
    bench.file("tool.ngc", "G21 G90 G94 G61 F3000\nT4 M6\nG43 H4\nG1 X10 Z10\nM2\n");
    let result = bench.retrace(["run", "tool.ngc", "--card", &card.port, "--machine", "mill.toml", "--json"]);
    assert_eq!((result.code, counts(&result)), (Some(0), [15_000, 2_000, 25_500]), "{}\n{}", result.out, result.err);
    let file = report(&result)["parameter_file"].as_str().expect("a file").to_owned();
    assert!(file.starts_with(&state) && own_tables(&bench).contains(&PathBuf::from(file)), "{:?}", own_tables(&bench));
    for table in own_tables(&bench) {
        assert_eq!(fs::metadata(&table).expect("there").mode() & 0o777, 0o600);
    }
    // `--params` replaces it; nothing but a run on this machine uses it.
    bench.file("other.var", "5221\t100\n");
    let result = bench.retrace([
        "run",
        "part.ngc",
        "--card",
        &card.port,
        "--machine",
        "mill.toml",
        "--json",
        "--params",
        "other.var",
    ]);
    assert_eq!(counts(&result), [120_000, 5_000, 25_500]);
    let result = bench.retrace(["run", "part.ngc", "--json"]);
    assert_eq!((counts(&result), &report(&result)["parameter_file"]), ([20_000, 5_000, 0], &Value::Null));
    let canon = bench.retrace(["canon", "part.ngc"]);
    assert!(!canon.out.contains("5.0000, 2.0000"), "{}", canon.out);
}

#[test]
fn a_job_is_resumed_with_the_offsets_that_it_began_with_and_nothing_that_was_set_since_is_lost() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    let on_card = ["--card", card.port.as_str(), "--machine", "mill.toml", "--json"];
    let by_hand = |block: &str| {
        let result = bench.retrace(["mdi", block].iter().chain(&on_card));
        assert_eq!(result.code, Some(0), "{}", result.err);
    };
    by_hand("G10 L2 P1 X5");
    bench.file("stop.op", "at line 3 stop\n");
    bench.file("changes.ngc", format!("G10 L2 P2 X77\n{PART}"));
    let run = ["run", "changes.ngc", "--operator", "stop.op"];
    assert_eq!(bench.retrace(run.iter().chain(&on_card)).code, Some(4));
    // A touch-off after the stop.
    by_hand("G10 L2 P1 X5.5 Z-1");
    let asked = bench.retrace(["resume"]);
    assert!(asked.code == Some(2) && asked.err.contains("E2215"), "{}", asked.err);
    assert!(asked.out.contains("G54 X: 5.0000 in the job, 5.5000 now"), "{}", asked.out);
    assert!(asked.out.contains("G54 Z: 0.0000 in the job, -1.0000 now"), "{}", asked.out);
    let result = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!((result.code, counts(&result)), (Some(0), [25_000, 5_000, 0]), "{}\n{}", result.out, result.err);
    let shown: Value = serde_json::from_str(result.out.lines().next().expect("a line")).expect("JSON");
    assert_eq!(shown["changed_tables"].as_array().map(Vec::len), Some(2), "{shown}");
    // Later changes persist, and so does what the program has set.
    let file = fs::read_to_string(report(&result)["parameter_file"].as_str().expect("a file")).expect("there");
    for line in ["5221\t5.500000", "5223\t-1.000000", "5241\t77.000000"] {
        assert!(file.contains(line), "{line}: {file}");
    }
}

#[test]
fn a_tool_that_was_changed_by_hand_is_the_jobs_tool_when_it_is_resumed() {
    let (bench, card) = (bench(), ServedCard::with(&[]));
    let state = bench.path("state").display().to_string();
    // G43 without H uses the tool in the spindle.
    bench.file("part.ngc", "G21 G90 G94 G61 F3000\nG43\nG1 X10\nG1 X20 F600\nG1 Z1\nM2\n");
    let [machine, part] = ["mill.toml", "part.ngc"].map(|name| bench.path(name).display().to_string());
    let arguments = ["run", &part, "--tui", "--card", &card.port, "--machine", &machine];
    let mut terminal = Terminal::with(&arguments, 100, 30, &[("XDG_STATE_HOME", &state)]);
    terminal.wait_for_text("READY");
    terminal.keys("mT2 M6 G10 L1 P2 Z7\r");
    terminal.wait_for_state("READY", "coolant off · T2");
    terminal.keys("c");
    terminal.wait_for_text("RUNNING");
    terminal.wait_until("block 4", |text| text.contains("> 4 ") || text.contains(">  4 ") || text.contains(">4 "));
    terminal.hang_up();
    assert_eq!(terminal.wait_for_end(), Some(4));
    let result = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!((result.code, counts(&result)), (Some(0), [20_000, 0, 8_000]), "{}\n{}", result.out, result.err);
}

#[test]
fn a_parameter_file_behind_a_link_is_written_there_and_keeps_its_mode() {
    let bench = bench();
    fs::create_dir(bench.path("shop")).expect("a folder");
    let real = bench.file("shop/mill.var", "5221\t1\n");
    fs::set_permissions(&real, fs::Permissions::from_mode(0o664)).expect("changed");
    symlink("shop/mill.var", bench.path("mill.var")).expect("a link");
    bench.file("sets.ngc", "G10 L2 P1 X3\nM2\n");
    let result = bench.retrace(["run", "sets.ngc", "--params", "mill.var"]);
    assert_eq!(result.code, Some(0), "{}", result.err);
    assert!(fs::symlink_metadata(bench.path("mill.var")).expect("there").is_symlink());
    assert_eq!(fs::metadata(&real).expect("there").mode() & 0o777, 0o664);
    assert!(fs::read_to_string(&real).expect("there").contains("5221\t3.0"), "written through the link");
    assert_eq!(fs::read_dir(bench.path("shop")).expect("a folder").count(), 1);
}
