//! The ledger: results of a run, as JSON, and the comparison of the committed one with the code.
//!
//! Invariant: the committed ledger is written by a full run alone; every other run only compares its rows with those of
//! the code.

use super::outcome::{Engine, Outcome, Verdict};
use super::rows::Row;
use super::{Job, NotRun, cbmc, page, table};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

/// The committed ledger, for people and for machines.
const PAGE: &str = "verification/LEDGER.md";
const BOOK: &str = "verification/ledger.json";
/// The command that brings them up to date.
const REWRITE: &str = "cargo xtask verify";

/// The fields of a row that come from the code.
const FROM_CODE: [&str; 10] =
    ["name", "says", "requirement", "bound", "assumes", "suffices", "harnesses", "searches", "models", "mutants"];

/// Time limit of the CBMC proofs of a quick run together, one after the other, in seconds by the committed ledger.
const CHEAP: f64 = 80.0;

/// Results of a run.
pub(crate) fn of_run(
    job: &Job<'_>,
    outcomes: &[Outcome],
    absent: &[NotRun],
    versions: &[(String, String)],
    seconds: f64,
) -> Value {
    let rows: Vec<Value> = job.rows.iter().map(|row| row_of(row, outcomes)).collect();
    let not_run: Vec<Value> = absent
        .iter()
        .map(|absent| json!({"engine": absent.engine.name(), "why": absent.why, "how": absent.how}))
        .collect();
    let tools: Vec<Value> = versions.iter().map(|(name, version)| json!({"name": name, "version": version})).collect();
    let whole = outcomes.iter().filter(|outcome| outcome.check.is_empty() || outcome.engine == Engine::Stub);
    json!({
        "commit": commit(job.root),
        "date": today(),
        "quick": job.quick,
        "cbmc_means": cbmc::MEANING,
        "tools": tools,
        "not_run": not_run,
        "seconds": tenths(seconds),
        "other_results": whole.map(result_of).collect::<Vec<_>>(),
        "rows": rows,
    })
}

fn row_of(row: &Row, outcomes: &[Outcome]) -> Value {
    let mut own: Vec<&Outcome> = outcomes.iter().filter(|outcome| row.owns(&outcome.check)).collect();
    // in the code's order, whichever ended first
    own.sort_by_key(|outcome| (outcome.engine, row.place(&outcome.check)));
    let mut fields = row.fields.clone();
    let of = |engine| own.iter().filter(move |outcome| outcome.engine == engine);
    let killed = |engine| of(engine).filter(|outcome| outcome.verdict == Verdict::Passed).count();
    fields["status"] = json!(status(row, &own));
    fields["seconds"] = json!(tenths(own.iter().map(|outcome| outcome.seconds).sum()));
    fields["mutants_killed"] = json!(killed(Engine::Mutants));
    fields["mutants_run"] = json!(of(Engine::Mutants).count());
    fields["mutants_refuted_by_cbmc"] = json!(killed(Engine::CbmcMutants));
    fields["mutants_run_by_cbmc"] = json!(of(Engine::CbmcMutants).count());
    fields["results"] = own.iter().map(|outcome| result_of(outcome)).collect();
    fields
}

fn result_of(outcome: &Outcome) -> Value {
    json!({
        "engine": outcome.engine.name(),
        "check": outcome.check,
        "verdict": outcome.verdict.name(),
        "words": outcome.words,
        "seconds": tenths(outcome.seconds),
    })
}

/// Status of a row after this run.
fn status(row: &Row, own: &[&Outcome]) -> String {
    if own.iter().any(|outcome| outcome.verdict == Verdict::Failed) {
        return "FAILED".to_owned();
    }
    let proved_by = |engine: Engine| {
        let proved = own.iter().filter(|o| o.engine == engine && o.verdict == Verdict::Proved).count();
        (proved, table::size(row, engine))
    };
    let of_harnesses = row.harnesses.len();
    let whole: Vec<&str> = [(Engine::Cbmc, "CBMC"), (Engine::Kani, "Kani")]
        .into_iter()
        .filter(|(engine, _)| of_harnesses > 0 && proved_by(*engine).0 == of_harnesses)
        .map(|(_, name)| name)
        .collect();
    let ran = |engine: Engine| own.iter().any(|outcome| outcome.engine == engine);
    let others: Vec<&str> = [(Engine::Native, "native"), (Engine::Loom, "loom"), (Engine::Shuttle, "shuttle")]
        .into_iter()
        .filter(|(engine, _)| {
            ran(*engine) && (whole.is_empty() || *engine != Engine::Native || !row.searches.is_empty())
        })
        .map(|(_, name)| name)
        .collect();
    let some = proved_by(Engine::Cbmc).0.max(proved_by(Engine::Kani).0);
    let mut parts = Vec::new();
    if !whole.is_empty() {
        parts.push(format!("proved ({})", whole.join(", ")));
    } else if some > 0 {
        parts.push(format!("{some} of {of_harnesses} harnesses proved"));
    }
    if !others.is_empty() {
        parts.push(format!("passed ({})", others.join(", ")));
    }
    if parts.is_empty() { "NOT RUN".to_owned() } else { parts.join(", ") }
}

/// Writes the ledger of this run, and returns whether the committed one still matches the code.
pub(crate) fn keep(job: &Job<'_>, all: &[Row], book: &Value, is_full: bool) -> bool {
    let folder = job.folder.clone();
    let [page_path, book_path] = if is_full {
        [PAGE, BOOK].map(|path| job.root.join(path))
    } else {
        [PAGE, BOOK].map(|path| folder.join(name(path)))
    };
    let text = serde_json::to_string_pretty(book).unwrap_or_default() + "\n";
    let written = fs::write(&book_path, text).and_then(|()| fs::write(&page_path, page::render(book)));
    if let Err(error) = written {
        println!("verify: ERROR: the ledger cannot be written: {error}");
        return false;
    }
    println!("verify: wrote {} and {}", shown(job.root, &page_path), shown(job.root, &book_path));
    if is_full {
        return true;
    }
    let differences = compare(job.root, all);
    for difference in &differences {
        println!("verify: FAILED: {BOOK} and the code differ: {difference}");
    }
    if !differences.is_empty() {
        println!("verify: `{REWRITE}` (the full run) brings {BOOK} and {PAGE} up to date");
    }
    differences.is_empty()
}

fn name(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

fn shown(root: &Path, path: &Path) -> String {
    path.strip_prefix(root).unwrap_or(path).display().to_string()
}

fn read(root: &Path) -> Option<Value> {
    serde_json::from_str(&fs::read_to_string(root.join(BOOK)).ok()?).ok()
}

fn compare(root: &Path, all: &[Row]) -> Vec<String> {
    let Some(book) = read(root) else { return vec!["the ledger cannot be read".to_owned()] };
    let mut differences = differences(&book, all);
    if fs::read_to_string(root.join(PAGE)).ok() != Some(page::render(&book)) {
        differences.push(format!("{PAGE} differs from {BOOK}"));
    }
    differences
}

fn differences(book: &Value, all: &[Row]) -> Vec<String> {
    let empty = Vec::new();
    let kept = book["rows"].as_array().unwrap_or(&empty);
    let mut found = Vec::new();
    for row in all {
        match kept.iter().find(|kept| kept["name"] == row.fields["name"]) {
            None => found.push(format!("row {} is in the code alone", row.name)),
            Some(kept) => {
                let other = FROM_CODE.into_iter().filter(|field| kept[*field] != row.fields[*field]);
                found.extend(other.map(|field| format!("row {}: {field}", row.name)));
            }
        }
    }
    let is_gone = |kept: &&Value| all.iter().all(|row| row.fields["name"] != kept["name"]);
    found.extend(kept.iter().filter(is_gone).map(|kept| format!("row {} is in the ledger alone", kept["name"])));
    found
}

/// The harnesses that CBMC proves in a quick run: the cheapest by the committed ledger, as far as the time goes.
/// `None` where there is no ledger.
pub(crate) fn cheap(root: &Path) -> Option<BTreeSet<String>> {
    read(root).map(|book| cheapest(&book))
}

fn cheapest(book: &Value) -> BTreeSet<String> {
    let rows = book["rows"].as_array().into_iter().flatten();
    let results = rows.flat_map(|row| row["results"].as_array().into_iter().flatten());
    let mut proofs: Vec<(f64, &str)> = results
        .filter(|result| result["engine"] == "cbmc" && result["verdict"] == "proved")
        .filter_map(|result| Some((result["seconds"].as_f64()?, result["check"].as_str()?)))
        .collect();
    proofs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(b.1)));
    let mut sum = 0.0;
    let within = proofs.into_iter().take_while(|(seconds, _)| {
        sum += seconds;
        sum <= CHEAP
    });
    within.map(|(_, check)| check.to_owned()).collect()
}

/// The commit, and whether the checkout differs from it. The ledger itself does not count: the run writes it.
fn commit(root: &Path) -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).current_dir(root).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    let head = git(&["rev-parse", "--short", "HEAD"]).unwrap_or_else(|| "unknown".into());
    let changes = git(&["status", "--porcelain", "--", ".", ":!verification/LEDGER.md", ":!verification/ledger.json"]);
    if changes.is_none_or(|changes| !changes.is_empty()) {
        format!("{head} and changes that are not committed")
    } else {
        head
    }
}

fn tenths(seconds: f64) -> f64 {
    // a sum of nothing is −0
    (seconds * 10.0).round() / 10.0 + 0.0
}

fn today() -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    date(seconds / 86_400)
}

/// The date of a day counted from 1970-01-01, year-month-day (Gregorian).
fn date(day: u64) -> String {
    let is_leap = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    let (mut year, mut left) = (1970, day);
    while left >= 365 + u64::from(is_leap(year)) {
        left -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let february = 28 + u64::from(is_leap(year));
    let mut month = 1;
    for days in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30] {
        if left < days {
            break;
        }
        left -= days;
        month += 1;
    }
    format!("{year}-{month:02}-{:02}", left + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::tests::sample;

    fn outcome(engine: Engine, check: &str, verdict: Verdict) -> Outcome {
        Outcome { engine, check: check.into(), verdict, words: "w".into(), seconds: 1.25 }
    }

    #[test]
    fn a_row_is_called_proved_only_where_every_harness_was_in_this_run() {
        let row = sample();
        let called = |outcomes: &[Outcome]| status(&row, &outcomes.iter().collect::<Vec<_>>());
        assert_eq!(called(&[]), "NOT RUN");
        let native = outcome(Engine::Native, "h", Verdict::Passed);
        assert_eq!(called(std::slice::from_ref(&native)), "passed (native)");
        let cbmc = outcome(Engine::Cbmc, "h", Verdict::Proved);
        assert_eq!(called(&[native.clone(), cbmc.clone()]), "proved (CBMC), passed (native)");
        assert_eq!(called(&[native.clone(), outcome(Engine::Cbmc, "h", Verdict::Open)]), "passed (native)");
        assert_eq!(called(&[cbmc, native, outcome(Engine::Mutants, "x", Verdict::Failed)]), "FAILED");
    }

    #[test]
    fn every_difference_between_ledger_and_code_is_told() {
        let row = sample();
        let book = json!({"rows": [row_of(&row, &[])]});
        assert!(differences(&book, std::slice::from_ref(&row)).is_empty());
        let mut other = row.clone();
        other.fields["harnesses"][0]["unwind"] = json!(4);
        assert_eq!(differences(&book, &[other]), ["row a-row: harnesses"]);
        let mut new = row.clone();
        (new.name, new.fields["name"]) = ("b".into(), json!("b"));
        assert_eq!(differences(&book, &[row, new]), ["row b is in the code alone"]);
        assert_eq!(differences(&book, &[]), ["row \"a-row\" is in the ledger alone"]);
    }

    #[test]
    fn a_quick_run_proves_what_was_cheap() {
        let result = |check: &str, seconds: f64| {
            json!({"engine": "cbmc", "check": check, "verdict": "proved",
            "seconds": seconds})
        };
        let book =
            json!({"rows": [{"results": [result("a", 79.0), result("b", 0.5)]}, {"results": [result("c", 0.5)]}]});
        assert_eq!(cheapest(&book), BTreeSet::from(["a".into(), "b".into(), "c".into()]));
        let book = json!({"rows": [{"results": [result("a", 79.5), result("b", 0.5), result("c", 0.5)]}]});
        assert_eq!(cheapest(&book), BTreeSet::from(["b".into(), "c".into()]));
    }

    #[test]
    fn days_have_their_dates() {
        assert_eq!(
            [0, 59, 11_016, 19_782, 20_818].map(date),
            ["1970-01-01", "1970-03-01", "2000-02-29", "2024-02-29", "2026-12-31"]
        );
    }
}
