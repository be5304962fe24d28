//! The modules of a crate use each other in one direction: nothing below uses what is built on it.
//!
//! A module is a file or a folder of `src`. It uses another one where its code, without its tests, names
//! `crate::other`, or an item that `lib.rs` passes on from there with `pub use other::{…}`.
//!
//! Invariant: a cycle is named by its modules, in alphabetical order; one that is accepted is in [`ACCEPTED`].

use super::Finding;
use retrace_task_support::tree::{Tree, code_only, is_word};
use std::collections::{BTreeMap, BTreeSet};

/// Cycles that are accepted: the crate, and its modules. One that was untied is to be taken out.
const ACCEPTED: &[(&str, &[&str])] = &[
    // a file's scan opens the files that it calls in the pre-scan that it is a part of
    ("crates/gcode/src/", &["file_scan", "prescan"]),
];

/// Modules, each with those that it uses.
type Graph = BTreeMap<String, BTreeSet<String>>;

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    let roots = tree.paths().filter_map(|path| path.strip_suffix("lib.rs").or_else(|| path.strip_suffix("main.rs")));
    let roots: BTreeSet<&str> = roots.filter(|root| root.starts_with("crates/") && root.ends_with("/src/")).collect();
    let mut findings = Vec::new();
    for root in roots {
        let found = cycles(&graph(tree, root));
        let accepted: Vec<&[&str]> = ACCEPTED.iter().filter(|(of, _)| *of == root).map(|(_, cycle)| *cycle).collect();
        for cycle in found.iter().filter(|cycle| !accepted.iter().any(|modules| modules == cycle)) {
            findings.push(Finding::of_file(root, format!("these modules use each other: {}", cycle.join(", "))));
        }
        for modules in accepted.iter().filter(|modules| !found.iter().any(|cycle| *modules == cycle)) {
            let message = format!("these modules are untied, but accepted in module_cycles.rs: {}", modules.join(", "));
            findings.push(Finding::of_file(root, message));
        }
    }
    findings
}

/// The modules of the crate with this `src` folder.
fn graph(tree: &Tree, root: &str) -> Graph {
    let mut code = BTreeMap::<String, String>::new();
    for (path, text) in tree.rust().filter(|(path, _)| path.starts_with(root)) {
        let module = path[root.len()..].split(['/', '.']).next().unwrap_or_default();
        let own = code_only(text);
        let own = own.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
        code.entry(module.to_owned()).or_default().push_str(own);
    }
    let exported = code.get("lib").map(|lib| exports(lib)).unwrap_or_default();
    let modules: BTreeSet<String> =
        code.keys().filter(|name| !matches!(name.as_str(), "lib" | "main")).cloned().collect();
    let used = |own: &str, text: &str| -> BTreeSet<String> {
        let names = crate_names(text).into_iter();
        let names =
            names.map(|name| if modules.contains(&name) { name } else { exported.get(&name).cloned().unwrap_or(name) });
        names.filter(|name| name != own && modules.contains(name)).collect()
    };
    modules.iter().map(|name| (name.clone(), used(name, &code[name]))).collect()
}

/// What `pub use module::{…}` passes on: each item with its module.
fn exports(lib: &str) -> BTreeMap<String, String> {
    let mut exported = BTreeMap::new();
    for (at, found) in lib.match_indices("pub use ") {
        let statement = lib[at + found.len()..].split(';').next().unwrap_or_default();
        let Some((module, items)) = statement.trim_start_matches("self::").split_once("::") else { continue };
        for item in words(items) {
            exported.insert(item, module.to_owned());
        }
    }
    exported
}

/// Every name that follows `crate::`, also in a list.
fn crate_names(code: &str) -> Vec<String> {
    let mut names = Vec::new();
    for (at, found) in code.match_indices("crate::") {
        let rest = &code[at + found.len()..];
        match rest.strip_prefix('{') {
            None => names.extend(words(rest).into_iter().next()),
            Some(list) => names.extend(first_words(list)),
        }
    }
    names
}

/// The first word of each item of a list that ends with its brace.
fn first_words(list: &str) -> Vec<String> {
    let (mut depth, mut item, mut found) = (0, String::new(), Vec::new());
    for letter in list.chars() {
        match letter {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => found.extend(words(&std::mem::take(&mut item)).into_iter().next()),
            _ if depth == 0 => item.push(letter),
            _ => {}
        }
    }
    found.extend(words(&item).into_iter().next());
    found
}

fn words(text: &str) -> Vec<String> {
    let words = text.split(|letter: char| !letter.is_ascii() || !is_word(letter as u8));
    words.filter(|word| !word.is_empty()).map(str::to_owned).collect()
}

/// Sets of modules that use each other, directly or through others.
fn cycles(graph: &Graph) -> Vec<Vec<String>> {
    let reach: BTreeMap<&String, BTreeSet<&String>> = graph.keys().map(|name| (name, reached(graph, name))).collect();
    let mut cycles: Vec<Vec<String>> = Vec::new();
    for name in graph.keys() {
        let with: Vec<String> =
            reach[name].iter().filter(|other| reach[**other].contains(name)).map(|other| (*other).clone()).collect();
        if with.len() > 1 && !cycles.contains(&with) {
            cycles.push(with);
        }
    }
    cycles
}

/// What a module uses, directly or through others.
fn reached<'g>(graph: &'g Graph, from: &str) -> BTreeSet<&'g String> {
    let (mut seen, mut open) = (BTreeSet::new(), vec![from]);
    while let Some(name) = open.pop() {
        for next in graph.get(name).into_iter().flatten() {
            if seen.insert(next) {
                open.push(next);
            }
        }
    }
    seen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modules_that_use_each_other_are_named() {
        let tree = Tree::of(&[
            ("crates/a/src/lib.rs", "mod plan;\nmod run;\nmod text;\npub use run::{Run, RunError};\n"),
            ("crates/a/src/plan.rs", "use crate::{Run, text::{self, Line}};\n"),
            ("crates/a/src/run/mod.rs", "use crate::text;\n"),
            ("crates/a/src/run/end.rs", "// crate::text\nfn end() { crate::plan::close() }\n"),
            ("crates/a/src/text.rs", "#[cfg(test)]\nmod tests {\n    use crate::plan;\n}\n"),
        ]);
        let messages: Vec<_> = find(&tree).into_iter().map(|finding| finding.message).collect();
        assert_eq!(messages, ["these modules use each other: plan, run"]);
    }
}
