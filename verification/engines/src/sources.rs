//! The sources that a row was made from: which files, and their hash, by which a stale row is known.
//!
//! Invariant: everything that a row's result depends on in this checkout is hashed; comments and line breaks are not.

use super::rows::Row;
use retrace_task_support::tree::Tree;
use std::collections::BTreeSet;

/// The crates under proof, each with the folders of its sources and of those that it uses.
const CRATES: [(&str, &[&str]); 3] = [
    ("retrace_core", &["crates/core/src/"]),
    ("retrace_link", &["crates/link/src/", "crates/core/src/"]),
    ("retrace_card", &["crates/card/src/", "crates/link/src/", "crates/core/src/"]),
];
/// What runs every row. It names all crates, of which a row uses its own.
const ENGINE: &str = "verification/engines/src/cbmc.rs";
/// What every row is built with.
const SHARED: [&str; 7] = [
    "verification/cbmc/environment.c",
    "verification/src/choice.rs",
    "verification/src/harness.rs",
    "verification/src/ledger.rs",
    "verification/src/lib.rs",
    "verification/src/native.rs",
    "verification/src/region.rs",
];
/// The thread models; which files of the crates they include is written in them.
const MODELS: [&str; 3] = ["verification/loom/", "verification/shuttle/", "verification/concurrent/"];

/// Hash of everything that the results of this row depend on, in hexadecimal.
pub(crate) fn hash(tree: &Tree, row: &Row) -> String {
    let mut hash = 0xCBF2_9CE4_8422_2325_u64;
    for path in files(tree, row) {
        let text = tree.text(&path).unwrap_or_default();
        for part in [path.as_str(), "\0", &significant(text), "\0"] {
            // FNV-1a (Fowler, Noll, Vo 1991)
            part.bytes().for_each(|byte| hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3));
        }
    }
    format!("{hash:016x}")
}

/// The text without line comments and white space, so that prose and layout make nothing stale.
fn significant(text: &str) -> String {
    let lines = text.lines().map(str::trim).filter(|line| !line.starts_with("//"));
    lines.flat_map(str::split_whitespace).collect()
}

/// The files, in the order of their paths.
fn files(tree: &Tree, row: &Row) -> BTreeSet<String> {
    let under = |prefix: &str| -> Vec<String> {
        let rust = tree.paths().filter(|path| path.ends_with(".rs"));
        rust.filter(|path| path.starts_with(prefix)).map(str::to_owned).collect()
    };
    let has_models = !row.models.is_empty();
    let module = &row.module;
    let mut found: BTreeSet<String> = SHARED.iter().map(|path| (*path).to_owned()).collect();
    found.extend([format!("verification/src/{module}.rs")]);
    found.extend(under(&format!("verification/src/{module}/")));
    found.extend(MODELS.into_iter().filter(|_| has_models).flat_map(under));
    let texts: Vec<(&String, &str)> = found.iter().filter_map(|path| Some((path, tree.text(path)?))).collect();
    let included: Vec<String> = texts.iter().flat_map(|(path, text)| included(tree, path, text)).collect();
    let uses = |name: &str| has_models || texts.iter().any(|(_, text)| text.contains(name));
    let used: Vec<&str> =
        CRATES.iter().filter(|(name, ..)| uses(name)).flat_map(|(.., with)| with.iter().copied()).collect();
    found.extend(included);
    found.extend(used.into_iter().flat_map(under));
    found.insert(ENGINE.to_owned());
    found
}

/// The files that this one includes by `#[path = "…"]`.
fn included(tree: &Tree, path: &str, text: &str) -> Vec<String> {
    let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
    let paths = text.split("#[path = \"").skip(1).filter_map(|rest| rest.split_once('"')).map(|(path, _)| path);
    paths.map(|relative| resolved(folder, relative)).filter(|path| tree.has_file(path)).collect()
}

/// A path relative to a folder, without `..`.
fn resolved(folder: &str, relative: &str) -> String {
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in relative.split('/') {
        match part {
            ".." => drop(parts.pop()),
            "." => {}
            part => parts.push(part),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::tests::sample;

    const TREE: [(&str, &str); 6] = [
        ("verification/src/ring.rs", "use retrace_link::crc;\n"),
        (ENGINE, "const CRATES: [&str; 3] = [\"retrace_core\", \"retrace_link\", \"retrace_card\"];\n"),
        ("crates/core/src/a.rs", "fn a() {}\n"),
        ("crates/link/src/b.rs", "fn b() {}\n"),
        ("crates/card/src/c.rs", "fn c() {}\n"),
        ("crates/journal/src/queue.rs", "fn q() {}\n"),
    ];

    fn with(changed: (&str, &str), row: &Row) -> String {
        let files: Vec<(&str, &str)> = TREE.iter().filter(|(path, _)| *path != changed.0).copied().collect();
        hash(&Tree::of(&[&files[..], &[changed]].concat()), row)
    }

    #[test]
    fn a_row_is_stale_when_code_that_it_uses_changes_and_not_for_prose() {
        let mut row = sample();
        row.models.clear();
        let now = hash(&Tree::of(&TREE), &row);
        assert_ne!(now, with(("crates/core/src/a.rs", "fn a() { b() }\n"), &row), "through the link crate");
        assert_ne!(now, with(("verification/src/ring.rs", "use retrace_link::crc as c;\n"), &row));
        assert_ne!(now, with(("verification/src/choice.rs", "x"), &row));
        assert_ne!(now, with((ENGINE, "fn run() {}\n"), &row));
        assert_eq!(now, with(("crates/core/src/a.rs", "// prose\n  fn a() {}\n"), &row));
        assert_eq!(now, with(("crates/card/src/c.rs", "fn d() {}\n"), &row));
    }

    #[test]
    fn the_files_that_a_thread_model_includes_are_hashed() {
        let row = sample();
        let model =
            ("verification/loom/src/lib.rs", "#[path = \"../../../crates/journal/src/queue.rs\"]\nmod queue;\n");
        let tree = |queue| Tree::of(&[&TREE[..5], &[model, ("crates/journal/src/queue.rs", queue)]].concat());
        assert_ne!(hash(&tree("fn q() {}"), &row), hash(&tree("fn r() {}"), &row));
    }
}
