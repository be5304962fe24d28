//! Every Rust file opens with `//!`: what its one job is.

use super::Finding;
use retrace_task_support::tree::Tree;

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    tree.rust()
        .filter(|(_, text)| {
            let first = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
            first.strip_prefix("//!").is_none_or(|job| job.trim().is_empty())
        })
        .map(|(path, _)| Finding::at(path, 1, "a module opens with `//!` and its one job"))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_module_that_opens_with_code_is_refused() {
        let tree = Tree::of(&[
            ("a.rs", "use std::fs;\n//! late\n"),
            ("b.rs", "\n//! Its job.\n"),
            ("c.rs", "//!\n"),
            ("d.rs", ""),
        ]);
        let paths: Vec<_> = find(&tree).into_iter().map(|finding| finding.path).collect();
        assert_eq!(paths, ["a.rs", "c.rs", "d.rs"]);
    }
}
