//! The project's own rules, which no other tool knows, each a pure function of the tree.
//!
//! Invariant: every check has a unit test that shows a tree it refuses.

pub(crate) mod book_pages;
mod directions;
mod error_catalogue;
mod error_numbers;
mod error_types;
mod figures;
mod line_width;
mod links;
mod machine_names;
mod module_cycles;
mod module_docs;
mod named_paths;
mod requirements;
mod shop_commands;
mod sizes;
mod unsafe_code;

use retrace_task_support::tree::Tree;
use std::path::Path;

/// What a check has to say of one place.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Finding {
    /// The file, from the workspace's root.
    path: String,
    /// The line, from 1; 0 where the whole file is meant.
    line: usize,
    message: String,
    /// A warning is shown and does not fail the check.
    is_warning: bool,
}

impl Finding {
    fn at(path: &str, line: usize, message: impl Into<String>) -> Self {
        Self { path: path.to_owned(), line, message: message.into(), is_warning: false }
    }

    fn of_file(path: &str, message: impl Into<String>) -> Self {
        Self::at(path, 0, message)
    }

    fn into_warning(self) -> Self {
        Self { is_warning: true, ..self }
    }
}

/// One rule: its name, its text, and what finds offences against it.
pub(crate) struct Check {
    pub(crate) name: &'static str,
    pub(crate) rule: &'static str,
    find: fn(&Tree) -> Vec<Finding>,
}

/// Every rule, in the order in which it is checked.
pub(crate) const CHECKS: &[Check] = &[
    Check { name: "directions", rule: "crates use only what the table of arrows allows", find: directions::find },
    Check { name: "shop", rule: "retrace shop names nothing that can move a machine", find: shop_commands::find },
    Check {
        name: "unsafe",
        rule: "unsafe code stands in the record ring and the firmware's registers alone",
        find: unsafe_code::find,
    },
    Check {
        name: "errors",
        rule: "every error number is in docs/errors.md, and every one there is in use",
        find: error_numbers::find,
    },
    Check {
        name: "error-tests",
        rule: "every error number has a test that provokes it, or a reason in tests/error-catalogue.md",
        find: error_catalogue::find,
    },
    Check { name: "error-types", rule: "every error type implements Error", find: error_types::find },
    Check { name: "module-docs", rule: "every module opens with what its job is", find: module_docs::find },
    Check { name: "cycles", rule: "the modules of a crate use each other in one direction", find: module_cycles::find },
    Check { name: "sizes", rule: "a file stays short enough to be one noun", find: sizes::find },
    Check { name: "width", rule: "no line of Rust exceeds 120 columns", find: line_width::find },
    Check { name: "machine", rule: "no path or host of one machine is in the tree", find: machine_names::find },
    Check { name: "book", rule: "every page of docs/ is a chapter of the book", find: book_pages::find },
    Check { name: "links", rule: "every relative link in Markdown leads somewhere", find: links::find },
    Check { name: "paths", rule: "every file that a document names exists", find: named_paths::find },
    Check {
        name: "figures",
        rule: "the pictures in the documents are those that a command makes",
        find: figures::find,
    },
    Check {
        name: "requirements",
        rule: "docs/requirements.md has every requirement, and the code and tests that it names exist",
        find: requirements::find,
    },
];

/// Runs every check, prints what it finds, and says whether all passed.
pub(crate) fn run(root: &Path) -> bool {
    let tree = match Tree::read(root) {
        Ok(tree) => tree,
        Err(reason) => {
            eprintln!("tidy: {reason}");
            return false;
        }
    };
    let mut passed = true;
    for check in CHECKS {
        let findings = (check.find)(&tree);
        let errors = findings.iter().filter(|finding| !finding.is_warning).count();
        for Finding { path, line, message, is_warning } in &findings {
            let kind = if *is_warning { "warning" } else { "error" };
            let place = if *line == 0 { path.clone() } else { format!("{path}:{line}") };
            println!("{kind}[{}]: {place}: {message}", check.name);
        }
        println!("tidy {:<13} {}", check.name, if errors == 0 { "ok".to_owned() } else { format!("{errors} errors") });
        passed &= errors == 0;
    }
    passed
}
