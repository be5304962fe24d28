//! `retrace serve`: the machine with its page in a browser, and its demonstration.
//!
//! Invariant: the demonstration runs on the simulated card, in a folder of its own.

use std::path::{Path, PathBuf};

use retrace_config::NumberedError;

use crate::args;
use crate::command_failure::CommandFailure;
use crate::files::unwritable;
use crate::{resume, run};

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
    let done = run::run(args.clone());
    while_resuming(&args, done, || run::run(args.clone()))
}

/// Resumes a job, operated on the page. Returns its exit code.
///
/// # Errors
/// Whatever prevents the job from being resumed.
pub fn resume(args: &args::Resume) -> Result<u8, CommandFailure> {
    let done = resume::run(args);
    while let Some(job) = args.page.session.take_resume() {
        resume::run(&args::Resume { job: Some(job), yes: false, ..args.clone() })?;
    }
    done
}

/// Resumes the jobs that the page asks for. Where one cannot be resumed, the machine is opened again, and says why.
fn while_resuming(
    args: &args::Run,
    mut done: Result<u8, CommandFailure>,
    reopen: impl Fn() -> Result<u8, CommandFailure>,
) -> Result<u8, CommandFailure> {
    while let Some(job) = args.page.session.take_resume() {
        done = resume::run(&resume_args(args, job.clone()));
        if let Err(failure) = &done {
            let text = failure.to_string();
            args.page.session.set_notice(format!("job {job} is not resumed: {}", text.replace('\n', " ")));
            done = reopen();
        }
    }
    done
}

fn resume_args(args: &args::Run, job: String) -> args::Resume {
    args::Resume {
        job: Some(job),
        jobs: args.jobs.clone(),
        card: Some(args.port.card.clone()),
        yes: false,
        program: None,
        from_line: None,
        assume_position: false,
        work: args.work.clone(),
        operation: args.operation.clone(),
        page: args.page.clone(),
        format: args.format,
        machine: None,
    }
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
