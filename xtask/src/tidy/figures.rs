//! The pictures that the documents show are those that `cargo xtask figures` makes, no more and no fewer.

use super::Finding;
use crate::figures::{FIGURES, FOLDER};
use retrace_task_support::tree::Tree;

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let names: Vec<&str> = FIGURES.iter().map(|figure| figure.file).collect();
    check(tree, &names)
}

fn check(tree: &Tree, names: &[&str]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let folder = format!("{FOLDER}/");
    for name in names {
        let path = format!("{folder}{name}");
        if !tree.has(&path) {
            findings.push(Finding::of_file(&path, "is not there: `cargo xtask figures` makes it"));
        }
        if !tree.texts().any(|(page, text)| page.ends_with(".md") && shows(page, text, name)) {
            findings.push(Finding::of_file(&path, "no document shows it"));
        }
    }
    let others = tree.paths().filter_map(|path| path.strip_prefix(&folder)).filter(|name| !names.contains(name));
    findings.extend(others.map(|name| {
        Finding::of_file(
            &format!("{folder}{name}"),
            "`cargo xtask figures` does not make it: list it in xtask/src/figures.rs",
        )
    }));
    findings
}

/// Does a page show this picture?
fn shows(page: &str, text: &str, name: &str) -> bool {
    let from_root = format!("({FOLDER}/{name})");
    let from_docs = format!("(figures/{name})");
    let from_beside = format!("(../{FOLDER}/{name})");
    match page.rsplit_once('/') {
        None => text.contains(&from_root),
        Some(("docs", _)) => text.contains(&from_docs),
        Some(_) => text.contains(&from_beside),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_that_is_not_made_not_there_or_not_shown_is_refused() {
        let files = [
            ("README.md", "![a](docs/figures/a.svg)"),
            ("docs/x.md", "![b](figures/b.svg) ![c](docs/figures/c.svg)"),
            ("examples/y.md", "![d](../docs/figures/d.svg)"),
            ("docs/figures/a.svg", ""),
            ("docs/figures/b.svg", ""),
            ("docs/figures/c.svg", ""),
            ("docs/figures/e.svg", ""),
        ];
        let found: Vec<String> = check(&Tree::of(&files), &["a.svg", "b.svg", "c.svg", "d.svg"])
            .into_iter()
            .map(|finding| format!("{} {}", finding.path, finding.message.split(':').next().unwrap_or_default()))
            .collect();
        assert_eq!(
            found,
            [
                "docs/figures/c.svg no document shows it",
                "docs/figures/d.svg is not there",
                "docs/figures/e.svg `cargo xtask figures` does not make it"
            ]
        );
    }

    #[test]
    fn the_list_is_in_order_and_names_none_twice() {
        assert!(FIGURES.is_sorted_by(|a, b| a.file < b.file));
    }
}
