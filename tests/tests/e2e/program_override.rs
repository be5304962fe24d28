//! M49 and M50 switch the operator's overrides off and on, by the command (SPN-7).

use std::process::Stdio;
use std::thread::sleep;
use std::time::{Duration, Instant};

use retrace_tests::command::{Bench, CommandOutput};
use retrace_tests::records::RATE_ONE;
use retrace_tests::run::Run;
use retrace_tests::served::ServedCard;
use serde_json::Value;

/// Lines 4 … 6 are run at 100 %.
const PROGRAM: &str = "G21 G90 G64 P0.05 F1200\nG1 X20\nM49\nG1 X30 Y5\nX20 Y10\nG0 X10\nM48\nG1 X0 Y0\nM2\n";

fn run(program: &str, script: &str) -> (Bench, Run) {
    let bench = Bench::new();
    let (program, script) = (bench.file("part.ngc", program), bench.file("hand.op", script));
    let run = Run::of(&bench, &program, &["--operator", &script.to_string_lossy()]);
    (bench, run)
}

fn switches<'a>(events: impl Iterator<Item = &'a Value>) -> Vec<bool> {
    let switched = events.filter(|event| event["event"] == "feed_override_switched");
    switched.map(|event| event["on"] == true).collect()
}

#[test]
fn a_program_runs_at_100_percent_where_it_switches_the_overrides_off() {
    let script = "at 0s override 40%\nat 0s rapid override 50%\nat line 8 reverse 60%\nafter 4s leave\n";
    let (bench, run) = run(PROGRAM, script);
    run.assert_exact_and_legal();
    assert_eq!(switches(run.events.iter()), [false, true, false, true, false, true]);
    let mut at_one = 0;
    for row in run.records.rows.iter().filter(|row| row.rate_nano > 0) {
        let is_off = (4..=6).contains(&row.line);
        assert!(if is_off { row.rate_nano == RATE_ONE } else { row.rate_nano * 10 <= RATE_ONE * 5 }, "{row:?}");
        at_one += u32::from(is_off);
    }
    assert!(at_one > 2000, "twice: {at_one}");
    // At 100 % the time is what the check predicts.
    let [check, whole] = ["check", "run"].map(|command| bench.retrace([command, "part.ngc", "--json"]));
    let [check, whole] = [check, whole].map(|result| last(&result.out));
    for key in ["motion_s", "switch_s"] {
        assert_eq!(check[key], whole[key], "{key}");
    }
}

fn last(out: &str) -> Value {
    serde_json::from_str(out.lines().last().unwrap_or_default()).unwrap_or_default()
}

/// A program that is begun where it has switched the overrides off runs on so; the way to there has the operator's.
#[test]
fn a_start_in_the_middle_has_the_overrides_of_its_place() {
    let bench = Bench::new();
    let (program, script) = (bench.file("part.ngc", PROGRAM), bench.file("hand.op", "at 0s rapid override 40%\n"));
    let run = Run::of(&bench, &program, &["--start-line", "5", "--operator", &script.to_string_lossy()]);
    run.assert_exact_and_legal();
    assert_eq!(switches(run.events.iter()), [false, true]);
    let begins = run.of_kind("feed_override_switched").next().and_then(|event| event["record"].as_u64());
    let begins = begins.expect("a place");
    let (way, cut): (Vec<_>, Vec<_>) = run.records.rows.iter().partition(|row| row.record < begins);
    assert!(way.iter().all(|row| row.rate_nano * 5 <= RATE_ONE * 2) && way.len() > 500, "{}", way.len());
    let off = cut.iter().filter(|row| matches!(row.line, 5 | 6) && row.rate_nano != 0 && row.record != begins);
    assert!(off.clone().all(|row| row.rate_nano == RATE_ONE) && off.count() > 500);
}

/// In each of two holes, on the way in and on the way out, and nowhere else.
#[test]
fn a_floating_tap_is_fed_as_programmed_at_any_override() {
    let program = "G21 G90\nS600 M3\nG0 Z5\nG84 X10 Z-8 R2 F600\nX20\nG80\nG0 X0\nM5\nM2\n";
    let (_bench, tapped) = run(program, "at 0s override 50%\nat 0s rapid override 50%\n");
    tapped.assert_exact_and_legal();
    assert_eq!(switches(tapped.events.iter()), [false, true, false, true]);
    let feeds = tapped.records.rows.iter().filter(|row| row.increments[2].abs() == 10);
    assert!(feeds.clone().count() > 3500, "10 mm/s, 4 times 10 mm: {}", feeds.count());
    let rapid = tapped.records.rows.iter().filter(|row| row.increments[0] != 0).map(|row| row.rate_nano).max();
    assert_eq!(rapid, Some(RATE_ONE / 2));
}

/// A host that is killed where the overrides are off: the job that is resumed is planned again up to there, and goes on
/// at 100 %.
#[test]
fn a_killed_job_is_resumed_with_the_overrides_off() {
    let (bench, card) = (Bench::new(), ServedCard::with(&[]));
    let program = "G21 G90 F600\nG1 X3\nM49\nG1 X33\nM48\nG1 X36\nM2\n";
    bench.file("part.ngc", program);
    bench.file("m.toml", "[card]\nwatchdog_ms = 2000\n");
    bench.file("hand.op", "at 0s override 40%\n");
    let mut child = bench.start(
        &["run", "part.ngc", "--card", &card.port, "--machine", "m.toml", "--operator", "hand.op", "--json"],
        Stdio::null(),
        "killed.txt",
    );
    let begun = Instant::now();
    while !std::fs::read_to_string(bench.path("killed.txt")).unwrap_or_default().contains("feed_override_switched") {
        assert!(begun.elapsed() < Duration::from_secs(50), "it comes to the switch");
        sleep(Duration::from_millis(1));
    }
    sleep(Duration::from_millis(800));
    child.kill().expect("it is killed");
    child.wait().expect("it ends");
    let resumed: CommandOutput =
        bench.retrace(["resume", "--yes", "--operator", "hand.op", "--json", "--records", "r.csv"]);
    assert_eq!(resumed.code, Some(0), "{}{}", resumed.out, resumed.err);
    let events: Vec<Value> = resumed.out.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    assert_eq!(switches(events.iter()), [false, true], "{}", resumed.out);
    let report = last(&resumed.out);
    assert_eq!((&report["outcome"], &report["position_counts"]["x"]), (&"completed".into(), &36_000.into()));
    assert_eq!((&report["limit_violations"], &report["underruns"]), (&0.into(), &0.into()), "{report}");
}
