//! Kani over the harnesses in its list.
//!
//! Invariant: a harness is called proved only where Kani reported success for it by name.

use super::Job;
use super::outcome::{Engine, Outcome, Verdict};
use super::rows::Harness;
use retrace_task_support::process;
use std::time::Duration;

/// Time limit of all of Kani's harnesses together.
const LIMIT: Duration = Duration::from_secs(10_800);
/// Time limit of each harness, after which Kani reports it and goes on with the next.
const HARNESS_LIMIT: &str = "600s";

/// Runs `cargo kani`, which the caller knows to be set up.
pub(crate) fn run(job: &Job<'_>) {
    let harnesses: Vec<&Harness> = job.rows.iter().flat_map(|row| &row.harnesses).collect();
    if harnesses.is_empty() {
        return;
    }
    let mut command = process::cargo(job.root, &["kani", "--package", "retrace-verification", "--lib"]);
    command
        .args(["-Z", "unstable-options", "--harness-timeout", HARNESS_LIMIT])
        .env("CARGO_TARGET_DIR", job.folder.join("kani"));
    if job.is_slice {
        for harness in &harnesses {
            command.args(["--harness", &harness.name]);
        }
    }
    let ended = match process::run(&mut command, LIMIT, &job.folder.join("kani")) {
        Ok(ended) => ended,
        Err(reason) => return job.log.broken(Engine::Kani, reason),
    };
    let results = results(&ended.output);
    for harness in harnesses {
        let outcome = results.iter().find(|result| result.outcome.check == harness.name).map_or_else(
            || {
                let words = format!("ERROR: Kani reported nothing; {}", ended.last_words());
                Outcome {
                    engine: Engine::Kani,
                    check: harness.name.clone(),
                    verdict: Verdict::Failed,
                    words,
                    seconds: 0.0,
                }
            },
            |result| result.judged(harness.covers.len()),
        );
        job.log.tell(outcome);
    }
}

/// Kani's result of one harness.
struct HarnessResult {
    outcome: Outcome,
    /// Cover properties that are satisfied, of how many.
    covers: (usize, usize),
}

impl HarnessResult {
    /// A harness with a region that no run reaches is not proved. Kani itself calls it successful.
    fn judged(&self, listed: usize) -> Outcome {
        let mut outcome = self.outcome.clone();
        let (satisfied, all) = self.covers;
        if outcome.verdict == Verdict::Proved && (satisfied < all || all < listed) {
            let words = format!("VACUOUS: {satisfied} of {all} regions are reached, {listed} are listed");
            (outcome.verdict, outcome.words) = (Verdict::Failed, words);
        }
        outcome
    }
}

/// Results of the harnesses in Kani's terse output.
fn results(output: &str) -> Vec<HarnessResult> {
    let mut found: Vec<HarnessResult> = Vec::new();
    let mut reasons: Vec<String> = Vec::new();
    for line in output.lines().map(without_thread) {
        if let Some(path) = line.strip_prefix("Checking harness ") {
            let check = path.trim_end_matches('.').rsplit("::").next().unwrap_or(path).to_owned();
            let words = "ERROR: Kani did not end this harness".to_owned();
            let outcome = Outcome { engine: Engine::Kani, check, verdict: Verdict::Failed, words, seconds: 0.0 };
            found.push(HarnessResult { outcome, covers: (0, 0) });
            reasons.clear();
            continue;
        }
        let Some(HarnessResult { outcome, covers }) = found.last_mut() else { continue };
        if let Some(reason) = line.strip_prefix("Failed Checks: ") {
            reasons.push(reason.trim().to_owned());
        } else if line.contains("timed out") {
            reasons.push("timed out".to_owned());
        } else if let Some(counted) = covered(line) {
            *covers = counted;
        } else if line.starts_with("VERIFICATION:- SUCCESSFUL") {
            (outcome.verdict, outcome.words) = (Verdict::Proved, "proved".into());
        } else if line.starts_with("VERIFICATION:- FAILED") {
            (outcome.verdict, outcome.words) = (Verdict::Failed, failure(&reasons));
        } else if let Some(time) = line.strip_prefix("Verification Time: ") {
            outcome.seconds = time.trim().trim_end_matches('s').parse().unwrap_or(0.0);
        }
    }
    found
}

/// Numbers of a line ` ** 2 of 3 cover properties satisfied (1 unreachable)`.
fn covered(line: &str) -> Option<(usize, usize)> {
    let (counts, _) = line.trim().strip_prefix("** ")?.split_once(" cover properties satisfied")?;
    let (satisfied, all) = counts.split_once(" of ")?;
    Some((satisfied.parse().ok()?, all.parse().ok()?))
}

/// Kani marks lines with their thread where it runs several harnesses at a time.
fn without_thread(line: &str) -> &str {
    let marked = line.strip_prefix("Thread ").and_then(|rest| rest.split_once(": "));
    marked.filter(|(number, _)| number.bytes().all(|digit| digit.is_ascii_digit())).map_or(line, |(_, rest)| rest)
}

fn failure(reasons: &[String]) -> String {
    if reasons.iter().any(|reason| reason == "timed out") {
        return format!("TIME: not ended after {HARNESS_LIMIT}");
    }
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

 ** 4 of 4 cover properties satisfied

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

Thread 1: Checking harness rate::on_kani::too_slow...
CBMC failed with status 143
CBMC timed out. You may want to rerun your proof with a larger timeout or use stubbing to reduce the size of the code.
VERIFICATION:- FAILED

Checking harness rate::on_kani::without_a_region...
 ** 0 of 9 failed
 ** 1 of 2 cover properties satisfied (1 unreachable)
VERIFICATION:- SUCCESSFUL

Checking harness a::on_kani::cut_off...

Manual Harness Summary:
Complete - 1 successfully verified harnesses, 3 failures, 4 total.
";

    #[test]
    fn each_harness_has_the_result_that_kani_gave_it() {
        let told: Vec<(String, Verdict, String)> =
            results(SAMPLE).iter().map(|result| result.judged(2)).map(|o| (o.check, o.verdict, o.words)).collect();
        let begins = |at: usize, name: &str, verdict, words: &str| {
            assert!(told[at].0 == name && told[at].1 == verdict && told[at].2.starts_with(words), "{:?}", told[at]);
        };
        assert_eq!(told.len(), 7);
        begins(0, "ring_push", Verdict::Proved, "proved");
        begins(1, "ring_apart", Verdict::Failed, "REFUTED: assertion failed: a != b");
        begins(2, "frame_identity", Verdict::Failed, "UNWIND");
        begins(3, "frame_any", Verdict::Failed, "ERROR");
        begins(4, "too_slow", Verdict::Failed, "TIME");
        begins(5, "without_a_region", Verdict::Failed, "VACUOUS: 1 of 2");
        begins(6, "cut_off", Verdict::Failed, "ERROR");
        assert_eq!(results(SAMPLE)[1].outcome.seconds, 1.5);
        assert_eq!(results(SAMPLE)[0].judged(5).verdict, Verdict::Failed, "a region that Kani does not see");
    }
}
