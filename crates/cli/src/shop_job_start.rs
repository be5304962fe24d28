//! Starts a run of a shop job, by `retrace run --job` at this machine's own terminal (SHP-12).
//!
//! Invariant: the ledger has `started`, with the name of the run's journal, before anything moves. The ledger is locked
//! from the look at the state of the job to that entry, so that a piece is started once.

use std::path::Path;

use retrace_config::NumberedError;
use retrace_shop::{ContentHash, Inbox, LedgerJob, OpenLedger, RunRecorder, ShopFile};

use crate::args;
use crate::command_failure::CommandFailure;
use crate::shop::ShopJobs;
use crate::{files, resume as resume_command, run as run_command};

/// Runs the next piece of a shop job. Returns the exit code.
///
/// # Errors
/// `E5004` where there is no such job, `E5012` where it is not ready, `E5013` where it has all its pieces, `E5014`
/// where it was made for another machine file, `E5006` where its files were changed; and as [`run_command::run`].
pub fn run(mut args: args::Run) -> Result<u8, CommandFailure> {
    let recorder = prepare(&mut args)?;
    args.shop.recorder = Some(recorder.clone());
    let done = run_command::run(args);
    print_error(record_ended_runs(recorder.ledger()));
    done
}

/// Error of `retrace serve --job`: a page may be far away (SHP-12).
#[must_use]
pub fn page_refusal() -> NumberedError {
    let what = "a page does not start a job of the shop";
    NumberedError::new("E5012", what, "start it at the machine's terminal with `retrace run --job ID`")
}

/// Resumes a job, which may be a run of a shop job. Returns the exit code.
///
/// # Errors
/// As [`resume_command::run`].
pub fn resume(args: &args::Resume) -> Result<u8, CommandFailure> {
    let done = resume_command::run(args);
    // Only the usual shop is known here; the agent of another one records the end.
    if let Ok(file) = ShopFile::load(None) {
        print_error(record_ended_runs(&file.machine_folder().ledger()));
    }
    done
}

/// The run is over: an error of the ledger does not change its result.
fn print_error(done: Result<(), NumberedError>) {
    if let Err(refusal) = done {
        eprintln!("{}", crate::escape::lines(&refusal.to_string()));
    }
}

fn record_ended_runs(ledger: &Path) -> Result<(), NumberedError> {
    if ledger.exists() { OpenLedger::open(ledger)?.record_ended_runs() } else { Ok(()) }
}

/// Finds the job and names its program on the command line.
fn prepare(args: &mut args::Run) -> Result<RunRecorder, NumberedError> {
    let name = args.shop.job.clone().unwrap_or_default();
    let file = ShopFile::load(args.shop.shop_file.as_deref())?;
    record_ended_runs(&file.machine_folder().ledger())?;
    let jobs = ShopJobs::read(&file)?;
    let id = jobs.find(&name)?.id();
    let Some(job) = jobs.ledger.job(id) else { return Err(RunRecorder::not_taken(id)) };
    job.require_ready()?;
    let inbox = Inbox::of(&jobs.machine);
    inbox.verify(job)?;
    if args.machine_file.machine.is_none() {
        args.machine_file.machine = file.machine_file;
    }
    require_machine_file(job, args.machine_file.path())?;
    args.reading.program = inbox.program(job);
    let program = args.reading.program.display().to_string();
    Ok(RunRecorder::new(jobs.machine.ledger(), id, program))
}

/// Compares the machine file with the one that the job was made for.
fn require_machine_file(job: &LedgerJob, path: Option<&Path>) -> Result<(), NumberedError> {
    let Some(demand) = job.job.machine_file else { return Ok(()) };
    let text = files::machine_text(path)?;
    if ContentHash::of(text.as_bytes()) == demand.hash {
        return Ok(());
    }
    let name = path.map_or("the built-in machine".into(), |path| path.display().to_string());
    let what = format!("job {} was made for another machine file than {name}", job.job.id);
    let refusal = NumberedError::new("E5014", what, "name the right one with --machine, or submit the job again");
    if demand.is_required {
        return Err(refusal);
    }
    eprintln!("warning: {}", crate::escape::lines(&refusal.cause));
    Ok(())
}
