//! Output that is lost is an error; a reader that stops reading is not.

use std::fs::File;
use std::process::{Command, Stdio};

use retrace_tests::command::{Bench, CommandOutput, binary, read_one_line_of};

/// Runs the command in a bench with its output lost.
fn to_a_full_device(bench: &Bench, arguments: &[&str]) -> CommandOutput {
    let mut command = Command::new(binary());
    command.args(arguments).current_dir(bench.path("")).env("XDG_STATE_HOME", bench.path("state"));
    command.stdin(Stdio::null()).stdout(File::options().write(true).open("/dev/full").expect("a device"));
    let output = command.stderr(Stdio::piped()).spawn().expect("it runs").wait_with_output().expect("it ends");
    CommandOutput {
        code: output.status.code(),
        out: String::new(),
        err: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

fn bench() -> Bench {
    let bench = Bench::new();
    bench.file("part.ngc", "G21 G90 F3000\nG1 X5\nM2\n");
    bench.file("wrong.ngc", "G21 G90 F3000\nG1 X5 K\nM2\n");
    bench
}

#[test]
fn a_command_whose_output_is_lost_fails() {
    let bench = bench();
    let commands: [&[&str]; 9] = [
        &["canon", "part.ngc"],
        &["check", "part.ngc"],
        &["check", "part.ngc", "--json"],
        &["plot", "part.ngc", "-o", "part.svg"],
        &["jobs"],
        &["size"],
        &["machine", "new"],
        &["cycles", "list"],
        &["card", "ports"],
    ];
    for arguments in commands {
        let result = to_a_full_device(&bench, arguments);
        assert_eq!(result.code, Some(2), "{arguments:?}: {}", result.err);
        assert!(
            result.err.contains("E2105") && result.err.contains("standard output"),
            "{arguments:?}: {}",
            result.err
        );
        assert_eq!(bench.retrace(arguments).code, Some(0), "{arguments:?}");
    }
    assert_eq!(to_a_full_device(&bench, &["check", "wrong.ngc"]).code, Some(1));
}

#[test]
fn a_job_whose_output_is_lost_is_finished_and_says_so() {
    let bench = bench();
    bench.file("stop.op", "at 0.05s stop\n");
    for more in [&[][..], &["--json"]] {
        let result = to_a_full_device(&bench, &[&["run", "part.ngc"], more].concat());
        assert_eq!(result.code, Some(2), "{}", result.err);
        assert!(result.err.contains("E2105"), "{}", result.err);
        let jobs = bench.retrace(["jobs", "--all", "--json"]);
        let jobs: serde_json::Value = serde_json::from_str(&jobs.out).expect("JSON");
        let id = jobs["jobs"][0]["id"].as_str().expect("a job").to_owned();
        let report = bench.path("state").join("retrace/jobs").join(&id).join("report.json");
        let report: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(report).expect("a report")).expect("JSON");
        assert_eq!((&report["outcome"], &report["exit_code"]), (&"completed".into(), &2.into()), "{report}");
        assert!(report["output_lost"].as_str().is_some_and(|what| what.contains("standard output")), "{report}");
    }
    // every other exit code is unchanged
    let result = to_a_full_device(&bench, &["run", "part.ngc", "--operator", "stop.op"]);
    assert_eq!(result.code, Some(4), "{}", result.err);
    let result = to_a_full_device(&bench, &["resume", "--yes"]);
    assert_eq!(result.code, Some(2), "{}", result.err);
    // records are output, too
    let result = bench.retrace(["run", "part.ngc", "--records", "/dev/full", "--json"]);
    assert!(result.code == Some(2) && result.err.contains("the records"), "{}", result.err);
    assert!(result.out.lines().last().is_some_and(|line| line.contains("\"completed\"")), "{}", result.out);
}

#[test]
fn a_closed_pipe_is_no_error() {
    let bench = bench();
    let part = bench.path("part.ngc");
    for arguments in [["canon", &part.to_string_lossy()], ["machine", "new"], ["cycles", "list"]] {
        let result = read_one_line_of(&arguments);
        assert_eq!((result.code, result.err.as_str()), (Some(0), ""), "{arguments:?}");
    }
}

#[test]
fn no_empty_machine_file_is_left_or_taken() {
    let bench = bench();
    bench.file("empty.toml", " \n");
    let result = bench.retrace(["check", "part.ngc", "--machine", "empty.toml"]);
    assert!(result.code == Some(2) && result.err.contains("E2114"), "{}", result.err);
    let result = bench.retrace(["machine", "check", "empty.toml"]);
    assert!(result.code == Some(2) && result.err.contains("E2114"), "{}", result.err);
    // a folder whose disk is full cannot be simulated; a file that may not grow can
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -f 0; exec \"$0\" machine new -o new.toml"]).arg(binary()).current_dir(bench.path(""));
    let status = command.stderr(Stdio::null()).stdout(Stdio::null()).status().expect("it runs");
    assert!(!status.success());
    let is_empty = std::fs::metadata(bench.path("new.toml")).is_ok_and(|file| file.len() == 0);
    assert!(!is_empty, "an empty file is left");
}
