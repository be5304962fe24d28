//! Which crate may use which: the arrows of `ARCHITECTURE.md`, held against every `Cargo.toml`.
//!
//! Invariant: a member of the workspace that has no row here is refused, so that the table stays whole.

use super::Finding;
use retrace_task_support::tree::Tree;

/// One crate, and the crates of this workspace that it may use.
struct Arrows {
    manifest: &'static str,
    may_use: &'static [&'static str],
    /// What its tests may use besides.
    in_tests: &'static [&'static str],
    /// May it use crates from outside this workspace? Its tests always may.
    outside: bool,
}

const fn arrows(manifest: &'static str, may_use: &'static [&'static str]) -> Arrows {
    Arrows { manifest, may_use, in_tests: &[], outside: true }
}

impl Arrows {
    fn allow(&self, name: &str, for_tests: bool) -> bool {
        self.may_use.contains(&name) || for_tests && self.in_tests.contains(&name)
    }
}

const ARROWS: &[Arrows] = &[
    Arrows { outside: false, ..arrows("crates/core/Cargo.toml", &[]) },
    Arrows { outside: false, ..arrows("crates/cycles/Cargo.toml", &[]) },
    arrows("crates/gcode/Cargo.toml", &["cycles"]),
    // The targets of cargo-fuzz: outside of the workspace, with nothing of ours but what they fuzz.
    arrows("crates/gcode/fuzz/Cargo.toml", &["gcode"]),
    arrows("crates/link/Cargo.toml", &["core"]),
    arrows("crates/motion/Cargo.toml", &["core"]),
    arrows("crates/card/Cargo.toml", &["core", "link"]),
    arrows("crates/hal-sim/Cargo.toml", &["card", "core", "link"]),
    // Its example measures the way from a key to the simulated card.
    Arrows { in_tests: &["core", "hal-sim"], ..arrows("crates/hal-serial/Cargo.toml", &["link"]) },
    arrows("crates/config/Cargo.toml", &["core", "link", "motion"]),
    arrows("crates/real-time/Cargo.toml", &[]),
    arrows("crates/journal/Cargo.toml", &["config", "core", "gcode", "link", "real-time"]),
    // The controller knows no backend; its tests run on the simulated card.
    Arrows {
        in_tests: &["card", "hal-sim"],
        ..arrows("crates/controller/Cargo.toml", &["config", "core", "gcode", "journal", "link", "motion", "real-time"])
    },
    arrows("crates/plot/Cargo.toml", &[]),
    // The screen knows no backend; its tests record a program on the simulated card.
    Arrows {
        in_tests: &["hal-sim"],
        ..arrows("crates/tui/Cargo.toml", &["config", "controller", "core", "gcode", "journal", "link", "motion"])
    },
    // Nothing of a shop can move a machine: it knows the journals, and neither the controller nor a card (SHP-12).
    arrows("crates/shop/Cargo.toml", &["config", "journal"]),
    // The page shows the model of the terminal screen and sends the same commands.
    arrows("crates/serve/Cargo.toml", &["config", "controller", "core", "journal", "link", "real-time", "tui"]),
    arrows(
        "crates/cli/Cargo.toml",
        &[
            "config",
            "controller",
            "core",
            "cycles",
            "gcode",
            "hal-serial",
            "hal-sim",
            "journal",
            "link",
            "motion",
            "plot",
            "real-time",
            "serve",
            "shop",
            "tui",
        ],
    ),
    // The card on a microcontroller: outside of the workspace, since it is compiled for another machine.
    arrows("crates/firmware/Cargo.toml", &["card", "core", "link"]),
    arrows("verification/Cargo.toml", &["card", "core", "link"]),
    arrows("verification/loom/Cargo.toml", &["config", "core", "journal"]),
    arrows("verification/shuttle/Cargo.toml", &["core"]),
    // The end-to-end tests see the command alone, so that they judge it with nothing of its own. The task support finds
    // them a browser.
    arrows("tests/Cargo.toml", &["task-support"]),
    // A host application of others, outside of the workspace, with nothing of ours.
    arrows("tests/sparkplug-host/Cargo.toml", &[]),
    // The judge of cuts has nothing of ours and nothing of others.
    Arrows { outside: false, ..arrows("tests/judge/Cargo.toml", &[]) },
    arrows("bench/Cargo.toml", &["task-support"]),
    arrows("verification/engines/Cargo.toml", &["task-support"]),
    arrows("xtask/Cargo.toml", &["bench", "hal-serial", "verify", "task-support"]),
    arrows("xtask/support/Cargo.toml", &[]),
];

const OURS: &str = "retrace-";

pub(super) fn find(tree: &Tree) -> Vec<Finding> {
    tree.texts()
        .filter(|(path, _)| path.ends_with("/Cargo.toml"))
        .flat_map(|(path, text)| match ARROWS.iter().find(|arrows| arrows.manifest == path) {
            Some(arrows) => offences(arrows, text),
            None => vec![Finding::of_file(path, "this crate has no row in the table of arrows (xtask, directions.rs)")],
        })
        .collect()
}

fn offences(arrows: &Arrows, text: &str) -> Vec<Finding> {
    let mut findings = Vec::new();
    for Dependency { line, name, for_tests } in dependencies(text) {
        match name.strip_prefix(OURS) {
            Some(ours) if !arrows.allow(ours, for_tests) => {
                findings.push(Finding::at(arrows.manifest, line, format!("no arrow leads from here to `{name}`")));
            }
            None if !arrows.outside && !for_tests => {
                let message = format!("this crate depends on nothing, but names `{name}`");
                findings.push(Finding::at(arrows.manifest, line, message));
            }
            _ => {}
        }
    }
    findings
}

struct Dependency {
    line: usize,
    name: String,
    for_tests: bool,
}

/// The dependencies of a manifest, as far as its tables are written in the usual ways.
fn dependencies(text: &str) -> Vec<Dependency> {
    let mut found = Vec::new();
    // What the table we stand in holds: nothing of ours, a list of dependencies, or one dependency's own keys.
    let mut list_for_tests: Option<bool> = None;
    for (index, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        if let Some(header) = line.strip_prefix('[') {
            let header = header.trim_end_matches(']').trim();
            let (table, name) = match header.split_once("dependencies") {
                Some((before, after)) => (Some(before), after.strip_prefix('.')),
                None => (None, None),
            };
            let for_tests = table.map(|before| before.ends_with("dev-"));
            list_for_tests = if name.is_some() { None } else { for_tests };
            if let (Some(name), Some(for_tests)) = (name, for_tests) {
                found.push(Dependency { line: index + 1, name: unquoted(name), for_tests });
            }
        } else if let (Some(for_tests), Some((key, value))) = (list_for_tests, line.split_once('=')) {
            let key = unquoted(key.split('.').next().unwrap_or(key));
            let renamed = value.split_once("package").and_then(|(_, rest)| rest.split('"').nth(1)).map(str::to_owned);
            found.push(Dependency { line: index + 1, name: renamed.unwrap_or(key), for_tests });
        }
    }
    found
}

fn unquoted(name: &str) -> String {
    name.trim().trim_matches('"').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(path: &str, text: &str) -> Vec<usize> {
        find(&Tree::of(&[(path, text)])).iter().map(|finding| finding.line).collect()
    }

    #[test]
    fn an_arrow_that_points_back_is_refused_in_every_spelling() {
        let text = "[package]\nname = \"x\"\n[dependencies]\nretrace-core.workspace = true\nretrace-motion = { path = \
            \"..\" }\n\
                    m = { package = \"retrace-motion\" }\n[dependencies.retrace-gcode]\npath = \"..\"\n\
                    [dev-dependencies]\nretrace-card.workspace = \
                    true\n[target.'cfg(unix)'.dependencies]\n\"retrace-cli\" = \"1\"\n";
        assert_eq!(lines("crates/link/Cargo.toml", text), [5, 6, 7, 10, 12]);
    }

    #[test]
    fn the_shop_reaches_nothing_that_moves_a_machine() {
        let mut reached = vec!["shop"];
        let mut next = 0;
        while let Some(name) = reached.get(next) {
            let manifest = format!("crates/{name}/Cargo.toml");
            let row = ARROWS.iter().find(|arrows| arrows.manifest == manifest).expect("a row");
            let new = row.may_use.iter().filter(|name| !reached.contains(*name)).copied().collect::<Vec<_>>();
            reached.extend(new);
            next += 1;
        }
        for mover in ["controller", "serve", "tui", "card", "hal-sim", "hal-serial", "cli"] {
            assert!(!reached.contains(&mover), "{mover} is reached: {reached:?}");
        }
        assert_eq!(lines("crates/shop/Cargo.toml", "[dependencies]\nretrace-controller.workspace = true\n"), [2]);
        assert_eq!(lines("crates/shop/Cargo.toml", "[dependencies]\nretrace-gcode.workspace = true\n"), [2]);
    }

    #[test]
    fn core_may_use_others_in_its_tests_only() {
        let text = "[dependencies]\nserde = \"1\" # why\n[dev-dependencies]\nproptest.workspace = true\n";
        assert_eq!(lines("crates/core/Cargo.toml", text), [2]);
        assert!(lines("crates/link/Cargo.toml", text).is_empty());
    }

    #[test]
    fn what_tests_may_use_the_crate_itself_may_not() {
        let text =
            "[dependencies]\nretrace-hal-sim.workspace = true\n[dev-dependencies]\nretrace-hal-sim.workspace = true\n";
        assert_eq!(lines("crates/controller/Cargo.toml", text), [2]);
    }

    #[test]
    fn a_crate_without_a_row_is_refused() {
        assert_eq!(lines("crates/new/Cargo.toml", ""), [0]);
    }
}
