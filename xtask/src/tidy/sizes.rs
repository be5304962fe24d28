//! A file stays short enough to be one noun; its unit tests are not counted.

use super::Finding;
use retrace_task_support::tree::{Tree, is_test_file, lines_before_tests};

/// Lines from which a file is shown.
const LONG: usize = 400;
/// Lines beyond which a file is refused.
const TOO_LONG: usize = 600;

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    tree.rust()
        .filter(|(path, _)| !is_test_file(path))
        .filter_map(|(path, text)| {
            let lines = lines_before_tests(text);
            let finding =
                Finding::of_file(path, format!("{lines} lines before its tests; {LONG} are enough for one noun"));
            match lines {
                ..=LONG => None,
                _ if lines <= TOO_LONG => Some(finding.into_warning()),
                _ => Some(finding),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_file_is_shown_and_a_too_long_one_refused() {
        let of = |lines: usize| {
            let text = format!("{}#[cfg(test)]\nmod tests {{\n{}}}\n", "x\n".repeat(lines), "y\n".repeat(900));
            find(&Tree::of(&[("a.rs", &text)])).first().map(|finding| finding.is_warning)
        };
        assert_eq!([of(400), of(401), of(600), of(601)], [None, Some(true), Some(true), Some(false)]);
    }
}
