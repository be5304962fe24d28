//! `cargo xtask figures`: generates every picture of README and docs.
//!
//! Invariant: a picture that is neither measured nor of a screen depends on this checkout alone, so that generating it
//! again changes nothing.

use crate::firmware::target_folder;
use crate::suite;
use retrace_task_support::{process, tools};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

/// Folder of the pictures.
pub(crate) const FOLDER: &str = "docs/figures";

/// A picture.
pub(crate) struct Figure {
    /// Its name in [`FOLDER`].
    pub(crate) file: &'static str,
    made: Made,
}

/// Generator of a picture.
enum Made {
    /// `retrace plot` with these arguments.
    Plot(&'static [&'static str]),
    /// An example of a package prints it.
    Example { package: &'static str, example: &'static str },
    /// The wiring of a board of the firmware, which is a workspace of its own.
    Wiring(&'static str),
    /// A picture of the page in a browser, which an example of the tests prints. Its figures and texts differ a little
    /// from run to run.
    Page { example: &'static str },
    /// A bench draws its measurement; such a picture is not generated here.
    Bench(&'static str),
}

/// Every picture, in the order of their names.
pub(crate) const FIGURES: &[Figure] = &[
    Figure {
        file: "02-back-up.svg",
        made: Made::Plot(&[
            "examples/02-back-up.ngc",
            "--operator",
            "examples/02-back-up.op",
            "--machine",
            "examples/02-back-up.toml",
        ]),
    },
    Figure { file: "12-corners-profile.svg", made: Made::Plot(&["examples/12-corners.ngc", "--profile"]) },
    Figure { file: "corner.svg", made: Made::Example { package: "retrace-motion", example: "corner_figure" } },
    Figure { file: "page.png", made: Made::Page { example: "page_picture" } },
    Figure { file: "pre-scan.svg", made: Made::Bench("pre9") },
    Figure { file: "wiring-pico.svg", made: Made::Wiring("pico") },
    Figure { file: "wiring-stm32f4.svg", made: Made::Wiring("stm32f4") },
];

/// Generates all pictures, or those that are named, and returns whether all succeeded.
pub(crate) fn run(root: &Path, names: &[&str]) -> bool {
    let mut passed = true;
    for figure in FIGURES.iter().filter(|figure| names.is_empty() || names.contains(&figure.file)) {
        let path = format!("{FOLDER}/{}", figure.file);
        let before = fs::read(root.join(&path)).unwrap_or_default();
        match figure.make(root, &path) {
            Ok(None) => {
                let is_same = fs::read(root.join(&path)).is_ok_and(|now| now == before);
                println!("{path:<36} {}", if is_same { "unchanged" } else { "rewritten" });
            }
            Ok(Some(remark)) => println!("{path:<36} {remark}"),
            Err(reason) => {
                println!("{path:<36} FAILED: {reason}");
                passed = false;
            }
        }
    }
    passed
}

impl Figure {
    /// Generates the picture; returns a remark where it was left unchanged.
    fn make(&self, root: &Path, path: &str) -> Result<Option<String>, String> {
        match &self.made {
            Made::Plot(arguments) => retrace(root, &[&["plot"], *arguments, &["-o", path]].concat()),
            Made::Example { package, example } => {
                let picture = printed(root, &["-p", package, "--example", example])?;
                fs::write(root.join(path), picture).map_err(|error| error.to_string())
            }
            Made::Wiring(board) => {
                let folder = root.join("crates/firmware");
                let mut command = process::cargo(&folder, &["run", "-q", "--locked", "--example", "wiring", board]);
                let picture = output_of(command.env("CARGO_TARGET_DIR", target_folder(root).join("firmware")))?;
                fs::write(root.join(path), picture).map_err(|error| error.to_string())
            }
            Made::Page { .. } if tools::browser().is_none() => return Ok(Some("NOT RUN: no browser".into())),
            Made::Page { example } => {
                let binary = suite::build_command(root)?;
                let mut command = process::cargo(root, &["run", "-q", "-p", "retrace-tests", "--example", example]);
                let picture = output_of(command.env("RETRACE_BIN", binary))?;
                fs::write(root.join(path), picture).map_err(|error| error.to_string())
            }
            Made::Bench(name) => return Ok(Some(format!("measured: `cargo xtask bench {name}` draws it"))),
        }
        .map(|()| None)
    }
}

fn retrace(root: &Path, arguments: &[&str]) -> Result<(), String> {
    printed(root, &[&["-p", "retrace-cli", "--bin", "retrace", "--"], arguments].concat()).map(|_| ())
}

/// Output of `cargo run`.
fn printed(root: &Path, arguments: &[&str]) -> Result<Vec<u8>, String> {
    output_of(process::cargo(root, &["run", "-q", "--release"]).args(arguments))
}

/// Output of a command that must succeed.
fn output_of(command: &mut Command) -> Result<Vec<u8>, String> {
    command.stdin(Stdio::null());
    let output = command.stderr(Stdio::inherit()).output().map_err(|error| format!("cargo cannot be run: {error}"))?;
    if output.status.success() { Ok(output.stdout) } else { Err(output.status.to_string()) }
}
