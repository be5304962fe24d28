//! `retrace serve`: the machine with its page in a browser, and its demonstration.
//!
//! Invariant: the demonstration runs on the simulated card, in a folder of its own.

use std::path::{Path, PathBuf};

use retrace_config::NumberedError;

use crate::args;
use crate::command_failure::CommandFailure;
use crate::files::unwritable;
use crate::run;

/// Path length after which the arc of the demonstration is lost, mm.
const DEMO_FAULTS: &str = "lose@300";

/// Files of the demonstration.
const DEMO_FILES: [(&str, &str); 2] =
    [("table.toml", include_str!("demo/table.toml")), ("programs/table.ngc", include_str!("demo/table.ngc"))];

/// Runs the command. Returns its exit code.
///
/// # Errors
/// Whatever prevents the machine or the page from being opened.
pub fn run(mut args: args::Run) -> Result<u8, CommandFailure> {
    args.page.serve = true;
    let folder = if args.page.demo { Some(DemoFolder::create()?) } else { None };
    if let Some(folder) = &folder {
        args.reading.program = folder.0.join("programs/table.ngc");
        args.machine_file.machine = Some(folder.0.join("table.toml"));
        args.source.source_faults = Some(DEMO_FAULTS.into());
        args.page.programs.get_or_insert_with(|| folder.0.join("programs"));
        args.jobs.journal.get_or_insert_with(|| folder.0.join("jobs"));
    }
    run::run(args)
}

/// Folder of the demonstration, which is removed at its end.
struct DemoFolder(PathBuf);

impl DemoFolder {
    fn create() -> Result<Self, NumberedError> {
        let folder = std::env::temp_dir().join(format!("retrace-demo-{}", std::process::id()));
        let failed = |error: &std::io::Error| unwritable(&folder.display().to_string(), error);
        std::fs::create_dir_all(folder.join("programs")).map_err(|error| failed(&error))?;
        let demo = Self(folder.clone());
        for (name, text) in DEMO_FILES {
            write(&folder.join(name), text).map_err(|error| failed(&error))?;
        }
        Ok(demo)
    }
}

fn write(path: &Path, text: &str) -> std::io::Result<()> {
    std::fs::write(path, text)
}

impl Drop for DemoFolder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
