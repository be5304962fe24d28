//! `cargo xtask campaign mutants`: how many one-line changes of the code the tests notice, crate by crate, and whether
//! CBMC refutes the mutants of the ledger.
//!
//! Invariant: a mutant that survives counts, unless `verification/equivalent-mutants.txt` names it with a reason.

use retrace_task_support::process;
use retrace_verify::Options;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

pub(crate) const PURPOSE: &str =
    "one-line changes of core, link, card and controller: how many the tests notice; the ledger's mutants under CBMC";

/// Mutants that change nothing that could be observed, each with the reason.
const EQUIVALENT: &str = "verification/equivalent-mutants.txt";
/// The figures of a run. Those that are to stay go into `docs/mutants.md`, with how they came about.
const PAGE: &str = "target/mutants.md";
/// Parts of which a run without `--full` tries one: every fifteenth mutant.
const PARTS: u64 = 15;
/// Least time limit of the tests on one mutant, in seconds: it may run for ever. Otherwise the limit is five times what
/// the tests take without a mutant. A short limit takes a busy machine for a mutant that is noticed.
const LEAST_TEST_LIMIT: &str = "120";

/// The package that runs every property natively in its tests.
const PROPERTIES: &str = "retrace-verification";

/// A crate, or some of its files, and the tests that must notice a change.
struct Target {
    name: &'static str,
    files: &'static [&'static str],
    /// The package of the files, whose tests are run on every mutant.
    tests: &'static str,
    /// The package whose tests are run on those that the first did not notice.
    more_tests: Option<&'static str>,
    /// Least share of the mutants that must be noticed, in percent.
    floor: Option<f64>,
}

const TARGETS: [Target; 4] = [
    Target {
        name: "core",
        files: &["crates/core/src/**"],
        tests: "retrace-core",
        more_tests: Some(PROPERTIES),
        floor: Some(95.0),
    },
    Target {
        name: "link",
        files: &["crates/link/src/**"],
        tests: "retrace-link",
        more_tests: Some(PROPERTIES),
        floor: Some(95.0),
    },
    Target {
        name: "card",
        files: &["crates/card/src/**"],
        tests: "retrace-card",
        more_tests: Some(PROPERTIES),
        floor: Some(90.0),
    },
    Target {
        name: "controller",
        files: &[
            "crates/controller/src/session/**",
            "crates/controller/src/record_streamer.rs",
            "crates/controller/src/record_streamer/**",
            "crates/controller/src/resume.rs",
        ],
        tests: "retrace-controller",
        more_tests: None,
        floor: None,
    },
];

/// Result of one target.
struct Score {
    name: &'static str,
    noticed: usize,
    /// Mutants that no test noticed and that are not listed as equivalent.
    survivors: Vec<String>,
    equivalent: usize,
    /// Changes that did not compile.
    unviable: usize,
    seconds: u64,
    floor: Option<f64>,
    /// Mutants that the crate's own tests miss and that the second stage was not run on; they count as survivors.
    untried: usize,
}

impl Score {
    fn percent(&self) -> f64 {
        100.0 * self.noticed as f64 / (self.noticed + self.survivors.len()).max(1) as f64
    }

    fn passes(&self) -> bool {
        self.floor.is_none_or(|floor| self.percent() >= floor)
    }
}

/// Runs the campaign and returns whether it passed. Without `full` it tries one part in [`PARTS`] of the mutants.
///
/// With [`Reuse::Resume`], what an earlier run of the same sample has completed is not run again; with
/// [`Reuse::PageOnly`] nothing is run.
pub(crate) fn run(root: &Path, full: bool, seed: u64, reuse: Reuse) -> bool {
    let has_tool = Command::new("cargo").args(["mutants", "--version"]).output().is_ok_and(|out| out.status.success());
    if !has_tool {
        println!("NOT RUN  cargo-mutants: missing; to get it: cargo install --locked cargo-mutants");
    }
    let equivalent = std::fs::read_to_string(root.join(EQUIVALENT)).unwrap_or_default();
    let mut scores = Vec::new();
    for target in TARGETS.iter().filter(|_| has_tool) {
        match score(root, target, &Sample { full, seed, reuse }, &equivalent) {
            Ok(score) => scores.push(score),
            Err(reason) if reuse == Reuse::PageOnly => println!("NOT RUN  {}: {reason}", target.name),
            Err(reason) => {
                eprintln!("xtask: {}: {reason}", target.name);
                return false;
            }
        }
        // after every crate, so that a run that is ended early leaves what it has found
        if let Err(error) = std::fs::write(root.join(PAGE), page(&scores, full, seed)) {
            eprintln!("xtask: {PAGE}: {error}");
            return false;
        }
    }
    print!("{}", table(&scores));
    let has_refuted = !full || by_cbmc(root);
    if !full {
        println!("NOT RUN  cbmc-mutants: with --full only");
    }
    has_tool && has_refuted && scores.iter().all(Score::passes)
}

/// Every mutant of the ledger whose killer is a harness, refuted by CBMC; the result is written to the ledger.
fn by_cbmc(root: &Path) -> bool {
    let options = Options::read(&["--engine", "cbmc-mutants", "--update"]);
    match options.and_then(|options| retrace_verify::run(root, &options)) {
        Ok(summary) => summary.passed,
        Err(reason) => {
            eprintln!("xtask: {reason}");
            false
        }
    }
}

/// What is done with the results of an earlier run of the same sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reuse {
    /// They are replaced.
    Nothing,
    /// What is complete is not run again.
    Resume,
    /// The page is written from what is complete, and nothing is run.
    PageOnly,
}

/// Which mutants are tried.
#[derive(Clone, Copy, Debug)]
struct Sample {
    full: bool,
    seed: u64,
    reuse: Reuse,
}

impl Sample {
    fn part(self) -> u64 {
        self.seed % PARTS
    }

    /// The folder of its results, in the target folder.
    fn folder(self) -> String {
        if self.full { "full".to_owned() } else { format!("part-{}", self.part()) }
    }
}

fn score(root: &Path, target: &Target, sample: &Sample, equivalent: &str) -> Result<Score, String> {
    println!("campaign mutants: {}", target.name);
    let started = Instant::now();
    let shard = format!("{}/{PARTS}", sample.part());
    let selection = match sample.full {
        true => Vec::new(),
        false => ["--sharding", "round-robin", "--shard", &shard].map(str::to_owned).into(),
    };
    let files: Vec<&str> = target.files.to_vec();
    let own = outcomes(root, target, target.tests, sample, &files, &selection)?;
    let missed: Vec<String> = names(&own, "MissedMutant").map(str::to_owned).collect();
    let mut noticed_later = Value::Null;
    if let (Some(package), false) = (target.more_tests, missed.is_empty()) {
        let selection = missed.iter().flat_map(|name| ["--re".to_owned(), format!("^{}$", escaped(name))]);
        // cargo-mutants 27 tries every deleted field of a file, whatever the expressions select
        let files: BTreeSet<&str> = missed.iter().filter_map(|name| name.split(':').next()).collect();
        let files: Vec<&str> = files.into_iter().collect();
        match outcomes(root, target, package, sample, &files, &selection.collect::<Vec<_>>()) {
            Ok(outcomes) => noticed_later = outcomes,
            Err(_) if sample.reuse == Reuse::PageOnly => {}
            Err(reason) => return Err(reason),
        }
    }
    let mut score = read_score(target, &own, &noticed_later, equivalent);
    let tried = |name: &String| {
        let outcomes = noticed_later["outcomes"].as_array().map_or(&[][..], Vec::as_slice);
        outcomes.iter().any(|outcome| outcome["scenario"]["Mutant"]["name"] == name.as_str())
    };
    score.untried = if target.more_tests.is_some() { missed.iter().filter(|name| !tried(name)).count() } else { 0 };
    if sample.reuse == Reuse::Nothing {
        score.seconds = started.elapsed().as_secs();
    }
    Ok(score)
}

/// Runs the tests of `package` on the selected mutants of these files of a target.
fn outcomes(
    root: &Path,
    target: &Target,
    package: &str,
    sample: &Sample,
    files: &[&str],
    selection: &[String],
) -> Result<Value, String> {
    let output = root.join("target/mutants-campaign").join(sample.folder()).join(target.name).join(package);
    match (sample.reuse, completed(&output)) {
        (Reuse::Nothing, _) | (Reuse::Resume, Err(_)) => {}
        (_, completed) => return completed,
    }
    std::fs::create_dir_all(&output).map_err(|error| format!("{}: {error}", output.display()))?;
    let mut command = process::cargo(root, &["mutants", "--no-shuffle", "--colors", "never"]);
    command.args(["--minimum-test-timeout", LEAST_TEST_LIMIT]);
    command.arg("--output").arg(&output).args(files.iter().flat_map(|file| ["--file", *file]));
    command
        .args(["--package", target.tests, "--test-package", package])
        .args(selection)
        .args(["--", "--lib", "--tests"]);
    let status = command.status().map_err(|error| format!("cargo mutants cannot be run: {error}"))?;
    // 2: some survive; 3: a test timed out
    if !matches!(status.code(), Some(0 | 2 | 3)) {
        return Err(format!("cargo mutants: {status}; see {}", output.display()));
    }
    completed(&output)
}

/// The outcomes of a run of cargo-mutants that was not interrupted.
fn completed(output: &Path) -> Result<Value, String> {
    let text = std::fs::read_to_string(output.join("mutants.out/outcomes.json")).map_err(|error| error.to_string())?;
    let outcomes: Value = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    if outcomes["end_time"].is_string() { Ok(outcomes) } else { Err(format!("{}: not complete", output.display())) }
}

/// The mutants with that outcome.
fn names<'a>(outcomes: &'a Value, summary: &'static str) -> impl Iterator<Item = &'a str> {
    let outcomes = outcomes["outcomes"].as_array().map_or(&[][..], Vec::as_slice);
    let matching = outcomes.iter().filter(move |outcome| outcome["summary"] == summary);
    matching.filter_map(|outcome| outcome["scenario"]["Mutant"]["name"].as_str())
}

/// A text as a regular expression that matches it alone.
fn escaped(text: &str) -> String {
    text.chars()
        .flat_map(|letter| "\\.+*?()|[]{}^$#&-~/".contains(letter).then_some('\\').into_iter().chain([letter]))
        .collect()
}

/// Reads the outcomes of a crate's own tests, and of more tests on those that they did not notice. A mutant counts
/// once, and only what the own tests were tried on counts.
fn read_score(target: &Target, own: &Value, more: &Value, equivalent: &str) -> Score {
    let listed: BTreeMap<&str, &str> = equivalent.lines().filter_map(|line| line.split_once(" -- ")).collect();
    let noticed_later: BTreeSet<&str> = names(more, "CaughtMutant").chain(names(more, "Timeout")).collect();
    let (noticed, missed) = names(own, "MissedMutant").partition::<Vec<_>, _>(|mutant| noticed_later.contains(mutant));
    let (equivalent, survivors) =
        missed.into_iter().map(without_place).partition::<Vec<_>, _>(|mutant| listed.contains_key(mutant.as_str()));
    Score {
        name: target.name,
        noticed: names(own, "CaughtMutant").count() + names(own, "Timeout").count() + noticed.len(),
        survivors,
        equivalent: equivalent.len(),
        unviable: names(own, "Unviable").count(),
        seconds: 0,
        floor: target.floor,
        untried: 0,
    }
}

/// The name of a mutant without line and column, which change with every edit of the file.
fn without_place(name: &str) -> String {
    let mut parts = name.splitn(4, ':');
    match (parts.next(), parts.next(), parts.next(), parts.next()) {
        (Some(file), Some(_), Some(_), Some(what)) => format!("{file}:{what}"),
        _ => name.to_owned(),
    }
}

fn table(scores: &[Score]) -> String {
    let mut text = String::from("| crate | noticed | of | score | floor | equivalent | not compiled | minutes |\n");
    text += "|---|---|---|---|---|---|---|---|\n";
    for score in scores {
        let floor = score.floor.map_or("-".to_owned(), |floor| format!("{floor:.0} %"));
        // writing to a string cannot fail
        let _ = writeln!(
            text,
            "| {}{} | {} | {} | {:.1} % | {floor} | {} | {} | {} |",
            score.name,
            if score.untried == 0 { String::new() } else { format!(", properties not run on {}", score.untried) },
            score.noticed,
            score.noticed + score.survivors.len(),
            score.percent(),
            score.equivalent,
            score.unviable,
            if score.seconds == 0 { "-".to_owned() } else { (score.seconds / 60).to_string() }
        );
    }
    for target in TARGETS.iter().filter(|target| scores.iter().all(|score| score.name != target.name)) {
        let _ = writeln!(text, "| {} | NOT RUN | - | - | - | - | - | - |", target.name);
    }
    if scores.iter().any(|score| !score.survivors.is_empty()) {
        text += "\nSurvivors; *open* means that no test notices the change and no reason is known why none could:\n\n";
    }
    for survivor in scores.iter().flat_map(|score| &score.survivors) {
        let _ = writeln!(text, "- open: {survivor}");
    }
    text
}

fn page(scores: &[Score], full: bool, seed: u64) -> String {
    let (option, sample) = match full {
        true => (" --full", String::new()),
        false => ("", format!(" This is a sample: one mutant in {PARTS} of each crate, chosen by the seed.")),
    };
    format!(
        "# Mutation score\n\nWritten by `cargo xtask campaign mutants{option} --seed {seed}`.{sample} A mutant is one \
         small change of the code that cargo-mutants makes; it is noticed where a test of the crate, or a property of \
         `verification/` in a native run, fails or does not end. Equivalent mutants are listed with their reasons in \
         `{EQUIVALENT}`.\n\n{}",
        table(scores)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_survivor_counts_unless_it_is_listed_with_a_reason() {
        let outcome = |summary: &str, name: &str| json!({"summary": summary, "scenario": {"Mutant": {"name": name}}});
        let outcomes = json!({"outcomes": [
            json!({"summary": "Success", "scenario": "Baseline"}),
            outcome("CaughtMutant", "a.rs:1:2: replace + with - in f"),
            outcome("Timeout", "a.rs:2:2: replace + with * in f"),
            outcome("MissedMutant", "a.rs:3:2: replace < with <= in f"),
            outcome("MissedMutant", "a.rs:4:2: replace > with >= in g"),
            outcome("Unviable", "a.rs:5:2: replace g with Default::default()"),
        ]});
        let listed = "# comment\na.rs: replace < with <= in f -- both ends are equal there\n";
        let score = read_score(&TARGETS[0], &outcomes, &Value::Null, listed);
        assert_eq!((score.noticed, score.equivalent, score.unviable), (2, 1, 1));
        assert_eq!(score.survivors, ["a.rs: replace > with >= in g"]);
        assert_eq!(escaped("a/b.rs:1:2: replace f -> [T; 2]"), "a\\/b\\.rs:1:2: replace f \\-> \\[T; 2\\]");
        let more = json!({"outcomes": [
            outcome("CaughtMutant", "a.rs:4:2: replace > with >= in g"),
            outcome("CaughtMutant", "b.rs:7:2: delete field of another sample"),
        ]});
        let later = read_score(&TARGETS[0], &outcomes, &more, listed);
        assert!(later.noticed == 3 && later.survivors.is_empty() && later.equivalent == 1, "each counts once");
        assert!(score.percent() > 66.0 && score.percent() < 67.0 && !score.passes());
        assert!(table(&[score]).contains("| core | 2 | 3 | 66.7 % | 95 % | 1 | 1 | - |\n"));
    }
}
