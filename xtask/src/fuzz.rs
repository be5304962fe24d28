//! `cargo xtask campaign fuzz`: hostile input for half an hour, as random cases of our own and, where it is installed,
//! with cargo-fuzz.
//!
//! Invariant: a missing tool is reported; our own cases need nothing but the tests.

use retrace_task_support::process;
use std::path::Path;
use std::process::{Command, Stdio};

/// Purpose of the campaign.
pub(crate) const PURPOSE: &str = "no panic, no hang, no unbounded memory, whatever the program, table or cycle source";

/// Seconds of our own cases: of a full campaign, and of the slice without `--full`.
const OWN_SECONDS: [u64; 2] = [1800, 10];
/// Seconds of each target of cargo-fuzz, only in a full campaign.
const TARGET_SECONDS: u64 = 300;
/// The targets.
const TARGETS: [&str; 3] = ["program", "tables", "cycle"];

/// Runs the campaign and returns whether it passed.
pub(crate) fn run(root: &Path, full: bool, seed: u64) -> bool {
    let seconds = OWN_SECONDS[usize::from(!full)];
    println!("campaign fuzz: {PURPOSE} ({seconds} s on two threads, seed {seed})");
    let mut own = process::cargo(root, &["test", "--release", "--package", "retrace-gcode", "--test", "testsuite"]);
    own.args(["--", "--nocapture", "hostile::a_campaign_of_broken_programs"]);
    own.env("RETRACE_FUZZ_SECONDS", seconds.to_string()).env("RETRACE_FUZZ_SEED", seed.to_string());
    let passed = succeeds(&mut own);
    if !full {
        return passed;
    }
    match missing() {
        Some(what) => {
            println!("campaign fuzz: {what} is not installed, so the targets of cargo-fuzz were not run");
            passed
        }
        None => TARGETS.iter().fold(passed, |passed, target| targeted(root, target, seed) && passed),
    }
}

/// Runs a target of cargo-fuzz.
fn targeted(root: &Path, target: &str, seed: u64) -> bool {
    let mut command = Command::new("cargo");
    command.args(["+nightly", "fuzz", "run", target, "--"]);
    // A seed of 0 would let libFuzzer choose one; memory in MiB, a single input in seconds.
    command
        .args([format!("-max_total_time={TARGET_SECONDS}"), format!("-seed={}", seed.clamp(1, u64::from(u32::MAX)))]);
    command.args(["-rss_limit_mb=2048", "-timeout=60", "-max_len=20000"]);
    println!("campaign fuzz: cargo-fuzz, target {target}, {TARGET_SECONDS} s");
    succeeds(command.current_dir(root.join("crates/gcode/fuzz")))
}

/// What cargo-fuzz lacks on this machine.
fn missing() -> Option<&'static str> {
    let answers = |arguments: &[&str]| {
        let mut command = Command::new("cargo");
        succeeds(command.args(arguments).stdout(Stdio::null()).stderr(Stdio::null()))
    };
    if !answers(&["+nightly", "--version"]) {
        return Some("a nightly toolchain");
    }
    (!answers(&["+nightly", "fuzz", "--version"])).then_some("cargo-fuzz")
}

fn succeeds(command: &mut Command) -> bool {
    match command.status() {
        Ok(status) => status.success(),
        Err(error) => {
            eprintln!("xtask: cargo could not be run: {error}");
            false
        }
    }
}
