//! The next piece of a shop job: what is verified before it is started, at the terminal and at the screen alike.
//!
//! Invariant: a piece is a job that is ready, whose files are those that were submitted, and whose machine file permits
//! it. Nothing here starts it.

use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_shop::{ContentHash, Inbox, LedgerJob, OpenLedger, RunRecorder, ShopFile, ShopJob, ShopJobId};

use crate::shop::ShopJobs;

/// Writes to the ledger which runs have ended.
///
/// # Errors
/// `E5009`, `E5010`
pub fn record_ended_runs(ledger: &Path) -> Result<(), NumberedError> {
    if ledger.exists() { OpenLedger::open(ledger)?.record_ended_runs() } else { Ok(()) }
}

/// Prepares the next piece of a job, behind which so many more follow, for the screen of a machine that runs with this
/// machine file: the same checks as before `retrace run --job`.
///
/// # Errors
/// `E5004` where there is no such job, `E5012` where it is not ready, `E5013` where it has all its pieces, `E5014`
/// where it was made for another machine file, `E5006` where its files were changed, `E5043` where so many pieces are
/// not permitted.
pub fn prepare_at_screen(
    shop_file: Option<&Path>,
    (id, more): (&str, u32),
    machine_file: (Option<&Path>, &str),
) -> Result<JobPiece, NumberedError> {
    let jobs = read_jobs(&ShopFile::load(shop_file)?)?;
    // A screen names a job in full: a beginning is for people who type.
    let id = id.parse::<ShopJobId>().or_else(|_| jobs.find(id).and(Err(no_full_name(id))))?;
    let job = ready_job(&jobs, id)?;
    check_repeat(job, more)?;
    check_machine_file(&job.job, machine_file.0, machine_file.1)?;
    piece_of(&jobs, job)
}

fn no_full_name(id: &str) -> NumberedError {
    NumberedError::new("E5004", format!("{id} is not the whole name of a job"), "name it as the list of jobs does")
}

/// Reads the jobs, once the runs that have ended are in the ledger.
///
/// # Errors
/// `E5009`, `E5010`
pub fn read_jobs(file: &ShopFile) -> Result<ShopJobs, NumberedError> {
    record_ended_runs(&file.machine_folder().ledger())?;
    Ok(ShopJobs::read_silently(file)?.0)
}

/// The job of this identity, which is ready, and whose files are those that were submitted.
///
/// # Errors
/// `E5012`, `E5013` where it is not ready; `E5006` where its files were changed.
pub fn ready_job(jobs: &ShopJobs, id: ShopJobId) -> Result<&LedgerJob, NumberedError> {
    let job = jobs.ledger.job(id).ok_or_else(|| RunRecorder::not_taken(id))?;
    job.require_ready()?;
    Inbox::of(&jobs.machine).verify(job)?;
    Ok(job)
}

/// The next run of a job.
pub struct JobPiece {
    /// Recorder of the run.
    pub recorder: RunRecorder,
    /// Its program.
    pub program: PathBuf,
    /// Folder of its cycles, with which alone it is run; `None`: those of the machine.
    pub cycles: Option<PathBuf>,
}

/// The next run of a job.
///
/// # Errors
/// `E5006`, `E5010` where its list of files was changed or cannot be read.
pub fn piece_of(jobs: &ShopJobs, job: &LedgerJob) -> Result<JobPiece, NumberedError> {
    let inbox = Inbox::of(&jobs.machine);
    let program = inbox.program(job);
    let recorder = RunRecorder::new(jobs.machine.clone(), job.job.id, program.display().to_string());
    Ok(JobPiece { recorder, program, cycles: inbox.cycles(job)? })
}

/// Checks that so many pieces more may be run behind the next one.
///
/// # Errors
/// `E5043` where they may not.
pub fn check_repeat(job: &LedgerJob, more: u32) -> Result<(), NumberedError> {
    let id = job.job.id;
    let missing = missing_pieces(job);
    if more > 0 && !job.job.may_repeat {
        let remedy = "start each piece by itself; `submit --may-repeat` permits a series";
        return Err(not_repeatable(format!("job {id} does not permit a series of pieces"), remedy));
    }
    if more >= missing {
        let what = format!("{missing} pieces of job {id} are missing, and not {}", more + 1);
        return Err(not_repeatable(what, "give the number of those that are missing, or less"));
    }
    Ok(())
}

/// `E5043`: a series of pieces cannot be run.
pub fn not_repeatable(what: String, remedy: &str) -> NumberedError {
    NumberedError::new("E5043", what, remedy)
}

/// Number of pieces of a job that are not good yet.
fn missing_pieces(job: &LedgerJob) -> u32 {
    job.job.quantity.saturating_sub(job.good_pieces_now())
}

/// Compares the machine file with the one that the job was made for. Returns the warning where it is another one.
///
/// # Errors
/// `E5014` where the job permits no other one.
pub fn check_machine_file(job: &ShopJob, path: Option<&Path>, text: &str) -> Result<Option<String>, NumberedError> {
    let Some(demand) = job.machine_file.filter(|demand| ContentHash::of(text.as_bytes()) != demand.hash) else {
        return Ok(None);
    };
    let what = format!("job {} was made for another machine file than {}", job.id, machine_file_name(path));
    if demand.is_required {
        let remedy = "name the right one with --machine, or submit the job again";
        return Err(NumberedError::new("E5014", what, remedy));
    }
    Ok(Some(what))
}

/// Name of a machine file for people.
pub fn machine_file_name(path: Option<&Path>) -> String {
    path.map_or("the built-in machine".into(), |path| path.display().to_string())
}
