//! The page of requirements is complete: every number has a row, and what a row names as its proof exists.
//!
//! A row is `| REV-1 | sentence | status | code | shown by |`. The status is `built`, `not built`, or `partly` followed
//! by what is missing. `code` names files, `shown by` names tests as `file.rs::function` and rows of the proof ledger
//! as links.

use super::Finding;
use retrace_task_support::tree::{Tree, is_word};

/// The page that lists every requirement.
const PAGE: &str = "docs/requirements.md";
/// The machine-readable proof ledger.
const LEDGER: &str = "verification/ledger.json";
/// How a row of the page links to a row of the ledger, up to the name.
const LEDGER_LINK: &str = "](../verification/LEDGER.md#";
/// Each series of requirements and its last number; all begin at 1.
const SERIES: &[Series] = &[
    Series { name: "REV", last: 14 },
    Series { name: "GMC", last: 7 },
    Series { name: "DNC", last: 12 },
    Series { name: "SMO", last: 10 },
    Series { name: "PRE", last: 9 },
    Series { name: "CUT", last: 63 },
    Series { name: "PRB", last: 22 },
    Series { name: "SPN", last: 29 },
    Series { name: "SHP", last: 37 },
];
/// The folders that a path on the page begins with.
const FOLDERS: &[&str] = &["bench/", "crates/", "docs/", "examples/", "tests/", "verification/", "xtask/"];

/// A series of requirements.
#[derive(Clone, Copy)]
struct Series {
    name: &'static str,
    last: u32,
}

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = unknown_citations(tree, SERIES);
    match tree.text(PAGE) {
        Some(page) => {
            findings.extend(wrong_rows(page, SERIES));
            findings.extend(missing_evidence(tree, page));
        }
        None => findings.push(Finding::of_file(PAGE, "there is no page of requirements")),
    }
    findings
}

/// Citations of numbers that no series has.
fn unknown_citations(tree: &Tree, series: &[Series]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (path, text) in tree.texts() {
        for (index, line) in text.lines().enumerate() {
            for (Series { name, last }, number) in citations(line, series) {
                if number == 0 || number > last {
                    let message = format!("{name}-{number} does not exist; the last of its series is {name}-{last}");
                    findings.push(Finding::at(path, index + 1, message));
                }
            }
        }
    }
    findings
}

/// Requirements without a row or with two, and rows that are incomplete.
fn wrong_rows(page: &str, series: &[Series]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut rows = Vec::new();
    for (index, line) in page.lines().enumerate() {
        let cells: Vec<&str> = line.trim().trim_matches('|').split('|').map(str::trim).collect();
        let Some(&[(Series { name, .. }, number)]) = cells.first().map(|cell| citations(cell, series)).as_deref()
        else {
            continue;
        };
        if !line.starts_with('|') || cells[0] != format!("{name}-{number}") {
            continue;
        }
        if rows.contains(&(name, number)) {
            findings.push(Finding::at(PAGE, index + 1, format!("{name}-{number} has two rows")));
        }
        rows.push((name, number));
        if let Some(message) = wrong_cells(&cells) {
            findings.push(Finding::at(PAGE, index + 1, format!("{name}-{number}: {message}")));
        }
    }
    for Series { name, last } in series {
        for number in (1..=*last).filter(|number| !rows.contains(&(name, *number))) {
            findings.push(Finding::of_file(PAGE, format!("{name}-{number} has no row")));
        }
    }
    findings
}

/// What is wrong with the cells of a row, if anything is.
fn wrong_cells(cells: &[&str]) -> Option<&'static str> {
    let &[_, sentence, status, code, shown] = cells else { return Some("a row has five cells") };
    if sentence.is_empty() {
        return Some("the sentence is missing");
    }
    match status.split_once(": ") {
        None if status == "not built" => return None,
        None if status == "built" => {}
        Some(("partly", missing)) if !missing.is_empty() => {}
        _ => return Some("the status is `built`, `not built`, or `partly: ` followed by what is missing"),
    }
    let names_test = shown.contains("::") || shown.contains(LEDGER_LINK);
    if code_spans(code).next().is_none() {
        Some("the code that meets it is missing")
    } else if !names_test {
        Some("the test or ledger row that shows it is missing")
    } else {
        None
    }
}

/// Files, tests and ledger rows that the page names and that do not exist.
fn missing_evidence(tree: &Tree, page: &str) -> Vec<Finding> {
    let ledger = tree.text(LEDGER).unwrap_or_default();
    let mut findings = Vec::new();
    for (index, line) in page.lines().enumerate() {
        let mut missing = |message: String| findings.push(Finding::at(PAGE, index + 1, message));
        for span in code_spans(line).filter(|span| FOLDERS.iter().any(|folder| span.starts_with(folder))) {
            let (path, test) = span.split_once("::").map_or((span, None), |(path, test)| (path, Some(test)));
            match (tree.text(path), test) {
                (Some(text), Some(test)) if !has_test(text, test) => missing(format!("{path} has no test `{test}`")),
                (None, _) if !tree.has(path) => missing(format!("{path} does not exist")),
                _ => {}
            }
        }
        for (at, _) in line.match_indices(LEDGER_LINK) {
            let rest = &line[at + LEDGER_LINK.len()..];
            let row = &rest[..rest.find(')').unwrap_or(rest.len())];
            if !ledger.contains(&format!("\"name\": \"{row}\"")) {
                missing(format!("{LEDGER} has no row `{row}`"));
            }
        }
    }
    findings
}

/// The code spans of a line of Markdown.
fn code_spans(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2)
}

/// Does this Rust text have a test function of this name?
fn has_test(text: &str, name: &str) -> bool {
    test_body(text, name).is_some()
}

/// The lines of the test function of this name: up to the brace at its own indentation.
pub(super) fn test_body(text: &str, name: &str) -> Option<String> {
    let lines: Vec<&str> = text.lines().collect();
    let opening = format!("fn {name}(");
    let at = (0..lines.len()).filter(|&at| lines[at].trim().starts_with(&opening)).find(|&at| {
        let before = lines[..at].iter().rev().map(|line| line.trim());
        before.take_while(|line| line.starts_with("#[") || line.starts_with("//")).any(|line| line == "#[test]")
    })?;
    let indentation = &lines[at][..lines[at].len() - lines[at].trim_start().len()];
    let closing = format!("{indentation}}}");
    let length = lines[at..].iter().position(|line| *line == closing).unwrap_or(0);
    Some(lines[at..=at + length].join("\n"))
}

/// Every `REV-6` and the like in a line.
fn citations(line: &str, series: &[Series]) -> Vec<(Series, u32)> {
    let mut found = Vec::new();
    for one in series {
        for (at, _) in line.match_indices(one.name) {
            let stands_alone = at == 0 || !is_word(line.as_bytes()[at - 1]);
            let Some(rest) = line[at + one.name.len()..].strip_prefix('-') else { continue };
            let digits = &rest[..rest.bytes().take_while(u8::is_ascii_digit).count()];
            if let (true, Ok(number)) = (stands_alone, digits.parse()) {
                found.push((*one, number));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &[Series] = &[Series { name: "REV", last: 2 }];

    /// A page with these rows; `@` stands for the series and its hyphen, so that this file cites nothing.
    fn page(rows: &str) -> String {
        rows.replace('@', &format!("REV{}", '-'))
    }

    fn messages(findings: &[Finding]) -> Vec<&str> {
        findings.iter().map(|finding| finding.message.as_str()).collect()
    }

    #[test]
    fn a_citation_of_an_unknown_number_is_refused() {
        let dash = "-";
        let text =
            format!("REV{dash}14, REV{dash}15\nSMO{dash}0 and (GMC{dash}7)\nXREV{dash}99 REV{dash}x PRE{dash}10\n");
        let tree = Tree::of(&[("a.rs", &text)]);
        let found: Vec<_> = unknown_citations(&tree, SERIES).iter().map(|finding| finding.line).collect();
        assert_eq!(found, [1, 2, 3]);
    }

    #[test]
    fn a_tree_without_the_page_is_refused() {
        assert_eq!(messages(&find(&Tree::of(&[("a.rs", "")]))), ["there is no page of requirements"]);
    }

    #[test]
    fn a_number_without_a_row_or_with_two_is_refused() {
        let rows = page("| @1 | s | not built | | |\ntext @2\n| @1 and @2 | s | not built | | |\n");
        assert_eq!(messages(&wrong_rows(&rows, TWO)), [page("@2 has no row")]);
        let rows = page("| @1 | s | not built | | |\n| @2 | s | not built | | |\n| @1 | s | not built | | |\n");
        assert_eq!(messages(&wrong_rows(&rows, TWO)), [page("@1 has two rows")]);
    }

    #[test]
    fn a_row_that_claims_without_evidence_is_refused() {
        let status = "the status is `built`, `not built`, or `partly: ` followed by what is missing";
        for (row, expected) in [
            ("| @1 | s | built | `a.rs` |", "a row has five cells"),
            ("| @1 | | built | `a.rs` | `b.rs::c` |", "the sentence is missing"),
            ("| @1 | s | done | `a.rs` | `b.rs::c` |", status),
            ("| @1 | s | partly | `a.rs` | `b.rs::c` |", status),
            ("| @1 | s | built | | `b.rs::c` |", "the code that meets it is missing"),
            ("| @1 | s | partly: x | `a.rs` | |", "the test or ledger row that shows it is missing"),
        ] {
            let rows = page(&format!("{row}\n| @2 | s | not built | | |\n"));
            assert_eq!(messages(&wrong_rows(&rows, TWO)), [page(&format!("@1: {expected}"))], "{row}");
        }
        let rows = page(
            "| @1 | s | built | `a.rs` | `b.rs::c` |\n| @2 | s | partly: x | `a.rs` | \
                [r](../verification/LEDGER.md#r) |",
        );
        assert_eq!(messages(&wrong_rows(&rows, TWO)), [""; 0]);
    }

    #[test]
    fn a_file_a_test_or_a_ledger_row_that_does_not_exist_is_refused() {
        let code = "#[test]\n// Why.\n#[ignore]\nfn there() {}\n\nfn helper() {}\n";
        let tree = Tree::of(&[("crates/a.rs", code), (LEDGER, "\"name\": \"row\"")]);
        let held = "`crates/a.rs` `crates` `REV` `crates/a.rs::there` [row](../verification/LEDGER.md#row)";
        assert_eq!(messages(&missing_evidence(&tree, held)), [""; 0]);
        let missing = "`crates/b.rs` `crates/b.rs::there`\n`crates/a.rs::helper` \
            `crates/a.rs::ther`\n[x](../verification/LEDGER.md#x)";
        let expected = [
            "crates/b.rs does not exist",
            "crates/b.rs does not exist",
            "crates/a.rs has no test `helper`",
            "crates/a.rs has no test `ther`",
            "verification/ledger.json has no row `x`",
        ];
        assert_eq!(messages(&missing_evidence(&tree, missing)), expected);
    }
}
