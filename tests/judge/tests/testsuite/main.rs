//! Tests of the judge as a program: it must find every seeded defect of a controller, and nothing in a trace without
//! one.
//!
//! Invariant: the traces are written here, so that neither the judge nor the controller has a part in them.

mod command;
mod defects;
mod heights;
mod synthetic;

use std::path::PathBuf;
use std::process::{Command, Output};

/// A folder for the files of one test.
pub(crate) fn folder(test: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(test);
    std::fs::create_dir_all(&folder).expect("a folder for the traces");
    folder
}

/// Runs the judge.
pub(crate) fn cut_judge(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cut-judge")).args(arguments).output().expect("the judge runs")
}

/// The value of a figure in a line of the judge, as it is written.
pub(crate) fn figure<'l>(line: &'l str, name: &str) -> &'l str {
    let (_, rest) = line.split_once(&format!("\"{name}\":")).unwrap_or_else(|| panic!("no {name} in {line}"));
    rest.split([',', '}']).next().unwrap_or_default()
}
