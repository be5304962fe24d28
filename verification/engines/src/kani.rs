//! Kani over the harnesses in its list.
//!
//! Invariant: a harness is called proved only where Kani reported success for it by name.

use super::Job;
use super::outcome::{Engine, Outcome, Verdict};
use retrace_task_support::process;
use std::time::Duration;

/// Time limit of all of Kani's harnesses together.
const LIMIT: Duration = Duration::from_secs(7200);

/// Runs `cargo kani`, which the caller knows to be set up.
pub(crate) fn run(job: &Job<'_>) {
    let harnesses: Vec<&str> =
        job.rows.iter().flat_map(|row| &row.harnesses).map(|harness| harness.name.as_str()).collect();
    if harnesses.is_empty() {
        return;
    }
    let mut command = process::cargo(job.root, &["kani", "--package", "retrace-verification", "--lib"]);
    command.args(["--output-format", "terse"]).env("CARGO_TARGET_DIR", job.folder.join("kani"));
    if job.is_slice {
        for name in &harnesses {
            command.args(["--harness", name]);
        }
    }
    let ended = match process::run(&mut command, LIMIT, &job.folder.join("kani")) {
        Ok(ended) => ended,
        Err(reason) => return job.log.broken(Engine::Kani, reason),
    };
    let results = results(&ended.output);
    for name in harnesses {
        let outcome = results.iter().find(|outcome| outcome.check == name).cloned().unwrap_or_else(|| {
            let words = format!("ERROR: Kani reported nothing; {}", ended.last_words());
            Outcome { engine: Engine::Kani, check: name.into(), verdict: Verdict::Failed, words, seconds: 0.0 }
        });
        job.log.tell(outcome);
    }
}

/// Results of the harnesses in Kani's terse output.
fn results(output: &str) -> Vec<Outcome> {
    let mut found: Vec<Outcome> = Vec::new();
    let mut reasons: Vec<String> = Vec::new();
    for line in output.lines().map(without_thread) {
        if let Some(path) = line.strip_prefix("Checking harness ") {
            let check = path.trim_end_matches('.').rsplit("::").next().unwrap_or(path).to_owned();
            let words = "ERROR: Kani did not end this harness".to_owned();
            found.push(Outcome { engine: Engine::Kani, check, verdict: Verdict::Failed, words, seconds: 0.0 });
            reasons.clear();
            continue;
        }
        let Some(open) = found.last_mut() else { continue };
        if let Some(reason) = line.strip_prefix("Failed Checks: ") {
            reasons.push(reason.trim().to_owned());
        } else if line.starts_with("VERIFICATION:- SUCCESSFUL") {
            (open.verdict, open.words) = (Verdict::Proved, "proved".into());
        } else if line.starts_with("VERIFICATION:- FAILED") {
            (open.verdict, open.words) = (Verdict::Failed, failure(&reasons));
        } else if let Some(time) = line.strip_prefix("Verification Time: ") {
            open.seconds = time.trim().trim_end_matches('s').parse().unwrap_or(0.0);
        }
    }
    found
}

/// Kani marks lines with their thread where it runs several harnesses at a time.
fn without_thread(line: &str) -> &str {
    let marked = line.strip_prefix("Thread ").and_then(|rest| rest.split_once(": "));
    marked.filter(|(number, _)| number.bytes().all(|digit| digit.is_ascii_digit())).map_or(line, |(_, rest)| rest)
}

fn failure(reasons: &[String]) -> String {
    match reasons.iter().find(|reason| !reason.starts_with("unwinding assertion")) {
        Some(reason) => format!("REFUTED: {reason}"),
        None if reasons.is_empty() => "ERROR: Kani failed without naming a check (out of memory or time?)".into(),
        None => "UNWIND: the bound is too small; nothing is refuted".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLE: &str = "\
Kani Rust Verifier 0.68.0 (cargo plugin)
Checking harness ring::on_kani::ring_push...

VERIFICATION RESULT:
 ** 0 of 39 failed (2 unreachable)

VERIFICATION:- SUCCESSFUL
Verification Time: 0.78389233s

Checking harness ring::on_kani::ring_apart...

VERIFICATION RESULT:
 ** 1 of 39 failed
Failed Checks: assertion failed: a != b
 File: \"src/ring.rs\", line 9, in ring::sides_are_apart

VERIFICATION:- FAILED
Verification Time: 1.5s

Checking harness frames::on_kani::frame_identity...
VERIFICATION RESULT:
 ** 1 of 39 failed (38 undetermined)
Failed Checks: unwinding assertion loop 0
VERIFICATION:- FAILED
[Kani] info: Verification output shows one or more unwinding failures.

Thread 1: Checking harness frames::on_kani::frame_any...
CBMC failed
VERIFICATION:- FAILED

Checking harness a::on_kani::cut_off...

Manual Harness Summary:
Complete - 1 successfully verified harnesses, 3 failures, 4 total.
";

    #[test]
    fn each_harness_has_the_result_that_kani_gave_it() {
        let told: Vec<(String, Verdict, String)> =
            results(SAMPLE).into_iter().map(|o| (o.check, o.verdict, o.words)).collect();
        let begins = |at: usize, name: &str, verdict, words: &str| {
            assert!(told[at].0 == name && told[at].1 == verdict && told[at].2.starts_with(words), "{:?}", told[at]);
        };
        assert_eq!(told.len(), 5);
        begins(0, "ring_push", Verdict::Proved, "proved");
        begins(1, "ring_apart", Verdict::Failed, "REFUTED: assertion failed: a != b");
        begins(2, "frame_identity", Verdict::Failed, "UNWIND");
        begins(3, "frame_any", Verdict::Failed, "ERROR");
        begins(4, "cut_off", Verdict::Failed, "ERROR");
        assert_eq!(results(SAMPLE)[1].seconds, 1.5);
    }
}
