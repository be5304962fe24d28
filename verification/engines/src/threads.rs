//! The thread models under loom and shuttle: the tests of `retrace-loom` and `retrace-shuttle`.
//!
//! Invariant: a model that did not report its number of executions, or had no more than one, has failed.

use super::Job;
use super::outcome::{Engine, Outcome, Verdict};
use retrace_task_support::process;
use std::path::Path;
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(3600);

/// The folder and the package of an engine's models.
pub(crate) fn package(engine: Engine) -> (String, String) {
    (format!("verification/{}", engine.name()), format!("retrace-{}", engine.name()))
}

/// Whether there are models for this engine.
pub(crate) fn is_there(root: &Path, engine: Engine) -> bool {
    root.join(package(engine).0).join("Cargo.toml").is_file()
}

/// Runs the models of one engine, so many at a time.
pub(crate) fn run(job: &Job<'_>, engine: Engine, jobs: usize) {
    let models = job.rows.iter().flat_map(|row| &row.models).filter(|model| model.engine == engine.name());
    let tests: Vec<&str> = models.map(|model| model.test.as_str()).collect();
    if tests.is_empty() && job.is_slice {
        return;
    }
    let package = package(engine).1;
    let mut command = process::cargo(job.root, &["test", "--package", &package, "--tests", "--no-fail-fast", "--"]);
    command.arg("--show-output").arg(format!("--test-threads={jobs}"));
    if job.is_slice {
        // a part of a path is enough here; what else it matches is left out below
        command.args(&tests);
    }
    if !job.quick {
        command.env("RETRACE_FULL", "1");
    }
    let ended = match process::run(&mut command, LIMIT, &job.folder.join(engine.name())) {
        Ok(ended) => ended,
        Err(reason) => return job.log.broken(engine, reason),
    };
    let lines = ended.output.lines();
    // programs that count tests count these too
    lines.filter(|line| line.starts_with("test result: ")).for_each(|line| println!("{line}"));
    let seen = results(&ended.output, engine);
    for test in &tests {
        let found: Vec<&Outcome> = seen.iter().filter(|outcome| is_meant(&outcome.check, test)).collect();
        job.log.tell(together(engine, test, &found).unwrap_or_else(|| {
            let words = format!("ERROR: there is no such test in {package}; {}", ended.last_words());
            Outcome { engine, check: (*test).to_owned(), verdict: Verdict::Failed, words, seconds: 0.0 }
        }));
    }
    let in_no_row = |outcome: &&Outcome| !job.is_slice && !tests.iter().any(|test| is_meant(&outcome.check, test));
    for other in seen.iter().filter(in_no_row) {
        job.log.broken(engine, format!("{} of {package} is in no row: {}", other.check, other.words));
    }
    if !ended.passed() && seen.iter().all(|outcome| outcome.verdict != Verdict::Failed) {
        job.log.broken(engine, ended.last_words());
    }
}

/// Whether a row's name means this test: by its path, by the end of it, or by its module.
pub(crate) fn is_meant(path: &str, test: &str) -> bool {
    path == test || path.ends_with(&format!("::{test}")) || path.starts_with(&format!("{test}::"))
}

/// The tests that one name means, as one.
fn together(engine: Engine, test: &str, found: &[&Outcome]) -> Option<Outcome> {
    let worst = found.iter().find(|outcome| outcome.verdict == Verdict::Failed).or(found.first())?;
    let words = match (worst.verdict, found) {
        (Verdict::Failed, [_, _, ..]) => format!("{} ({})", worst.words, worst.check),
        (Verdict::Failed, _) => worst.words.clone(),
        _ => found.iter().map(|outcome| outcome.words.as_str()).collect::<Vec<_>>().join("; "),
    };
    let seconds = found.iter().fold(0.0, |sum, outcome| sum + outcome.seconds);
    Some(Outcome { engine, check: test.to_owned(), verdict: worst.verdict, words, seconds })
}

/// Results in the test runner's output: of each test that reports executions, and of each that failed.
fn results(output: &str, engine: Engine) -> Vec<Outcome> {
    let mut found = Vec::new();
    for line in output.lines() {
        let Some((name, result)) = line.strip_prefix("test ").and_then(|rest| rest.rsplit_once(" ... ")) else {
            continue;
        };
        let said = section(output, name);
        let mark = format!("{} ", engine.name().to_uppercase());
        let reports: Vec<&str> = said.iter().filter_map(|line| line.strip_prefix(&mark)).collect();
        let (verdict, words) = match result.trim() {
            "ok" if reports.iter().all(|report| executions(report) > 1) && !reports.is_empty() => {
                let reports: Vec<String> = reports.iter().map(|report| without_seconds(report)).collect();
                (Verdict::Passed, format!("passed ({})", reports.join("; ")))
            }
            "ok" => (Verdict::Failed, "FAILED: it did not say that it saw more than one execution".to_owned()),
            "ignored" => continue,
            _ => (Verdict::Failed, format!("FAILED: {}", why(&said))),
        };
        let seconds = reports.iter().filter_map(|report| seconds(report)).sum();
        found.push(Outcome { engine, check: name.to_owned(), verdict, words, seconds });
    }
    found
}

/// Whether one of several tests failed, and its message.
pub(crate) fn one_result(output: &str, engine: Engine) -> Option<(bool, String)> {
    let seen = results(output, engine);
    let outcome = seen.iter().find(|outcome| outcome.verdict == Verdict::Failed).or(seen.first())?;
    Some((outcome.verdict == Verdict::Failed, outcome.words.clone()))
}

/// Message of a panic: the line behind the one with its location.
fn why<'a>(said: &[&'a str]) -> &'a str {
    let panicked = said.iter().position(|line| line.contains(" panicked at "));
    let words = said.iter().skip(panicked.map_or(0, |at| at + 1)).find(|line| !line.trim().is_empty());
    words.copied().unwrap_or_default()
}

/// Output of a test.
fn section<'a>(output: &'a str, test: &str) -> Vec<&'a str> {
    let head = format!("---- {test} stdout ----");
    let body = output.lines().skip_while(|line| *line != head).skip(1);
    body.take_while(|line| !line.starts_with("---- ") && *line != "successes:" && *line != "failures:").collect()
}

/// The number before `executions` or `schedules`.
fn executions(report: &str) -> u64 {
    let words: Vec<&str> = report.split([' ', ',']).filter(|word| !word.is_empty()).collect();
    let unit = words.iter().position(|word| matches!(*word, "executions" | "schedules"));
    unit.and_then(|at| words.get(at.checked_sub(1)?)?.replace('_', "").parse().ok()).unwrap_or(0)
}

/// The number before ` s`.
fn seconds(report: &str) -> Option<f64> {
    let parts = report.split(", ").filter_map(|part| part.trim().strip_suffix(" s"));
    parts.filter_map(|number| number.parse().ok()).last()
}

fn without_seconds(report: &str) -> String {
    report.split(", ").filter(|part| seconds(part).is_none()).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLE: &str = "running 4 tests\ntest ring::short ... ok\ntest ring::long ... ok\ntest c ... FAILED\ntest d \
        ... ok\n\n\
        successes:\n\n---- ring::short stdout ----\nLOOM short: 2141 executions, outcomes {0, 1}, 0.25 s, preemption \
        bound 3\n\n\
        ---- ring::long stdout ----\nLOOM long: 1 executions, outcomes {0}, 0.1 s, preemption bound \
        3\n\n\nsuccesses:\n    ring::short\n\n\
        failures:\n\n---- c stdout ----\nWARNING: x\n\nthread 'c' panicked at x.rs:1:\ndeadlock\n\nfailures:\n    c\n\n\
        test result: FAILED. 3 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.1s\n";

    #[test]
    fn a_model_passes_only_where_it_saw_more_than_one_execution() {
        let told = results(SAMPLE, Engine::Loom);
        assert_eq!(told.len(), 4);
        assert_eq!(told[0].verdict, Verdict::Passed);
        assert_eq!(told[0].words, "passed (short: 2141 executions, outcomes {0, 1}, preemption bound 3)");
        assert_eq!(told[0].seconds, 0.25);
        assert_eq!(told[1].verdict, Verdict::Failed);
        assert_eq!((told[2].verdict, told[2].words.as_str()), (Verdict::Failed, "FAILED: deadlock"));
        assert_eq!(told[3].verdict, Verdict::Failed);
        assert_eq!(one_result(SAMPLE, Engine::Loom).map(|(failed, _)| failed), Some(true));
    }

    #[test]
    fn a_name_may_mean_several_tests_and_the_worst_counts() {
        let told = results(SAMPLE, Engine::Loom);
        let meant: Vec<&Outcome> = told.iter().filter(|outcome| is_meant(&outcome.check, "ring")).collect();
        assert_eq!(meant.len(), 2);
        let ring = together(Engine::Loom, "ring", &meant).unwrap();
        assert!(ring.verdict == Verdict::Failed && ring.words.ends_with("(ring::long)"));
        let short = together(Engine::Loom, "short", &meant[..1]).unwrap();
        assert!(
            short.verdict == Verdict::Passed && is_meant("ring::short", "short") && !is_meant("ring::short", "ort")
        );
        assert_eq!(together(Engine::Loom, "x", &[]), None);
    }
}
