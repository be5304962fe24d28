//! What a release is made of: the book, the packages, the licences, the archives.
//!
//! Invariant: nothing here publishes anything; what could not be built is named with the reason.

pub(crate) mod book;
pub(crate) mod dist;
pub(crate) mod licences;
pub(crate) mod package;

use std::process::Command;

/// Runs a command and says whether it succeeded; a command that cannot be run is reported.
fn succeeds(command: &mut Command) -> bool {
    match command.status() {
        Ok(status) => status.success(),
        Err(error) => {
            eprintln!("xtask: {} cannot be run: {error}", command.get_program().to_string_lossy());
            false
        }
    }
}

/// Reports the reason of a failure; true without one.
fn reported(task: &str, result: Result<(), String>) -> bool {
    if let Err(reason) = &result {
        eprintln!("{task}: {reason}");
    }
    result.is_ok()
}
