//! Every file that a document names from the root of the checkout exists.
//!
//! A path is named in a code span that holds nothing else: `crates/core/src/ring.rs`. Where the text before it says
//! *new file*, the reader is to create it.

use super::Finding;
use retrace_task_support::tree::Tree;

/// The folders that such a path begins with.
const FOLDERS: &[&str] = &["bench/", "crates/", "dist/", "docs/", "examples/", "tests/", "verification/", "xtask/"];

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (path, text) in tree.texts().filter(|(path, _)| path.ends_with(".md")) {
        let mut in_fence = false;
        for (index, line) in text.lines().enumerate() {
            in_fence ^= line.trim_start().starts_with("```");
            if in_fence {
                continue;
            }
            for name in named(line).filter(|name| !tree.has(name.trim_end_matches('/'))) {
                findings.push(Finding::at(path, index + 1, format!("`{name}` does not exist")));
            }
        }
    }
    findings
}

/// The paths that a line names.
fn named(line: &str) -> impl Iterator<Item = &str> {
    let parts: Vec<&str> = line.split('`').collect();
    let spans = parts.len() / 2;
    (0..spans).filter_map(move |span| {
        let (before, name) = (parts[2 * span], parts[2 * span + 1]);
        let is_path = name.chars().all(|c| c.is_ascii_alphanumeric() || "/._-".contains(c));
        let begins = FOLDERS.iter().any(|folder| name.len() > folder.len() && name.starts_with(folder));
        (is_path && begins && !before.trim_end().ends_with("new file")).then_some(name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_there_is_none_of_is_refused() {
        let text = "`crates/a/src/b.rs` `crates/a/src/c.rs` in a new file `docs/d.md`, `crates/NAME/x y`, `tests/`, \
            `xtask/e/`\n\
                    ```\n`docs/f.md`\n```\n";
        let tree = Tree::of(&[("README.md", text), ("crates/a/src/b.rs", "")]);
        let found: Vec<_> = find(&tree).into_iter().map(|finding| finding.message).collect();
        assert_eq!(found, ["`crates/a/src/c.rs` does not exist", "`xtask/e/` does not exist"]);
    }
}
