//! `cargo xtask book`: the pages of the documentation as one book with a search, by mdBook.
//!
//! Pages link to files outside of `docs/`. The book is therefore built from a copy in `target/book/src`, in which every
//! chapter and every linked file stands under its path from the root of the checkout.
//!
//! Invariant: a book with a link that leads nowhere is a failure.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::tidy::book_pages;
use retrace_task_support::tree::Tree;

/// Pages of the book that mdBook makes from the others, or for itself.
const NOT_CHECKED: [&str; 3] = ["404.html", "print.html", "toc.html"];

/// Builds the book and checks its links; says whether it passed.
pub(crate) fn run(root: &Path) -> bool {
    super::reported("book", build(root))
}

fn build(root: &Path) -> Result<(), String> {
    let tree = Tree::read(root)?;
    let folder = root.join("target/book");
    let pages = copy_pages(root, &tree, &folder)?;
    let mdbook = std::env::var_os("RETRACE_MDBOOK").map_or_else(|| PathBuf::from("mdbook"), PathBuf::from);
    let built = Command::new(mdbook).arg("build").arg(&folder).status();
    let status = built.map_err(|error| {
        format!(
            "mdbook cannot be run: {error}; `cargo install mdbook --locked` installs it, RETRACE_MDBOOK names \
            another one"
        )
    })?;
    if !status.success() {
        return Err("mdbook failed".to_owned());
    }
    let html = folder.join("html");
    let dead = dead_links(&read_pages(&html)?);
    dead.iter().for_each(|link| println!("book: {link}"));
    println!("book: {pages} pages, {} dead links: {}", dead.len(), html.join("index.html").display());
    if dead.is_empty() { Ok(()) } else { Err("links lead nowhere".to_owned()) }
}

/// Copies chapters, linked files, contents and settings; returns the number of chapters.
fn copy_pages(root: &Path, tree: &Tree, folder: &Path) -> Result<usize, String> {
    let _ = fs::remove_dir_all(folder);
    let source = folder.join("src");
    let (chapters, attachments) = book_pages::files(tree);
    for path in chapters.iter().chain(&attachments) {
        let place = source.join(path);
        let parent = place.parent().unwrap_or(&source);
        let copied = fs::create_dir_all(parent).and_then(|()| fs::copy(root.join(path), &place));
        copied.map_err(|error| format!("{path}: {error}"))?;
    }
    let write =
        |path: PathBuf, text: &str| fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()));
    write(source.join("SUMMARY.md"), &book_pages::summary_from_root(tree))?;
    write(folder.join("book.toml"), tree.text("docs/book.toml").ok_or("docs/book.toml is missing")?)?;
    Ok(chapters.len())
}

/// The built pages, and the paths of all other files, from the book's root with `/`.
fn read_pages(html: &Path) -> Result<BTreeMap<String, String>, String> {
    let mut files = BTreeMap::new();
    let mut folders = vec![html.to_path_buf()];
    while let Some(folder) = folders.pop() {
        let entries = fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        for path in entries.filter_map(Result::ok).map(|entry| entry.path()) {
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.strip_prefix(html).unwrap_or(&path).to_string_lossy().replace('\\', "/");
            let is_page = name.ends_with(".html") && !NOT_CHECKED.contains(&name.as_str());
            let text = if is_page {
                fs::read_to_string(&path).map_err(|error| format!("{name}: {error}"))?
            } else {
                String::new()
            };
            files.insert(name, text);
        }
    }
    Ok(files)
}

/// The relative links that lead to no file or no heading, each with its page.
fn dead_links(files: &BTreeMap<String, String>) -> Vec<String> {
    let anchors: BTreeMap<&str, BTreeSet<&str>> =
        files.iter().map(|(page, text)| (page.as_str(), values(text, "id").collect())).collect();
    let mut dead = Vec::new();
    for (page, text) in files {
        for link in values(text, "href").chain(values(text, "src")) {
            if link.contains(':') || link.is_empty() || link.starts_with("//") {
                continue;
            }
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { page.clone() } else { joined(page, path) };
            let leads = match anchors.get(target.as_str()) {
                None => false,
                Some(ids) => anchor.is_empty() || !target.ends_with(".html") || ids.contains(anchor),
            };
            if !leads {
                dead.push(format!("{page}: `{link}` leads nowhere"));
            }
        }
    }
    dead
}

/// The values of an attribute in HTML.
fn values<'a>(text: &'a str, attribute: &str) -> impl Iterator<Item = &'a str> {
    let opening = format!(" {attribute}=\"");
    let mut rest = text;
    std::iter::from_fn(move || {
        let from = rest.find(&opening)? + opening.len();
        let (value, behind) = rest[from..].split_once('"')?;
        rest = behind;
        Some(value)
    })
}

/// The path from the book's root that a relative path on a page means.
fn joined(page: &str, path: &str) -> String {
    let mut parts: Vec<&str> = page.split('/').collect();
    parts.pop();
    for part in path.split('?').next().unwrap_or_default().split('/') {
        match part {
            "" | "." => {}
            ".." => {
                parts.pop();
            }
            name => parts.push(name),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dead_link_and_a_dead_anchor_are_found() {
        let page = "<h1 id=\"top\"><a href=\"../b.html#here\"> <a href=\"#top\"> <a href=\"https://x.org/y\"> \
                    <img src=\"p.svg\"> <a href=\"../none.html\"> <a href=\"../b.html#there\"> <a href=\"#none\">";
        let files = [("a/a.html", page), ("b.html", "<p id=\"here\">"), ("a/p.svg", "")];
        let files = files.map(|(path, text)| (path.to_owned(), text.to_owned())).into_iter().collect();
        assert_eq!(
            dead_links(&files),
            [
                "a/a.html: `../none.html` leads nowhere",
                "a/a.html: `../b.html#there` leads nowhere",
                "a/a.html: `#none` leads nowhere"
            ]
        );
    }
}
