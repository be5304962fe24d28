//! The wear of the consumables of a cutter across jobs (CUT-62).
//!
//! Invariant: the state folder is that of the test.

use retrace_tests::command::{Bench, assert_contains};
use retrace_tests::page_client::PageServer;
use serde_json::Value;

/// Three contours of 60, 20 and 30 mm.
const PROGRAM: &str = "G21 G90 F1800\nG0 X10\nM3 S1\nG1 X70\nM5\nG0 X100 Y5\nM3\nG1 X120\nM5\n\
    G0 X10 Y20\nM3\nG1 Y50\nM5\nG0 X0 Y0\nM2\n";

fn machine() -> String {
    let axis = |name: &str| {
        format!(
            "[[axis]]\nname = \"{name}\"\npulses_per_mm = 200\nmax_velocity_mm_per_s = 100\n\
             max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 500]\n"
        )
    };
    let torch = "homed = true\n[[cutter]]\nname = \"torch\"\nkind = \"torch\"\nfire = 64\nok = { input = 5 }\n\
                 start = { start_s = 1.0, retry_s = 0.5, pierce_s = 0.4 }\n";
    format!("{torch}{}{}", axis("x"), axis("y"))
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.file("part.ngc", PROGRAM);
    bench.file("m.toml", machine());
    bench
}

/// Starts, failed starts, time lit and length cut of the torch, as the command shows them.
fn wear(bench: &Bench) -> Option<[f64; 4]> {
    let shown = bench.retrace(["consumables", "--machine", "m.toml", "--json"]);
    assert_eq!(shown.code, Some(0), "{}", shown.err);
    let value: Value = serde_json::from_str(&shown.out).expect("one JSON object");
    let set = value["consumables"].get(0)?.clone();
    assert_eq!(set["cutter"], "torch");
    Some(["starts", "failed_starts", "lit_s", "cut_m"].map(|key| set[key].as_f64().expect("a number")))
}

fn run(bench: &Bench, script: &str, faults: &str) -> (Option<i32>, Value) {
    bench.file("s.op", script);
    let run = bench.retrace([
        "run",
        "part.ngc",
        "--machine",
        "m.toml",
        "--json",
        "--operator",
        "s.op",
        "--source-faults",
        faults,
    ]);
    (run.code, run.out.lines().last().and_then(|line| serde_json::from_str(line).ok()).unwrap_or_default())
}

/// Jobs add up: starts that fail, a loss, a job that is stopped in a cut and resumed, test pulses. Time and length are
/// those of the reports.
#[test]
fn wear_adds_up_across_jobs() {
    let bench = bench();
    assert_contains(&bench.retrace(["consumables", "--machine", "m.toml"]).out, &["nothing was counted yet"]);
    let (code, report) = run(&bench, "", "");
    assert_eq!(code, Some(0));
    let near = |wear: [f64; 4], expected: [f64; 4]| {
        let is_near = wear.iter().zip(expected).all(|(are, wanted)| (are - wanted).abs() < 0.01);
        assert!(is_near, "{wear:?}, and not {expected:?}");
    };
    let lit_s = |report: &Value| report["lit_s"].as_f64().expect("a time");
    let first = wear(&bench).expect("counted");
    near(first, [3.0, 0.0, lit_s(&report), 0.11]);
    assert_eq!(report["consumables"][0]["starts"], 3, "{report}");
    // Attempts fail; a loss is recovered, by one more start.
    let (code, report) = run(&bench, &"after 8s recover\n".repeat(6), "no-start=0.4,seed=2,lose@20");
    assert_eq!(code, Some(0), "{report}");
    let second = wear(&bench).expect("counted");
    let starts = second[0] - first[0];
    assert!(second[1] >= 1.0 && starts >= 5.0 && starts == 4.0 + second[1], "{second:?}");
    near([0.0, 0.0, second[2] - first[2], second[3] - first[3]], [0.0, 0.0, lit_s(&report), 0.11]);
    // Stopped in a cut, and resumed: nothing is counted twice.
    let (code, _) = run(&bench, "at line 4 override 100%\nafter 0.5s stop\n", "");
    assert_eq!(code, Some(4));
    let stopped = wear(&bench).expect("counted");
    assert_eq!(stopped[0] - second[0], 1.0);
    let resumed = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!(resumed.code, Some(0), "{}", resumed.err);
    let third = wear(&bench).expect("counted");
    // The contour that was stopped in is continued by one more start.
    near([third[0] - second[0], third[1] - second[1], 0.0, third[3] - second[3]], [4.0, 0.0, 0.0, 0.11]);
    // New ones, by the command and within a job.
    let other = bench.retrace(["consumables", "--machine", "m.toml", "--changed", "laser"]);
    assert!(other.code == Some(2) && other.err.contains("no cutter laser"), "{}", other.err);
    assert_eq!(wear(&bench), Some(third));
    let changed = bench.retrace(["consumables", "--machine", "m.toml", "--changed", "torch"]);
    assert_contains(&changed.out, &["consumables of torch since", "0 starts, 0 failed, 0.0 min lit, 0.00 m cut"]);
    assert_eq!(wear(&bench), Some([0.0; 4]));
    let (code, _) = run(&bench, "at line 6 consumables changed\n", "");
    assert_eq!((code, wear(&bench).expect("counted")[0]), (Some(0), 2.0));
}

/// On a page, where no program runs.
#[test]
fn a_page_counts_from_new_consumables_on() {
    let bench = Bench::new();
    let machine = bench.file("m.toml", machine()).display().to_string();
    let (_server, mut page) = PageServer::in_control(&bench, PROGRAM, &["--machine", &machine]);
    page.wait_until("live figures", |page| !page.last("live").is_null());
    assert_eq!(page.order_when_free("consumables changed")["t"], "done");
    page.wait_until("the message", |page| page.last("log").to_string().contains("the consumables are new"));
}
