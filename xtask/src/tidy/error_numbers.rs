//! Every error and warning number in the code has its row in `docs/errors.md`, and every row there is in use.
//!
//! Invariant: a number stands once in the table.

use super::Finding;
use retrace_task_support::tree::{Tree, is_test_file, lines_before_tests};
use std::collections::BTreeMap;

const TABLE: &str = "docs/errors.md";

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    let used = used_numbers(tree);
    let mut documented: BTreeMap<String, usize> = BTreeMap::new();
    for (index, line) in tree.text(TABLE).unwrap_or_default().lines().enumerate() {
        let Some(number) = row_number(line) else { continue };
        if let Some(first) = documented.insert(number.to_owned(), index + 1) {
            findings.push(Finding::at(TABLE, index + 1, format!("{number} stands here and in line {first}")));
        }
    }
    for (number, (path, line)) in &used {
        if !documented.contains_key(number) {
            findings.push(Finding::at(path, *line, format!("{number} has no row in {TABLE}")));
        }
    }
    for (number, line) in &documented {
        if !used.contains_key(number) {
            findings.push(Finding::at(TABLE, *line, format!("{number} is used nowhere in the code")));
        }
    }
    findings
}

/// Every number that stands in quotes, or begins a quoted text and is followed by a colon, in the crates' code outside
/// of tests, with the first place where it does.
fn used_numbers(tree: &Tree) -> BTreeMap<String, (String, usize)> {
    let mut used = BTreeMap::new();
    for (path, text) in tree.rust() {
        if !path.starts_with("crates/") || !path.contains("/src/") || is_test_file(path) {
            continue;
        }
        for (index, line) in text.lines().take(lines_before_tests(text)).enumerate() {
            for quoted in line.split('"').skip(1) {
                let number = quoted.split_once(": ").map_or(quoted, |(number, _)| number);
                if is_number(number) {
                    used.entry(number.to_owned()).or_insert_with(|| (path.to_owned(), index + 1));
                }
            }
        }
    }
    used
}

/// The number that a table row or a heading defines.
pub(super) fn row_number(line: &str) -> Option<&str> {
    let cell = line.trim_start().trim_start_matches(['|', '#']);
    if cell.len() == line.len() {
        return None;
    }
    let word = cell.split(|letter: char| letter == '|' || letter.is_whitespace()).find(|word| !word.is_empty())?;
    let number = word.trim_matches(['`', '*', ':']);
    is_number(number).then_some(number)
}

/// `E1000` … `E5999`, `W1000` … `W5999`.
pub(super) fn is_number(word: &str) -> bool {
    match word.as_bytes() {
        [b'E' | b'W', b'1'..=b'5', digits @ ..] => digits.len() == 3 && digits.iter().all(u8::is_ascii_digit),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn messages(source: &str, table: &str) -> Vec<String> {
        let tree = Tree::of(&[("crates/gcode/src/compiled_code.rs", source), (TABLE, table)]);
        find(&tree).into_iter().map(|finding| finding.message).collect()
    }

    #[test]
    fn a_number_without_a_row_and_a_row_without_a_number_are_refused() {
        let source = "A => \"E1001\", D => \"E3001: it broke\", B => \"W1002\", C => \"E6001\"\n#[cfg(test)]\nmod \
            tests {\n\"E1999\"\n}\n";
        assert_eq!(
            messages(source, "| `E1001` | x |\n| E3001 | z |\n| E2001 | y |\n"),
            ["W1002 has no row in docs/errors.md", "E2001 is used nowhere in the code"]
        );
        assert_eq!(messages(source, "| E1001 |\n### W1002: z\n| E3001 |\nsee E3002\n"), Vec::<String>::new());
    }

    #[test]
    fn a_number_that_stands_twice_is_refused() {
        assert_eq!(messages("\"E1001\"", "|E1001|\n|E1001|\n"), ["E1001 stands here and in line 1"]);
    }
}
