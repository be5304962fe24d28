//! The ledger: results of a run, as JSON, and the comparison of the committed one with the code.
//!
//! Invariant: the committed ledger is written by a full run, or row by row with `--update`; each row has the hash of
//! the sources that its results are of. Every other run only compares.

use super::outcome::{Engine, Outcome};
use super::rows::Row;
use super::{Job, NotRun, Options, cbmc, page, sources, status};
use retrace_task_support::tree::Tree;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
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
const FROM_CODE: [&str; 11] = [
    "name",
    "module",
    "says",
    "requirement",
    "bound",
    "assumes",
    "suffices",
    "harnesses",
    "searches",
    "models",
    "mutants",
];

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
    let (tree, commit) = (Tree::read(job.root).unwrap_or_default(), commit(job.root));
    let rows: Vec<Value> =
        job.rows.iter().map(|row| row_of(row, outcomes, &sources::hash(&tree, row), &commit)).collect();
    let not_run: Vec<Value> = absent
        .iter()
        .map(|absent| json!({"engine": absent.engine.name(), "why": absent.why, "how": absent.how}))
        .collect();
    let tools: Vec<Value> = versions.iter().map(|(name, version)| json!({"name": name, "version": version})).collect();
    let of_none = |engine| matches!(engine, Engine::Stub | Engine::Miri | Engine::Tsan);
    let whole = outcomes.iter().filter(|outcome| outcome.check.is_empty() || of_none(outcome.engine));
    json!({
        "commit": commit,
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

fn row_of(row: &Row, outcomes: &[Outcome], sources: &str, commit: &str) -> Value {
    let mut own: Vec<&Outcome> = outcomes.iter().filter(|outcome| row.owns(&outcome.check)).collect();
    // in the code's order, whichever ended first
    own.sort_by_key(|outcome| (outcome.engine, row.place(&outcome.check)));
    let mut fields = row.fields.clone();
    fields["sources"] = json!(sources);
    fields["commit"] = json!(commit);
    fields["results"] = own.iter().map(|outcome| result_of(outcome)).collect();
    with_status(fields)
}

/// A row with the status and the time of its results.
fn with_status(mut fields: Value) -> Value {
    let results = fields["results"].as_array().map_or(&[][..], Vec::as_slice);
    let seconds = results.iter().filter_map(|result| result["seconds"].as_f64()).sum();
    fields["seconds"] = json!(tenths(seconds));
    fields["status"] = json!(status::of_row(&fields));
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

/// Writes the ledger of this run, and returns whether the committed one matches the code.
pub(crate) fn keep(job: &Job<'_>, all: &[Row], book: &Value, options: &Options) -> bool {
    let folder = job.folder.clone();
    let writes = options.is_full() || options.update;
    let [page_path, book_path] = if writes {
        [PAGE, BOOK].map(|path| job.root.join(path))
    } else {
        [PAGE, BOOK].map(|path| folder.join(name(path)))
    };
    let merged = if writes { merge(read(job.root).as_ref(), book, all, options.is_full()) } else { book.clone() };
    let text = serde_json::to_string_pretty(&merged).unwrap_or_default() + "\n";
    let written = fs::write(&book_path, text).and_then(|()| fs::write(&page_path, page::render(&merged)));
    if let Err(error) = written {
        println!("verify: ERROR: the ledger cannot be written: {error}");
        return false;
    }
    println!("verify: wrote {} and {}", shown(job.root, &page_path), shown(job.root, &book_path));
    let differences = compare(job.root, all);
    for difference in &differences {
        println!("verify: FAILED: {BOOK} and the code differ: {difference}");
    }
    if !differences.is_empty() {
        println!("verify: `{REWRITE}` (the full run), or `{REWRITE} --row NAME --update`, brings them up to date");
    }
    differences.is_empty()
}

/// The committed ledger with the rows of this run in it. A result of an engine that did not run now stays where the
/// sources are the same.
fn merge(committed: Option<&Value>, book: &Value, all: &[Row], is_full: bool) -> Value {
    let mut merged = if is_full { book.clone() } else { committed.unwrap_or(book).clone() };
    merged["other_results"] = with_older(&book["other_results"], &merged["other_results"]);
    let rows = all.iter().map(|row| {
        let of = |book: Option<&Value>| {
            let rows = book.and_then(|book| book["rows"].as_array()).map_or(&[][..], Vec::as_slice);
            rows.iter().find(|other| other["name"] == row.fields["name"]).cloned()
        };
        match (of(Some(book)), of(committed)) {
            (Some(new), Some(old)) if old["sources"] == new["sources"] => with_status(with_older_results(new, &old)),
            (Some(new), _) => new,
            // of older code: its words are the code's, its results and their hash stay
            (None, Some(mut old)) => {
                FROM_CODE.iter().for_each(|field| old[*field] = row.fields[*field].clone());
                old
            }
            (None, None) => row_of(row, &[], "", ""),
        }
    });
    merged["rows"] = rows.collect();
    merged
}

/// Adds the results of engines that this run did not ask.
fn with_older_results(mut new: Value, old: &Value) -> Value {
    new["results"] = with_older(&new["results"], &old["results"]);
    new
}

/// New results, and the older ones of other engines.
fn with_older(new: &Value, older: &Value) -> Value {
    let list = |results: &Value| results.as_array().cloned().unwrap_or_default();
    let engine = |result: &Value| result["engine"].as_str().and_then(Engine::named);
    let mut results = list(new);
    let asked: Vec<Option<Engine>> = results.iter().map(engine).collect();
    results.extend(list(older).into_iter().filter(|result| !asked.contains(&engine(result))));
    results.sort_by_key(engine);
    Value::Array(results)
}

/// The rows whose results in the committed ledger are of other sources than those of this checkout.
pub(crate) fn stale(root: &Path, all: &[Row]) -> Vec<String> {
    let (Some(book), Ok(tree)) = (read(root), Tree::read(root)) else { return Vec::new() };
    let kept = book["rows"].as_array().map_or(&[][..], Vec::as_slice);
    let is_stale = |row: &&Row| {
        let of = kept.iter().find(|kept| kept["name"] == row.fields["name"]);
        of.is_none_or(|kept| kept["sources"] != sources::hash(&tree, row).as_str())
    };
    all.iter().filter(is_stale).map(|row| row.name.clone()).collect()
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
                let other: Vec<&str> = other.collect();
                if !other.is_empty() {
                    found.push(format!("row {}: {}", row.name, other.join(", ")));
                }
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

/// Seconds that the proof of each harness took by the committed ledger.
pub(crate) fn proof_times(root: &Path) -> BTreeMap<String, f64> {
    let book = read(root).unwrap_or_default();
    proofs(&book).map(|(seconds, check)| (check.to_owned(), seconds)).collect()
}

fn proofs(book: &Value) -> impl Iterator<Item = (f64, &str)> {
    let rows = book["rows"].as_array().into_iter().flatten();
    let results = rows.flat_map(|row| row["results"].as_array().into_iter().flatten());
    results
        .filter(|result| result["engine"] == "cbmc" && result["verdict"] == "proved")
        .filter_map(|result| Some((result["seconds"].as_f64()?, result["check"].as_str()?)))
}

fn cheapest(book: &Value) -> BTreeSet<String> {
    let mut proofs: Vec<(f64, &str)> = proofs(book).collect();
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
    use crate::outcome::Verdict;
    use crate::rows::tests::sample;

    #[test]
    fn every_difference_between_ledger_and_code_is_told() {
        let row = sample();
        let book = json!({"rows": [row_of(&row, &[], "", "")]});
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
    fn an_update_changes_its_own_rows_and_keeps_results_of_the_same_sources() {
        let row = sample();
        let outcome = |engine, check: &str, verdict| Outcome {
            engine,
            check: check.into(),
            verdict,
            words: "w".into(),
            seconds: 1.25,
        };
        let proved = outcome(Engine::Cbmc, "h", Verdict::Proved);
        let passed = outcome(Engine::Native, "h", Verdict::Passed);
        let old = json!({"commit": "old", "rows": [row_of(&row, &[proved], "1", "old")]});
        let new =
            |sources| json!({"commit": "new", "rows": [row_of(&row, std::slice::from_ref(&passed), sources, "new")]});
        let rows = std::slice::from_ref(&row);
        let same = merge(Some(&old), &new("1"), rows, false);
        assert_eq!((&same["commit"], &same["rows"][0]["commit"]), (&json!("old"), &json!("new")));
        assert_eq!(same["rows"][0]["status"], "proved (CBMC), passed (native)");
        let other = merge(Some(&old), &new("2"), rows, false);
        assert_eq!(
            (&other["rows"][0]["status"], &other["rows"][0]["sources"]),
            (&json!("passed (native)"), &json!("2"))
        );
        let untouched = merge(Some(&old), &json!({"rows": []}), rows, false);
        assert_eq!(
            (&untouched["rows"][0]["status"], &untouched["rows"][0]["sources"]),
            (&json!("proved (CBMC)"), &json!("1"))
        );
        let none = merge(None, &json!({"rows": []}), rows, true);
        assert_eq!(none["rows"][0]["status"], "NOT RUN");
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
