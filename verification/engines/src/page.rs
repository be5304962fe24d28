//! The ledger as a page to read.
//!
//! Invariant: the page has the content of the JSON and nothing else, so that the two can be compared.

use super::status;
use serde_json::Value;
use std::fmt::Write;

/// The page of a ledger.
pub(crate) fn render(book: &Value) -> String {
    let mut page = String::new();
    head(&mut page, book);
    let rows = book["rows"].as_array().map_or(&[][..], Vec::as_slice);
    page += "\n## Summary\n\nA mutant is killed by the check that it names: natively, by a thread model, or refuted by \
        CBMC.\n\n";
    page += "| row | status | mutants killed | seconds |\n|---|---|---|---|\n";
    for row in rows {
        let name = text(&row["name"]);
        // writing to a string cannot fail
        let _ =
            writeln!(page, "| [{name}](#{name}) | {} | {} | {} |", text(&row["status"]), mutants(row), row["seconds"]);
    }
    for row in rows {
        section(&mut page, row);
    }
    page
}

fn head(page: &mut String, book: &Value) {
    let quick = if book["quick"] == true { ", a quick run: it says nothing of what it left out" } else { "" };
    let _ = writeln!(page, "# The proof ledger\n");
    let _ = writeln!(
        page,
        "Written by `cargo xtask verify` at commit {}, {}{quick}, in {} s. How to read it: \
            [docs/verification.md](../docs/verification.md).\n",
        text(&book["commit"]),
        text(&book["date"]),
        book["seconds"]
    );
    let absent = book["not_run"].as_array().map_or(&[][..], Vec::as_slice);
    for engine in absent {
        let _ = writeln!(page, "- **NOT RUN: {}** ({})", text(&engine["engine"]), text(&engine["why"]));
    }
    if absent.is_empty() {
        page.push_str("Every engine was run.\n");
    }
    let _ = writeln!(page, "\nWhat *proved (CBMC)* means: {}", text(&book["cbmc_means"]));
    page.push_str("\nTools: ");
    let tools = book["tools"].as_array().into_iter().flatten();
    let tools: Vec<String> = tools.map(|tool| format!("{} {}", text(&tool["name"]), text(&tool["version"]))).collect();
    let _ = writeln!(page, "{}.", tools.join(", "));
    for other in book["other_results"].as_array().into_iter().flatten() {
        let _ = writeln!(page, "\n{} {}: {}", text(&other["engine"]), text(&other["check"]), text(&other["words"]));
    }
}

fn section(page: &mut String, row: &Value) {
    let _ = writeln!(page, "\n## {}\n\n{}.\n", text(&row["name"]), text(&row["says"]));
    let points = [
        ("Requirement", text(&row["requirement"])),
        ("Bound", text(&row["bound"])),
        ("Assumed", text(&row["assumes"])),
        ("Why that bound is enough", text(&row["suffices"])),
        ("Status", text(&row["status"])),
        ("Sources", &format!("{} at commit {}", text(&row["sources"]), text(&row["commit"]))),
    ];
    for (name, words) in points {
        let _ = writeln!(page, "- {name}: {words}");
    }
    let results = row["results"].as_array().map_or(&[][..], Vec::as_slice);
    if !results.is_empty() {
        page.push_str("\n| engine | check | result | seconds |\n|---|---|---|---|\n");
    }
    for result in results {
        let check = text(&result["check"]);
        let unwind = row["harnesses"].as_array().into_iter().flatten().find(|harness| harness["name"] == check);
        let unwind = unwind.filter(|_| result["engine"] == "cbmc" || result["engine"] == "kani");
        let unwind = unwind.map_or(String::new(), |harness| format!(" (unwind {})", harness["unwind"]));
        let words = text(&result["words"]).replace('|', "\\|").replace('\n', " ");
        let _ = writeln!(page, "| {} | {check}{unwind} | {words} | {} |", text(&result["engine"]), result["seconds"]);
    }
}

fn mutants(row: &Value) -> String {
    let kills = status::kills(row).into_iter().filter(|(.., run)| *run > 0);
    kills.map(|(name, killed, run)| format!("{name} {killed} of {run}")).collect::<Vec<_>>().join(", ")
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_page_names_what_did_not_run_and_what_every_row_showed() {
        let row = json!({"name": "a-row", "says": "It holds", "status": "passed \
            (native)", "seconds": 1.5, "harnesses": [{"name": "h", "unwind": 3}],
            "mutants": [{"name": "x", "killer": "h"}],
            "results": [{"engine": "cbmc", "check": "h", "words": "a | b", "seconds": 0.5},
                {"engine": "mutants", "check": "x", "verdict": "passed", "words": "killed", "seconds": 0.5}]});
        let book = json!({"commit": "abc", "date": "2026-01-01", "not_run": [{"engine": "kani", "why": "not \
            here"}], "rows": [row]});
        let page = render(&book);
        for line in [
            "- **NOT RUN: kani** (not here)",
            "| [a-row](#a-row) | passed (native) | native 1 of 1 | 1.5 |",
            "| cbmc | h (unwind 3) | a \\| b | 0.5 |",
            "It holds.",
        ] {
            assert!(page.lines().any(|found| found == line), "{line}\n{page}");
        }
    }
}
