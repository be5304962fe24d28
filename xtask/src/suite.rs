//! `cargo xtask test`: the steps that a change must pass, one after the other, and a table of their results.
//!
//! Invariant: a step passes only if its own process reports success; one that fails does not hide those after it.

use crate::campaign::SPARKPLUG_HOST;
use crate::test_output::TestOutput;
use crate::{firmware, tidy};
use retrace_task_support::{process, tools};
use retrace_verify as verify;
use std::io::{BufRead, BufReader, Write};
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// One step: its purpose, and its command.
pub(crate) struct Step {
    pub(crate) name: &'static str,
    pub(crate) purpose: &'static str,
    run: fn(&Path, &Settings) -> Outcome,
}

/// Settings of a run of the suite.
#[derive(Clone, Debug, Default)]
pub(crate) struct Settings {
    /// Whether a test fails whose peer (rs274, programs of others) is missing here.
    pub(crate) require_peers: bool,
}

/// Result of a step.
#[derive(Default)]
struct Outcome {
    passed: bool,
    remark: String,
    /// What each failed test has said, its name first.
    failed_tests: Vec<Vec<String>>,
}

impl Outcome {
    fn failed(remark: String) -> Self {
        Self { remark, ..Self::default() }
    }
}

/// Every step, in the order in which it is run: the quick ones first.
pub(crate) const STEPS: &[Step] = &[
    Step { name: "fmt", purpose: "the code is formatted", run: |root, _| cargo(root, &["fmt", "--all", "--check"]) },
    Step { name: "tidy", purpose: "the project's own rules hold", run: tidy_step },
    Step { name: "clippy", purpose: "no warning in any target", run: clippy },
    Step { name: "test", purpose: "unit, integration and end-to-end tests", run: tests },
    Step {
        name: "browser",
        purpose: "the page of `retrace serve` in a real browser, used as a person uses it",
        run: browser_step,
    },
    Step {
        name: "verify",
        purpose: "the properties of verification/ hold, as far as a quick run goes",
        run: verify_step,
    },
    Step {
        name: "firmware",
        purpose: "the card on a microcontroller: its tests here, its size, a run in QEMU",
        run: firmware_step,
    },
    Step { name: "doctest", purpose: "the examples in the documents run", run: doc_tests },
    Step { name: "rustdoc", purpose: "the documents build without a warning", run: rustdoc },
];

/// Runs the steps named in `only`, or all of them, and returns whether all passed.
pub(crate) fn run(root: &Path, only: &[&str], settings: &Settings) -> bool {
    let mut rows: Vec<(&str, Outcome, Duration, Duration)> = Vec::new();
    if tools::browser().is_none() && (only.is_empty() || only.contains(&"browser")) {
        println!("NOT RUN  browser: {NO_BROWSER}");
    }
    for step in STEPS.iter().filter(|step| only.is_empty() || only.contains(&step.name)) {
        println!("--- {}: {}", step.name, step.purpose);
        let (started, used) = (Instant::now(), processor_time());
        let outcome = (step.run)(root, settings);
        rows.push((step.name, outcome, started.elapsed(), processor_time().saturating_sub(used)));
    }
    let failed =
        || rows.iter().flat_map(|(name, outcome, ..)| outcome.failed_tests.iter().map(move |test| (name, test)));
    failed().for_each(|(step, said)| println!("\nFAILED  {step}: {}", said.join("\n        ")));
    println!("\n{:<8} {:<7} {:>8} {:>10}", "step", "result", "seconds", "processor");
    for (name, outcome, took, used) in &rows {
        let result = match outcome.passed {
            false => "FAILED",
            true if outcome.remark.starts_with("NOT RUN") => "NOT RUN",
            true => "passed",
        };
        let (took, used) = (took.as_secs_f64(), used.as_secs_f64());
        println!("{name:<8} {result:<7} {took:>8.1} {used:>10.1}  {}", outcome.remark);
    }
    rows.iter().all(|(_, outcome, ..)| outcome.passed)
}

/// Processor time of the ended processes that this one has started, on all processors: unlike the seconds it depends
/// little on what else the computer does. Zero where the kernel does not tell it.
fn processor_time() -> Duration {
    /// Of fields behind the name in brackets: `cutime` and `cstime`, in hundredths of a second (proc_pid_stat(5)).
    const OF_CHILDREN: std::ops::Range<usize> = 13..15;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let ticks = fields.get(OF_CHILDREN).unwrap_or_default().iter().filter_map(|field| field.parse::<u64>().ok());
    Duration::from_millis(10 * ticks.sum::<u64>())
}

fn tidy_step(root: &Path, _: &Settings) -> Outcome {
    Outcome { passed: tidy::run(root), remark: format!("{} checks", tidy::CHECKS.len()), ..Outcome::default() }
}

fn clippy(root: &Path, _: &Settings) -> Outcome {
    cargo(root, &["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"])
}

/// The packages of the steps `test` and `doctest`: all but the thread models, which the step `verify` runs and counts.
/// Both name the same packages, so that each is compiled once, with one set of features.
const TESTED: [&str; 5] = ["--workspace", "--exclude", "retrace-loom", "--exclude", "retrace-shuttle"];

fn tests(root: &Path, settings: &Settings) -> Outcome {
    let binary = match build_with_tests(root) {
        Ok(binary) => binary,
        Err(remark) => return Outcome::failed(remark),
    };
    let mut command = at_lower_priority(&process::cargo(root, &["test"]));
    command.args(TESTED).args(["--tests", "--no-fail-fast"]);
    // Many end-to-end tests wait for machine time: eight at a time on two processors.
    if std::env::var_os("RUST_TEST_THREADS").is_none() {
        let processors = std::thread::available_parallelism().map_or(1, NonZero::get);
        command.env("RUST_TEST_THREADS", (4 * processors).to_string());
    }
    let list = root.join("target/not-run.txt");
    // a list of the run before would be counted again
    let _ = std::fs::remove_file(&list);
    peers_missing().iter().for_each(|missing| println!("NOT RUN  tests against a peer: {missing}"));
    if settings.require_peers {
        command.env("RETRACE_REQUIRE_PEERS", "1");
    }
    let outcome = count_tests(command.env("RETRACE_BIN", binary).env("RETRACE_NOT_RUN", &list));
    without_those_not_run(outcome, &std::fs::read_to_string(&list).unwrap_or_default())
}

/// The command at a lower priority than the kernel's own threads. They carry the bytes between a card that is served on
/// a pseudo-terminal and its host: behind the load of the tests these would be late by more than a look-ahead.
fn at_lower_priority(command: &Command) -> Command {
    let mut nice = Command::new("nice");
    nice.args(["-n", "10"]).arg(command.get_program()).args(command.get_args());
    if let Some(folder) = command.get_current_dir() {
        nice.current_dir(folder);
    }
    nice
}

/// Why the step `browser` does not run.
const NO_BROWSER: &str = "no browser: neither RETRACE_BROWSER nor chromium on PATH";

/// At most so many pages at a time: they draw in software.
const BROWSERS: usize = 4;

/// The tests of the page in a browser.
fn browser_step(root: &Path, settings: &Settings) -> Outcome {
    if tools::browser().is_none() {
        return Outcome {
            passed: !settings.require_peers,
            remark: format!("NOT RUN: {NO_BROWSER}"),
            ..Outcome::default()
        };
    }
    let binary = match build_command(root) {
        Ok(binary) => binary,
        Err(remark) => return Outcome::failed(remark),
    };
    let list = root.join("target/browser-not-run.txt");
    // a list of the run before would be counted again
    let _ = std::fs::remove_file(&list);
    // the packages of the step `test`: with one package alone some dependencies would be compiled once more
    let mut command = process::cargo(root, &["test"]);
    command.args(TESTED).args(["--test", "browser", "--", "--test-threads", &BROWSERS.to_string()]);
    if settings.require_peers {
        command.env("RETRACE_REQUIRE_PEERS", "1");
    }
    let outcome = count_tests(command.env("RETRACE_BIN", binary).env("RETRACE_NOT_RUN", &list));
    without_those_not_run(outcome, &std::fs::read_to_string(&list).unwrap_or_default())
}

/// The peers that tests compare with and that are not here.
fn peers_missing() -> Vec<&'static str> {
    let is_there = tools::on_path("rs274").is_some();
    let programs = std::env::var_os("RETRACE_PROGRAMS").is_some();
    let host = std::env::var_os(SPARKPLUG_HOST).is_some();
    let is_installed = |server| tools::server(server).is_some();
    let peers = [
        (is_there, "rs274 (LinuxCNC) is not on PATH"),
        (programs, "RETRACE_PROGRAMS names no folder of programs"),
        (is_installed("mosquitto"), "mosquitto is not installed"),
        (is_installed("nats-server"), "nats-server is not installed"),
        (host, "RETRACE_SPARKPLUG_HOST names no host application: cargo xtask campaign sparkplug-host builds one"),
    ];
    peers.into_iter().filter(|(is_there, _)| !is_there).map(|(_, missing)| missing).collect()
}

/// Names the tests that returned without their peer, and takes them off the number of those that passed.
fn without_those_not_run(mut outcome: Outcome, list: &str) -> Outcome {
    let not_run = list.lines().count() as u64;
    list.lines().for_each(|line| println!("NOT RUN  {line}"));
    if not_run > 0 {
        let (passes, rest) = outcome.remark.split_once(' ').unwrap_or_default();
        let passes = passes.parse::<u64>().unwrap_or_default().saturating_sub(not_run);
        outcome.remark = format!("{passes} {rest}, {not_run} NOT RUN");
    }
    outcome
}

fn verify_step(root: &Path, _: &Settings) -> Outcome {
    match verify::run(root, &verify::Options::quick()) {
        Ok(verify::Summary { passed, remark }) => Outcome { passed, remark, ..Outcome::default() },
        Err(remark) => Outcome::failed(remark),
    }
}

fn firmware_step(root: &Path, _: &Settings) -> Outcome {
    let verdict = firmware::test(root);
    Outcome { passed: verdict.passed, remark: verdict.remark, ..Outcome::default() }
}

fn doc_tests(root: &Path, _: &Settings) -> Outcome {
    count_tests(process::cargo(root, &["test"]).args(TESTED).args(["--doc", "--no-fail-fast"]))
}

fn rustdoc(root: &Path, _: &Settings) -> Outcome {
    ended(process::cargo(root, &["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings"))
}

/// The `retrace` command that the step `test` has built, for the steps after it.
static TESTED_COMMAND: OnceLock<PathBuf> = OnceLock::new();

/// Builds the `retrace` command together with the tests: by itself it has fewer features of some dependencies, with
/// which the whole project would be compiled once more.
fn build_with_tests(root: &Path) -> Result<PathBuf, String> {
    let mut command = process::cargo(root, &["build"]);
    command.args(TESTED).args(["--tests", "--bin", "retrace", "--message-format", "json-render-diagnostics"]);
    let binary = process::build_named(&mut command, "retrace")?;
    Ok(TESTED_COMMAND.get_or_init(|| binary).clone())
}

/// Builds the `retrace` command in the tests' own profile, unless that was done, and returns where cargo put it.
pub(crate) fn build_command(root: &Path) -> Result<PathBuf, String> {
    if let Some(binary) = TESTED_COMMAND.get() {
        return Ok(binary.clone());
    }
    let arguments = ["build", "--package", "retrace-cli", "--message-format", "json-render-diagnostics"];
    process::build(&mut process::cargo(root, &arguments))
}

fn cargo(root: &Path, arguments: &[&str]) -> Outcome {
    ended(&mut process::cargo(root, arguments))
}

fn ended(command: &mut Command) -> Outcome {
    match command.status() {
        Ok(status) if status.success() => Outcome { passed: true, ..Outcome::default() },
        Ok(status) => Outcome::failed(status.to_string()),
        Err(error) => Outcome::failed(format!("cannot be run: {error}")),
    }
}

/// Runs a test command, prints its output line by line, and adds up the reports of its runners.
fn count_tests(command: &mut Command) -> Outcome {
    let mut child = match command.stdout(Stdio::piped()).spawn() {
        Ok(child) => child,
        Err(error) => return Outcome::failed(format!("cannot be run: {error}")),
    };
    let mut total = TestOutput::default();
    if let Some(output) = child.stdout.take() {
        for line in BufReader::new(output).split(b'\n').map_while(Result::ok) {
            let line = String::from_utf8_lossy(&line);
            println!("{line}");
            total.add(&line);
        }
        // A closed pipe on our own side is not a reason to call the tests failed.
        let _ = std::io::stdout().flush();
    }
    let passed = child.wait().is_ok_and(|status| status.success());
    let TestOutput { passes, failures, ignored, said, .. } = total;
    Outcome {
        passed: passed && failures == 0,
        remark: format!("{passes} passed, {failures} failed, {ignored} ignored"),
        failed_tests: said,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_test_without_its_peer_is_not_counted_as_passed() {
        let outcome =
            || Outcome { passed: true, remark: "12 passed, 0 failed, 1 ignored".into(), ..Outcome::default() };
        assert_eq!(without_those_not_run(outcome(), "").remark, "12 passed, 0 failed, 1 ignored");
        let two = without_those_not_run(outcome(), "a: no rs274\nb: no rs274\n");
        assert_eq!(two.remark, "10 passed, 0 failed, 1 ignored, 2 NOT RUN");
        assert!(two.passed);
    }

    #[test]
    fn a_step_passes_only_if_its_process_does() {
        assert!(!ended(&mut Command::new("no-such-program-of-ours")).passed);
        assert!(!count_tests(&mut Command::new("no-such-program-of-ours")).passed);
        let root = Path::new(".");
        assert!(cargo(root, &["--version"]).passed && !cargo(root, &["no-such-task"]).passed);
    }
}
