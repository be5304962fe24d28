//! The native engine: builds and calls the runner of `verification/`.
//!
//! Invariant: a check without an answer from the runner has failed.

use super::Job;
use super::outcome::{Engine, Outcome, Verdict};
use retrace_task_support::process::{self, Ended};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// Number of runs of a harness, enumerated, and as many drawn where that does not end.
const MOST: [&str; 2] = ["50000", "1000000"];
/// Time limit of all native checks together.
const LIMIT: Duration = Duration::from_secs(3000);

/// How fast a runner is, and how fast it is built.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Built {
    /// As the profile says.
    Usual,
    /// The properties are not optimised: for a check that ends at the first claim that fails.
    Quickly,
}

/// Builds the runner in this checkout, and returns its path.
///
/// # Errors
/// Where it does not build.
pub(crate) fn build(root: &Path, log: &Path) -> Result<PathBuf, String> {
    finish_build(&mut build_command(root), log)
}

/// Builds the runner in a copy of the checkout, in a folder of its own, and returns its path.
///
/// # Errors
/// Where it does not build.
pub(crate) fn build_copy(root: &Path, target: &Path, log: &Path, built: Built) -> Result<PathBuf, String> {
    let mut command = build_command(root);
    command.env("CARGO_TARGET_DIR", target).args(["--jobs", "1", "--config", "profile.dev.debug=false"]);
    if built == Built::Quickly {
        command.args(["--config", "profile.dev.package.retrace-verification.opt-level=0"]);
    }
    finish_build(&mut command, log)
}

fn build_command(root: &Path) -> Command {
    let arguments =
        ["build", "--package", "retrace-verification", "--bins", "--message-format", "json-render-diagnostics"];
    process::cargo(root, &arguments)
}

fn finish_build(command: &mut Command, log: &Path) -> Result<PathBuf, String> {
    let messages = process::done(command, Duration::from_secs(1800), log)?;
    process::executables(&messages).pop().ok_or_else(|| "cargo did not say where it put the runner".to_owned())
}

/// Runs every harness and search of the rows, two processes at a time.
pub(crate) fn run(job: &Job<'_>) {
    let checks: Vec<&str> = job.rows.iter().flat_map(|row| row.native_checks()).collect();
    let workers = process::workers();
    // neighbours are similar; dealt out in turn, the processes take about the same time
    let shares: Vec<(usize, Vec<&str>)> = (0..workers)
        .map(|share| (share, checks.iter().skip(share).step_by(workers).copied().collect()))
        .filter(|(_, share): &(usize, Vec<&str>)| !share.is_empty())
        .collect();
    process::each(&shares, workers, |(number, share)| {
        let log = job.folder.join(format!("native-{number}"));
        match process::run(&mut ask(&job.runner, share, job.quick), LIMIT, &log) {
            Ok(ended) => tell(job, share, &ended),
            Err(reason) => job.log.broken(Engine::Native, reason),
        }
    });
}

/// The runner's command for these checks.
pub(crate) fn ask(runner: &Path, checks: &[&str], quick: bool) -> Command {
    let mut command = Command::new(runner);
    command.arg("check").args(checks).args(["--most", MOST[usize::from(!quick)]]);
    if !quick {
        command.arg("--full");
    }
    command
}

fn tell(job: &Job<'_>, share: &[&str], ended: &Ended) {
    let answers = answers(&ended.output);
    for check in share {
        match answers.iter().find(|answer| answer.check == *check) {
            Some(answer) => job.log.tell(answer.clone()),
            None => {
                let words = format!("FAILED: the runner gave no answer; {}", ended.last_words());
                let verdict = Verdict::Failed;
                job.log.tell(Outcome { engine: Engine::Native, check: (*check).into(), verdict, words, seconds: 0.0 });
            }
        }
    }
}

/// Answers of the runner, one line per check.
pub(crate) fn answers(output: &str) -> Vec<Outcome> {
    output.lines().filter_map(|line| answer(&serde_json::from_str(line).ok()?)).collect()
}

fn answer(line: &Value) -> Option<Outcome> {
    let text = |key: &str| line.get(key)?.as_str();
    // a claim in a message has the line breaks of the code
    let told = text("words")?.split_whitespace().collect::<Vec<_>>().join(" ");
    let check = text("check")?.to_owned();
    let (verdict, words) = match text("result")? {
        "every" => (Verdict::Passed, format!("passed (every choice: {told} runs)")),
        "drawn" => (Verdict::Passed, format!("passed ({told} runs drawn)")),
        "search" => (Verdict::Passed, format!("passed ({told})")),
        "vacuous" => (Verdict::Failed, format!("FAILED, VACUOUS: {told}")),
        "refuted" => {
            let numbers: Vec<String> = line.get("numbers")?.as_array()?.iter().map(Value::to_string).collect();
            let replay = format!("cargo xtask verify --replay {check}={}", numbers.join(","));
            (Verdict::Failed, format!("REFUTED: {told}; {replay}"))
        }
        _ => (Verdict::Failed, format!("FAILED: {told}")),
    };
    Some(Outcome { engine: Engine::Native, check, verdict, words, seconds: line.get("seconds")?.as_f64()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_answer_has_its_verdict() {
        let line = |result: &str| {
            format!("{{\"check\":\"c\",\"result\":\"{result}\",\"words\":\"9\",\"numbers\":[1,2],\"seconds\":0.5}}\n")
        };
        let text: String = ["every", "drawn", "search", "vacuous", "refuted", "failed", "new"].map(line).concat();
        let told: Vec<_> = answers(&text).into_iter().map(|answer| (answer.verdict, answer.words)).collect();
        let verdicts: Vec<Verdict> = told.iter().map(|(verdict, _)| *verdict).collect();
        assert_eq!(verdicts[..3], [Verdict::Passed; 3]);
        assert_eq!(verdicts[3..], [Verdict::Failed; 4]);
        assert_eq!(told[4].1, "REFUTED: 9; cargo xtask verify --replay c=1,2");
        assert!(answers("thread 'main' panicked\n").is_empty());
    }
}
