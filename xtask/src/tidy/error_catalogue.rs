//! Every error number has a test that provokes it, or a reason why none can: `tests/error-catalogue.md`.
//!
//! A row is `| E1001 | `file.rs::test` |` or `| E1001 | reason |`. A test counts if its body has the number, or the
//! variant that stands for it: `::LineTooLong` for `LineTooLong "E1001"` or `Self::LineTooLong => "E1001"`.

use super::Finding;
use super::error_numbers::{is_number, row_number};
use super::requirements::test_body;
use retrace_task_support::tree::{Tree, is_test_file, is_word, lines_before_tests};
use std::collections::{BTreeMap, BTreeSet};

const CATALOGUE: &str = "tests/error-catalogue.md";
const TABLE: &str = "docs/errors.md";

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let Some(page) = tree.text(CATALOGUE) else {
        return vec![Finding::of_file(CATALOGUE, "there is no catalogue of errors")];
    };
    let variants = variants(tree);
    let mut findings = Vec::new();
    let mut listed = BTreeSet::new();
    for (index, line) in page.lines().enumerate() {
        let Some(number) = row_number(line) else { continue };
        let cell = line.trim_matches('|').split_once('|').map_or("", |(_, cell)| cell.trim());
        let mut wrong = |message: String| findings.push(Finding::at(CATALOGUE, index + 1, message));
        if !listed.insert(number) {
            wrong(format!("{number} has two rows"));
        }
        let test = cell.strip_prefix('`').and_then(|cell| cell.strip_suffix('`')?.split_once("::"));
        match test {
            None if cell.is_empty() => wrong(format!("{number} has neither a test nor a reason")),
            None => {}
            Some((path, name)) => match tree.text(path).and_then(|text| test_body(text, name)) {
                None => wrong(format!("{path} has no test `{name}`")),
                Some(body) if !names(&body, number, &variants) => wrong(format!("`{name}` does not name {number}")),
                Some(_) => {}
            },
        }
    }
    let documented: BTreeSet<&str> = tree.text(TABLE).unwrap_or_default().lines().filter_map(row_number).collect();
    let differing = documented.symmetric_difference(&listed);
    findings.extend(differing.map(|number| match listed.contains(number) {
        true => Finding::of_file(CATALOGUE, format!("{number} is not in {TABLE}")),
        false => Finding::of_file(CATALOGUE, format!("{number} has no row")),
    }));
    findings
}

fn names(body: &str, number: &str, variants: &BTreeMap<String, BTreeSet<String>>) -> bool {
    let has_variant = |variant: &String| {
        let path = format!("::{variant}");
        body.match_indices(&path).any(|(at, _)| body.as_bytes().get(at + path.len()).is_none_or(|&byte| !is_word(byte)))
    };
    body.contains(number) || variants.get(number).is_some_and(|variants| variants.iter().any(has_variant))
}

/// The variants that stand for a number: before it in a table, or in the pattern of its match arm.
fn variants(tree: &Tree) -> BTreeMap<String, BTreeSet<String>> {
    let mut variants = BTreeMap::<String, BTreeSet<String>>::new();
    for (path, text) in tree.rust().filter(|(path, _)| path.starts_with("crates/") && !is_test_file(path)) {
        for line in text.lines().take(lines_before_tests(text)) {
            let Some((before, number)) = line.split_once('"') else { continue };
            let number = number.split('"').next().unwrap_or_default();
            let pattern =
                before.trim().strip_suffix("=>").map(|pattern| pattern.rsplit("::").next().unwrap_or(pattern));
            let name = pattern.unwrap_or(before).trim();
            let name = &name[..name.bytes().position(|byte| !is_word(byte)).unwrap_or(name.len())];
            let is_variant = name.starts_with(|first: char| first.is_ascii_uppercase())
                && (pattern.is_some() || path.ends_with("/error_codes.rs"));
            if is_number(number) && is_variant {
                variants.entry(number.to_owned()).or_default().insert(name.to_owned());
            }
        }
    }
    variants
}

#[cfg(test)]
mod tests {
    use super::*;

    fn messages(catalogue: &str) -> Vec<String> {
        let source = "match self {\n    Self::Long { .. } => \"E1001\",\n    Self::Short => \"E1002\",\n}\n";
        let test = "#[test]\nfn long() {\n    assert(\"E1001\");\n}\n#[test]\nfn short() {\n    is(A::Short);\n}\n";
        let tree = Tree::of(&[
            ("crates/a/src/error.rs", source),
            ("tests/tests/e2e/a.rs", test),
            (TABLE, "| E1001 | a |\n| E1002 | b |\n"),
            (CATALOGUE, catalogue),
        ]);
        find(&tree).into_iter().map(|finding| finding.message).collect()
    }

    #[test]
    fn a_number_has_a_test_that_names_it_or_a_reason() {
        let (long, short) = ("| E1001 | `tests/tests/e2e/a.rs::long` |", "| E1002 | `tests/tests/e2e/a.rs::short` |");
        assert_eq!(messages(&format!("{long}\n{short}\n")), Vec::<String>::new());
        assert_eq!(messages(&format!("{long}\n| E1002 | A defect. |\n")), Vec::<String>::new());
        assert_eq!(messages(&format!("{long}\n{long}\n{short}\n")), ["E1001 has two rows"]);
        assert_eq!(messages(long), ["E1002 has no row"]);
        assert_eq!(messages(&format!("{long}\n{short}\n| E1003 | x |\n")), ["E1003 is not in docs/errors.md"]);
        assert_eq!(messages(&format!("{long}\n| E1002 | |\n")), ["E1002 has neither a test nor a reason"]);
        let wrong = long.replace("::long", "::short");
        assert_eq!(messages(&format!("{wrong}\n{short}\n")), ["`short` does not name E1001"]);
        let gone = short.replace("::short", "::tall");
        assert_eq!(messages(&format!("{long}\n{gone}\n")), ["tests/tests/e2e/a.rs has no test `tall`"]);
    }
}
