//! `retrace shop recall`, `give-up`, `good` and `scrap`: entries that a person makes in the ledger.
//!
//! Invariant: state and entry belong together: the ledger is locked from the look at the state to the entry.

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use retrace_shop::{
    LedgerEntry, LedgerJob, LedgerRun, OpenLedger, RunOutcome, RunState, ShopFile, ShopJobState, give_back, run_state,
};

use super::host;
use super::shop_jobs::{FoundJob, ShopJobs};

/// Takes a job back (SHP-14): one of this machine, or one that was submitted here to another machine.
///
/// # Errors
/// `E5004` where there is none, `E5015` where it is running, interrupted or finished; those of the broker.
pub fn recall(file: &ShopFile, name: &str) -> Result<(), NumberedError> {
    let jobs = ShopJobs::read(file)?;
    let id = match jobs.find(name) {
        Ok(found) => found.id(),
        Err(unknown) => return host::recall(file, name, unknown),
    };
    match give_back(&jobs.machine, id)? {
        Some(state) => Err(unchangeable(&id.to_string(), state, "recalled")),
        None => {
            say!("job {id} is given back");
            Ok(())
        }
    }
}

/// Gives a job up.
///
/// # Errors
/// `E5004` where there is none, `E5015` where it is running or finished.
pub fn give_up(file: &ShopFile, name: &str) -> Result<(), NumberedError> {
    let allowed = [ShopJobState::Taken, ShopJobState::Ready, ShopJobState::Interrupted, ShopJobState::Unknown];
    let (mut open, job) = taken_job(file, name, "given up")?;
    require(&job, &allowed, "given up")?;
    let (id, when) = (job.job.id, Timestamp::now());
    open.append(LedgerEntry::GivenUp { when, id })?;
    say!("job {id} is given up after {} of {} pieces", job.good_pieces_now(), job.job.quantity);
    Ok(())
}

/// Marks the piece of a run as scrap (SHP-15).
///
/// # Errors
/// `E5004` where there is no such job, `E5020` where it has no such run, or the run is running.
pub fn scrap(file: &ShopFile, name: &str, run: &str) -> Result<(), NumberedError> {
    let (mut open, job) = taken_job(file, name, "marked as scrap")?;
    let run = run_of(&job, run)?;
    if run_state(run) == RunState::Running {
        return Err(no_such_run(&job, format!("run {} is running", run.id)));
    }
    open.append(LedgerEntry::Scrap { when: Timestamp::now(), id: job.job.id, run: run.id.clone() })?;
    say!("the piece of run {} is scrap", run.id);
    Ok(())
}

/// Counts a piece that was sent to an old machine as good (SHP-30): nobody but its operator knows.
///
/// # Errors
/// `E5004` where there is no such job, `E5020` where it has no such run, or the run has a journal or an end.
pub fn good(file: &ShopFile, name: &str, run: &str) -> Result<(), NumberedError> {
    let (mut open, job) = taken_job(file, name, "counted")?;
    let run = run_of(&job, run)?;
    if !run.is_sent() {
        return Err(no_such_run(&job, format!("run {} was not sent to an old machine: its journal counts", run.id)));
    }
    if run.outcome.is_some() || run.is_scrap {
        return Err(no_such_run(&job, format!("the piece of run {} is counted, or scrap", run.id)));
    }
    let (when, id, outcome) = (Timestamp::now(), job.job.id, RunOutcome::Completed);
    open.append(LedgerEntry::Ended { when, id, run: run.id.clone(), outcome })?;
    say!("the piece of run {} is good: {} of {}", run.id, job.good_pieces_now() + 1, job.job.quantity);
    Ok(())
}

/// The run of this name, or of a unique beginning of it.
fn run_of<'a>(job: &'a LedgerJob, run: &str) -> Result<&'a LedgerRun, NumberedError> {
    let mut near = job.runs.iter().filter(|known| !run.is_empty() && known.id.starts_with(run));
    let exact = job.runs.iter().find(|known| known.id == run);
    let found = exact.or_else(|| near.next().filter(|_| near.next().is_none()));
    found.ok_or_else(|| no_such_run(job, format!("job {} has no run {run}, or more than one begins so", job.job.id)))
}

fn no_such_run(job: &LedgerJob, what: String) -> NumberedError {
    let remedy = format!("`retrace shop show {}` lists the runs of the job", job.job.id);
    NumberedError::new("E5020", what, remedy)
}

/// A job of the ledger, which is locked.
fn taken_job(file: &ShopFile, name: &str, what: &str) -> Result<(OpenLedger, LedgerJob), NumberedError> {
    let jobs = ShopJobs::read(file)?;
    let id = match jobs.find(name)? {
        FoundJob::Listed(job) => job.job.id,
        FoundJob::Queued(job) => return Err(unchangeable(&job.id.to_string(), ShopJobState::Queued, what)),
    };
    let open = OpenLedger::open(&jobs.machine.ledger())?;
    match open.ledger().job(id).cloned() {
        Some(job) => Ok((open, job)),
        None => Err(unchangeable(&id.to_string(), ShopJobState::Queued, what)),
    }
}

fn require(job: &LedgerJob, allowed: &[ShopJobState], what: &str) -> Result<(), NumberedError> {
    let state = job.state();
    if allowed.contains(&state) { Ok(()) } else { Err(unchangeable(&job.job.id.to_string(), state, what)) }
}

fn unchangeable(id: &str, state: ShopJobState, what: &str) -> NumberedError {
    let remedy = match state {
        ShopJobState::Running => "wait for its end, or stop it at the machine",
        ShopJobState::Interrupted => "resume it at the machine with `retrace resume`, or give it up there",
        ShopJobState::Queued => "`retrace shop recall` takes back a job that waits",
        _ => "nothing is left to be done",
    };
    NumberedError::new("E5015", format!("job {id} is {}, and cannot be {what}", state.word()), remedy)
}
