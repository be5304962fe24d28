//! Starts a run of a shop job, by `retrace run --job` at this machine's own terminal (SHP-12).
//!
//! Invariant: the ledger has `started`, with the name of the run's journal, before anything moves. The ledger is locked
//! from the look at the state of the job to that entry, so that a piece is started once.

use retrace_config::NumberedError;
use retrace_shop::{RunRecorder, ShopFile};

use crate::args;
use crate::command_failure::CommandFailure;
use crate::shop_piece::{
    JobPiece, check_machine_file, check_repeat, not_repeatable, piece_of, read_jobs, ready_job, record_ended_runs,
};
use crate::{files, resume as resume_command, run as run_command};

/// Runs the next piece of a shop job, or several, one after the other. Returns the exit code.
///
/// # Errors
/// `E5004` where there is no such job, `E5012` where it is not ready, `E5013` where it has all its pieces, `E5014`
/// where it was made for another machine file, `E5006` where its files were changed, `E5043` where more pieces are to
/// be run than it permits; and as [`run_command::run`].
pub fn run(args: args::Run) -> Result<u8, CommandFailure> {
    let pieces = args.shop.repeat.unwrap_or(1);
    for number in 1..=pieces {
        let mut piece = args.clone();
        let recorder = prepare(&mut piece, pieces - number)?;
        if pieces > 1 {
            eprintln!("piece {number} of {pieces}");
        }
        piece.shop.recorder = Some(recorder.clone());
        let done = run_command::run(piece);
        print_error(record_ended_runs(&recorder.ledger()));
        // whatever is not the end of the program ends the series
        if number == pieces || !matches!(done, Ok(0)) {
            return done;
        }
    }
    Err(not_repeatable("0 pieces are none".into(), "give a number from 1").into())
}

/// Error of `retrace serve --job`: the operator chooses the job on the page, where it is shown what is started.
#[must_use]
pub fn page_refusal() -> NumberedError {
    let what = "`retrace serve` begins with no job of the shop";
    NumberedError::new("E5012", what, "choose it on the page, in *Shop*; or `retrace run --job ID` at the terminal")
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

/// Finds the job and names its program on the command line.
fn prepare(args: &mut args::Run, more: u32) -> Result<RunRecorder, NumberedError> {
    let name = args.shop.job.clone().unwrap_or_default();
    let file = ShopFile::load(args.shop.shop_file.as_deref())?;
    if args.machine_file.machine.is_none() {
        args.machine_file.machine.clone_from(&file.machine_file);
    }
    let jobs = read_jobs(&file)?;
    let id = jobs.find(&name)?.id();
    let job = ready_job(&jobs, id)?;
    check_repeat(job, more)?;
    let path = args.machine_file.path();
    if let Some(warning) = check_machine_file(&job.job, path, &files::machine_text(path)?)? {
        eprintln!("warning: {}", crate::escape::lines(&warning));
    }
    let JobPiece { recorder, program, cycles } = piece_of(&jobs, job)?;
    args.reading.program = program;
    // Its own cycles, or those of the command line.
    if cycles.is_some() {
        args.reading.cycle_folders.cycles = cycles;
    }
    Ok(recorder)
}
