//! Miri and the thread sanitizer on the tests of the ring, the one module of the core with unsafe code.
//!
//! Invariant: each runs by name only, with the nightly toolchain that is installed, and downloads nothing.

use super::Job;
use super::outcome::{Engine, Outcome, Verdict};
use retrace_task_support::process;
use retrace_task_support::tools::result;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(1800);
/// Target that the thread sanitizer runs on here.
const TARGET: &str = "x86_64-unknown-linux-gnu";
/// The tests, by a part of their path.
const TESTS: &str = "ring::tests";
/// Drawn sequences of operations, which miri executes one step at a time.
const MIRI_CASES: &str = "8";

/// Installation of what an engine needs.
pub(crate) fn how_to_get(engine: Engine) -> &'static str {
    match engine {
        Engine::Miri => "rustup toolchain install nightly --component miri,rust-src",
        _ => "rustup toolchain install nightly --component rust-src, on x86_64 Linux",
    }
}

/// What an engine needs and this machine has not.
pub(crate) fn lacks(engine: Engine) -> Option<String> {
    let sysroot = result(Command::new("rustc").args(["+nightly", "--print", "sysroot"]));
    let Some(sysroot) = sysroot else { return Some("missing: a nightly toolchain".to_owned()) };
    let needs = |path: &str, name: &str| (!Path::new(&sysroot).join(path).exists()).then(|| format!("missing: {name}"));
    needs("lib/rustlib/src/rust/library/Cargo.lock", "rust-src of the nightly toolchain").or_else(|| match engine {
        Engine::Miri => needs("bin/cargo-miri", "miri of the nightly toolchain"),
        _ => needs(&format!("lib/rustlib/{TARGET}"), &format!("a host {TARGET}")),
    })
}

/// Runs the ring's tests under one of the two.
pub(crate) fn run(job: &Job<'_>, engine: Engine) {
    let folder = job.folder.join(engine.name());
    let mut command = Command::new("cargo");
    command.current_dir(job.root).env("CARGO_TARGET_DIR", &folder).arg("+nightly");
    match engine {
        Engine::Miri => command
            .args(["miri", "test"])
            .env("MIRIFLAGS", "-Zmiri-disable-isolation")
            .env("PROPTEST_CASES", MIRI_CASES),
        _ => command.args(["test", "-Zbuild-std", "--target", TARGET]).env("RUSTFLAGS", "-Zsanitizer=thread"),
    };
    // the toolchain's own variables would override the one that is named
    command.env_remove("RUSTUP_TOOLCHAIN").env_remove("RUSTC").env_remove("CARGO");
    command.args(["--offline", "--package", "retrace-core", "--lib", "--", TESTS]);
    let ended = match process::run(&mut command, LIMIT, &folder.join("run")) {
        Ok(ended) => ended,
        Err(reason) => return job.log.broken(engine, reason),
    };
    let (check, seconds) = ("ring-tests".to_owned(), ended.seconds);
    let (verdict, words) = match passed(&ended.output) {
        Some(count) if ended.passed() => (Verdict::Passed, format!("passed ({count} tests of the ring)")),
        _ => (Verdict::Failed, format!("FAILED: {}", why(&ended.errors).unwrap_or_else(|| ended.last_words()))),
    };
    job.log.tell(Outcome { engine, check, verdict, words, seconds });
}

/// Number of tests that passed, of at least one.
fn passed(output: &str) -> Option<u32> {
    let line = output.lines().find(|line| line.starts_with("test result: ok. "))?;
    line.split(' ').nth(3)?.parse().ok().filter(|count| *count > 0)
}

/// What the engine found.
fn why(errors: &str) -> Option<String> {
    let is_finding = |line: &&str| line.starts_with("error: Undefined Behavior") || line.contains("ThreadSanitizer:");
    errors.lines().find(is_finding).map(|line| line.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_tests_that_ran_pass() {
        let result = |count| format!("running {count} tests\n\ntest result: ok. {count} passed; 0 failed; 0 ignored");
        assert_eq!((passed(&result(6)), passed(&result(0)), passed("")), (Some(6), None, None));
        assert_eq!(passed("test result: FAILED. 5 passed; 1 failed"), None);
    }

    #[test]
    fn a_finding_is_named() {
        let miri = "warning: x\nerror: Undefined Behavior: Data race detected between (1) and (2)\n  --> a.rs";
        assert_eq!(why(miri).as_deref(), Some("error: Undefined Behavior: Data race detected between (1) and (2)"));
        assert_eq!(
            why("==\nWARNING: ThreadSanitizer: data race (pid=1)\n").as_deref(),
            Some("WARNING: ThreadSanitizer: data race (pid=1)")
        );
        assert_eq!(why("error[E0432]: unresolved"), None);
    }
}
