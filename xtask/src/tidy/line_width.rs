//! No line of Rust exceeds 120 columns: rustfmt leaves comments, strings and the arguments of macros as they are.
//!
//! A line without a space behind its indentation and comment mark cannot be broken, and is allowed.

use super::Finding;
use retrace_task_support::tree::Tree;

const MAX_COLUMNS: usize = 120;

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (path, text) in tree.rust() {
        for (index, line) in text.lines().enumerate() {
            let columns = line.chars().count();
            let content = line.trim_start().trim_start_matches(['/', '!']).trim();
            if columns > MAX_COLUMNS && content.contains(' ') {
                findings.push(Finding::at(path, index + 1, format!("{columns} columns; at most {MAX_COLUMNS}")));
            }
        }
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_could_be_broken_is_refused() {
        let (exact, long) = ("é".repeat(119) + " ", "x".repeat(120));
        let text = format!("{exact}\n//! {long}\n// a {long}\n    \"{long}\n{long} y\n");
        let found: Vec<_> = find(&Tree::of(&[("a.rs", &text)])).into_iter().map(|finding| finding.line).collect();
        assert_eq!(found, [3, 5]);
    }
}
