//! Every page of `docs/` is a chapter of the book, and a chapter links to no page that the book leaves out.

use std::collections::BTreeSet;

use super::Finding;
use super::links::{resolved, targets};
use retrace_task_support::tree::Tree;

/// The book's table of contents.
pub(crate) const SUMMARY: &str = "docs/SUMMARY.md";

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut chapters = BTreeSet::new();
    for (line, path) in links_of(tree, SUMMARY) {
        if !chapters.insert(path.clone()) {
            findings.push(Finding::at(SUMMARY, line, format!("`{path}` is in the book twice")));
        }
    }
    for (path, _) in tree.texts().filter(|(path, _)| path.starts_with("docs/") && path.ends_with(".md")) {
        if path != SUMMARY && !chapters.contains(path) {
            findings.push(Finding::of_file(path, format!("add this page to {SUMMARY}")));
        }
    }
    for chapter in &chapters {
        for (line, path) in links_of(tree, chapter) {
            if path.ends_with(".md") && !chapters.contains(&path) {
                findings.push(Finding::at(chapter, line, format!("`{path}` is not in the book; add it to {SUMMARY}")));
            }
        }
    }
    findings
}

/// The chapters in their order, then the other files that they link to: pictures, programs, licences.
pub(crate) fn files(tree: &Tree) -> (Vec<String>, BTreeSet<String>) {
    let chapters: Vec<String> = links_of(tree, SUMMARY).into_iter().map(|(_, path)| path).collect();
    let linked = chapters.iter().flat_map(|chapter| links_of(tree, chapter)).map(|(_, path)| path);
    let attachments = linked.filter(|path| !chapters.contains(path) && tree.has_file(path)).collect();
    (chapters, attachments)
}

/// The table of contents with every link from the root of the tree, not from `docs/`.
pub(crate) fn summary_from_root(tree: &Tree) -> String {
    let mut summary = String::new();
    for line in tree.text(SUMMARY).unwrap_or_default().lines() {
        let mut line = line.to_owned();
        if let Some((target, path)) =
            targets(&line).first().and_then(|t| Some(((*t).to_owned(), resolved(SUMMARY, t)?)))
        {
            line = line.replacen(&format!("]({target}"), &format!("]({path}"), 1);
        }
        summary.push_str(&line);
        summary.push('\n');
    }
    summary
}

/// The files of the tree that a page links to, each with the line of the link.
fn links_of(tree: &Tree, page: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let mut in_fence = false;
    for (index, line) in tree.text(page).unwrap_or_default().lines().enumerate() {
        in_fence ^= line.trim_start().starts_with("```");
        if !in_fence {
            found.extend(targets(line).into_iter().filter_map(|t| Some((index + 1, resolved(page, t)?))));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTENTS: &str = "# Summary\n\n[a](../A.md)\n- [b](b.md)\n  - [c](c.md#d)\n- [b](b.md)\n";

    #[test]
    fn a_page_outside_of_the_book_is_refused() {
        let text = "[x](../A.md) [y](../crates/y.md) ![z](z.svg)\n```\n[n](../none.md)\n```\n";
        let tree = Tree::of(&[
            (SUMMARY, CONTENTS),
            ("A.md", ""),
            ("docs/b.md", text),
            ("docs/c.md", ""),
            ("docs/d.md", ""),
            ("docs/z.svg", ""),
            ("crates/y.md", ""),
        ]);
        let found: Vec<_> = find(&tree).into_iter().map(|found| (found.path, found.line)).collect();
        let at = |path: &str, line| (path.to_owned(), line);
        assert_eq!(found, [at(SUMMARY, 6), at("docs/d.md", 0), at("docs/b.md", 1)]);
        assert_eq!(files(&tree).1.into_iter().collect::<Vec<_>>(), ["crates/y.md", "docs/z.svg"]);
    }

    #[test]
    fn the_contents_are_the_same_from_the_root() {
        let tree = Tree::of(&[(SUMMARY, CONTENTS)]);
        assert!(summary_from_root(&tree).contains("[a](A.md)\n- [b](docs/b.md)\n  - [c](docs/c.md#d)\n"));
    }
}
