//! State of a run, by its journal.
//!
//! Invariant: nothing is concluded from a journal that is not there.

use retrace_config::NumberedError;
use retrace_journal::{JobState, JobStore, Timestamp};

use crate::ledger::{LedgerRun, OpenLedger};
use crate::ledger_entry::{LedgerEntry, RunOutcome};

/// State of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunState {
    /// A process runs it.
    Running,
    /// A failure, an alarm or the operator stopped it; `retrace resume` continues it.
    Interrupted,
    /// The program came to its end.
    Completed,
    /// Nothing has moved.
    NeverBegan,
    /// Its journal is not there any more, or cannot be used; or its program was sent to an old machine, and the
    /// operator has not said what became of it.
    Unknown,
}

impl RunState {
    /// The state as one word.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Running => "running",
            Self::Interrupted => "interrupted",
            Self::Completed => "completed",
            Self::NeverBegan => "never began",
            Self::Unknown => "unknown",
        }
    }
}

/// State of a run: by the ledger where it is ended there, else by its journal.
#[must_use]
pub fn run_state(run: &LedgerRun) -> RunState {
    match run.outcome {
        Some(RunOutcome::Completed) => RunState::Completed,
        Some(RunOutcome::NeverBegan) => RunState::NeverBegan,
        None => journal_state(run),
    }
}

fn journal_state(run: &LedgerRun) -> RunState {
    if run.is_sent() {
        return RunState::Unknown;
    }
    // `find` accepts the beginning of a name, which may be that of another job
    let folder = JobStore::open(&run.journal).find(&run.id).ok().filter(|folder| folder.id() == run.id);
    match folder.map(|folder| folder.state()) {
        Some(JobState::Running(_)) => RunState::Running,
        Some(JobState::Interrupted | JobState::Stopped | JobState::Alarm) => RunState::Interrupted,
        Some(JobState::Completed) => RunState::Completed,
        Some(JobState::NeverBegan) => RunState::NeverBegan,
        Some(JobState::Unusable(_)) | None => RunState::Unknown,
    }
}

impl OpenLedger {
    /// Writes `ended` for every run whose journal has come to an end. Completed journals are deleted some day; the
    /// ledger is not.
    ///
    /// # Errors
    /// `E5010`
    pub fn record_ended_runs(&mut self) -> Result<(), NumberedError> {
        let open_runs = self.ledger().jobs().iter().flat_map(|job| {
            let is_open = |run: &&LedgerRun| run.outcome.is_none();
            job.runs.iter().filter(is_open).map(|run| (job.job.id, run))
        });
        let ended = open_runs.filter_map(|(id, run)| {
            let outcome = match journal_state(run) {
                RunState::Completed => RunOutcome::Completed,
                RunState::NeverBegan => RunOutcome::NeverBegan,
                _ => return None,
            };
            Some(LedgerEntry::Ended { when: Timestamp::now(), id, run: run.id.clone(), outcome })
        });
        let ended: Vec<LedgerEntry> = ended.collect();
        ended.into_iter().try_for_each(|entry| self.append(entry))
    }
}
