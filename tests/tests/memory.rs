//! Large and endless inputs: memory stays bounded, devices and tables without end are refused.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::process::{Command, Stdio};

use retrace_tests::command::{Bench, binary};
use retrace_tests::run::Run;

/// MiB that checking a large file may use: the built-in machine's history is not included.
const MAX_MIB: u64 = 48;

/// Writes a program of `mib` MiB: short moves with long comments, so that there is more text than work.
fn large(bench: &Bench, mib: u64) -> std::path::PathBuf {
    let path = bench.path("large.ngc");
    let mut file = BufWriter::new(File::create(&path).expect("a file"));
    let remark = "x".repeat(220);
    let line = |n: u64| format!("({remark} {n:12})\n");
    let count = mib * (1 << 20) / line(0).len() as u64;
    write!(file, "G21 G90 F6000\nG1 X1\n").expect("written");
    for n in 0..count {
        file.write_all(line(n).as_bytes()).expect("written");
    }
    write!(file, "G1 X7.5\nM2\n").expect("written");
    file.flush().expect("written");
    path
}

/// Runs the command and watches its memory; returns the exit code, and the largest resident set in MiB.
fn peak_mib(bench: &Bench, arguments: &[&str]) -> (Option<i32>, u64, String) {
    let out = bench.path("out.txt");
    let mut command = Command::new(binary());
    command.args(arguments).env("XDG_STATE_HOME", bench.path("state")).stdin(Stdio::null());
    command.stdout(File::create(&out).expect("a file")).stderr(Stdio::null());
    let mut child = command.spawn().expect("the command runs");
    let (mut peak, status) = (0, format!("/proc/{}/status", child.id()));
    let code = loop {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let high =
            text.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        peak = peak.max(high.unwrap_or(0) >> 10);
        if let Some(status) = child.try_wait().expect("a child") {
            break status.code();
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    };
    (code, peak, std::fs::read_to_string(out).expect("text"))
}

#[test]
fn a_program_of_100_mb_is_checked_in_bounded_memory() {
    let bench = Bench::new();
    let path = large(&bench, 96);
    let begun = std::time::Instant::now();
    let (code, peak, out) = peak_mib(&bench, &["check", &path.to_string_lossy(), "--json"]);
    println!("{peak} MiB, {:.1} s", begun.elapsed().as_secs_f64());
    assert_eq!(code, Some(0), "{out}");
    assert!((1..=MAX_MIB).contains(&peak), "{peak} MiB");
}

#[test]
fn a_large_program_runs_to_the_same_counts_as_a_small_one() {
    let bench = Bench::new();
    let path = large(&bench, 8);
    let run = Run::of(&bench, &path, &[]);
    run.assert_exact_and_legal();
    assert_eq!(run.counts(), [7500, 0, 0]);
}

#[test]
fn a_stream_that_exceeds_its_quota_stops_and_keeps_its_breakpoint() {
    let bench = Bench::new();
    let text = std::fs::read(large(&bench, 2)).expect("a file");
    let machine = bench.file("m.toml", "stream_quota_mib = 1\n");
    let run = Run::of_input(&bench, &text, &["--machine", &machine.to_string_lossy()]);
    assert_eq!((run.output.code, run.report["outcome"].as_str()), (Some(1), Some("stopped")), "{}", run.output.err);
    assert!(run.output.err.contains("E2313") && run.output.err.contains("retrace resume"), "{}", run.output.err);
    assert_eq!(run.counts(), [1000, 0, 0]);
}

#[cfg(target_os = "linux")]
#[test]
fn devices_and_endless_tables_are_refused() {
    let bench = Bench::new();
    bench.file("p.ngc", "G21 G1 X1 F100\nM2\n");
    let file = File::create(bench.path("huge.tbl")).expect("a file");
    file.set_len(10 << 30).expect("a hole");
    let refused = |arguments: &[&str], number: &str| {
        let result = bench.retrace(arguments);
        assert!(
            result.code == Some(2) && result.err.contains(number),
            "{arguments:?}: {:?} {}",
            result.code,
            result.err
        );
    };
    refused(&["check", "p.ngc", "--machine", "/dev/zero"], "E2312");
    refused(&["check", "p.ngc", "--machine", "/"], "E2102");
    refused(&["check", "p.ngc", "--tools", "huge.tbl"], "E2312");
    refused(&["check", "p.ngc", "--params", "/dev/zero"], "E2312");
    refused(&["run", "p.ngc", "--operator", "/dev/urandom"], "E2312");
    refused(&["check", "."], "E2102");
}
