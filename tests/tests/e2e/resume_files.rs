//! All files that decoding has read belong to a job (DNC-12): a changed one is refused by name, or the job has a copy
//! of its own.

use retrace_tests::command::{Bench, CommandOutput};
use serde_json::Value;

fn counts(result: &CommandOutput) -> [i64; 3] {
    let last = result.out.lines().last().unwrap_or_default();
    let report: Value =
        serde_json::from_str(last).unwrap_or_else(|error| panic!("{error}: {}\n{}", result.out, result.err));
    ["x", "y", "z"].map(|axis| report["position_counts"][axis].as_i64().unwrap_or_else(|| panic!("counts in {report}")))
}

#[track_caller]
fn assert_refused(result: &CommandOutput, name: &str) {
    assert!(
        result.code == Some(2) && result.err.contains("E2210") && result.err.contains(name),
        "{}\n{}",
        result.out,
        result.err
    );
    assert!(result.err.contains("--from-line"), "the way out: {}", result.err);
}

#[test]
fn a_cycle_that_was_changed_is_refused_by_name() {
    const CYCLE: &str = "PROC CUT(REAL _A) SAVE\nG1 G91 X=_A\nX=_A\nM17\n";
    let bench = Bench::new();
    std::fs::create_dir(bench.path("cycles")).expect("a folder");
    bench.file("cycles/CUT.SPF", CYCLE);
    bench.file("main.ngc", "G21 G90 F600\nCUT(5)\nG4 P1\nCUT(5)\nM2\n");
    bench.file("stop.op", "at line 3 stop\n");
    let run = ["run", "main.ngc", "--cycles", "cycles", "--json", "--operator", "stop.op"];
    assert_eq!(bench.retrace(run).code, Some(4));
    bench.file("cycles/CUT.SPF", CYCLE.replace("X=_A\nM17", "X=_A*7\nM17"));
    assert_refused(&bench.retrace(["resume", "--yes"]), "CUT.SPF");
    std::fs::remove_file(bench.path("cycles/CUT.SPF")).expect("a file");
    assert_refused(&bench.retrace(["resume", "--yes"]), "CUT.SPF");
    bench.file("cycles/CUT.SPF", CYCLE);
    // A file that would replace a built-in one.
    bench.file("cycles/CYCLE81.SPF", "PROC CYCLE81(REAL _A) SAVE\nG1 X=_A\nM17\n");
    assert_refused(&bench.retrace(["resume", "--yes"]), "CYCLE81.SPF");
    std::fs::remove_file(bench.path("cycles/CYCLE81.SPF")).expect("a file");
    let result = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!((result.code, counts(&result)), (Some(0), [20_000, 0, 0]), "{}", result.err);
}

#[test]
fn a_subprogram_that_was_changed_or_would_come_first_now_is_refused_by_name() {
    const SUB: &str = "o<hole> sub\nG1 X20\nG1 X0\no<hole> endsub\nM2\n";
    let bench = Bench::new();
    std::fs::create_dir(bench.path("subs")).expect("a folder");
    bench.file("subs/hole.ngc", SUB);
    bench.file("main.ngc", "G21 G90 F1200\nG1 Y1\no<hole> call\nG1 Y2\nM2\n");
    bench.file("stop.op", "at 0.5s stop\n");
    let run = ["run", "main.ngc", "--subs", "subs", "--json", "--operator", "stop.op"];
    assert_eq!(bench.retrace(run).code, Some(4));
    bench.file("subs/hole.ngc", SUB.replace("X20", "X21"));
    assert_refused(&bench.retrace(["resume", "--yes"]), "hole.ngc");
    bench.file("subs/hole.ngc", SUB);
    // The program's own folder takes precedence.
    bench.file("hole.ngc", SUB.replace("X20", "X21"));
    assert_refused(&bench.retrace(["resume", "--yes"]), "hole.ngc");
    std::fs::remove_file(bench.path("hole.ngc")).expect("a file");
    let result = bench.retrace(["resume", "--yes", "--json"]);
    assert_eq!((result.code, counts(&result)), (Some(0), [0, 2_000, 0]), "{}\n{}", result.out, result.err);
}

#[test]
fn a_machine_file_that_was_changed_is_shown_and_the_job_goes_on_with_its_own() {
    let bench = Bench::new();
    let machine = |pulses: u32| {
        let axis = |name: &str| {
            format!(
                "[[axis]]\nname = \"{name}\"\npulses_per_mm = {pulses}\nmax_velocity_mm_per_s = 100\n\
                 max_acceleration_mm_per_s2 = 1000\nmax_jerk_mm_per_s3 = 20000\ntravel_mm = [-50, 300]\n"
            )
        };
        ["x", "y", "z"].map(axis).concat()
    };
    bench.file("mill.toml", machine(100));
    bench.file("part.ngc", "G21 G90 F1200\nG1 X10\nG1 X20\nG1 Y20\nM2\n");
    bench.file("stop.op", "at line 3 stop\n");
    let run = ["run", "part.ngc", "--machine", "mill.toml", "--json", "--operator", "stop.op"];
    assert_eq!(bench.retrace(run).code, Some(4));
    bench.file("mill.toml", machine(200));
    let asked = bench.retrace(["resume"]);
    assert!(asked.err.contains("E2215"), "{}", asked.err);
    assert!(asked.out.contains("axis x, pulses_per_mm: 100 in the job, 200 now"), "{}", asked.out);
    // A job of its own uses the new file.
    let result = bench.retrace(["resume", "--from-line", "2", "--yes", "--json"]);
    assert_eq!((result.code, counts(&result)), (Some(0), [4_000, 4_000, 0]), "{}\n{}", result.out, result.err);
    let jobs: Value = serde_json::from_str(&bench.retrace(["jobs", "--json"]).out).expect("JSON");
    let jobs = jobs["jobs"].as_array().expect("a list").clone();
    let stopped = jobs.iter().find(|job| job["state"] == "stopped").expect("the first job");
    let id = stopped["id"].as_str().expect("a name");
    let result = bench.retrace(["resume", id, "--yes", "--json"]);
    assert_eq!((result.code, counts(&result)), (Some(0), [2_000, 2_000, 0]), "{}\n{}", result.out, result.err);
    let shown: Value = serde_json::from_str(result.out.lines().next().expect("a line")).expect("JSON");
    assert_eq!(shown["changed_machine"].as_array().map(Vec::len), Some(3), "{shown}");
}
