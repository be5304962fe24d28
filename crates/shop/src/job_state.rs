//! State of a shop job, by its ledger entries and the journals of its runs.
//!
//! Invariant: a job is done when so many good pieces as it orders came to their end, and not before.

use crate::ledger::{LedgerJob, LedgerRun};
use crate::run_state::{RunState, run_state};

/// State of a job at its machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShopJobState {
    /// It waits to be taken.
    Queued,
    /// It was taken, and waits to be checked.
    Taken,
    /// It can be started.
    Ready,
    /// A run of it is running.
    Running,
    /// A run of it was interrupted, and can be resumed.
    Interrupted,
    /// The journal of a run is not there any more, or cannot be used: whether its piece is good is not known.
    Unknown,
    /// All pieces are good.
    Done,
    /// It was given up.
    EndedEarly,
    /// Its check found errors.
    Refused,
    /// It was given back.
    Returned,
}

impl ShopJobState {
    /// The state in words.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Taken => "taken",
            Self::Ready => "ready",
            Self::Running => "running",
            Self::Interrupted => "interrupted",
            Self::Unknown => "unknown",
            Self::Done => "done",
            Self::EndedEarly => "ended early",
            Self::Refused => "refused",
            Self::Returned => "returned",
        }
    }

    /// Whether nothing more can come of it: its files are not needed any more.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(self, Self::Done | Self::EndedEarly | Self::Refused | Self::Returned)
    }
}

impl LedgerJob {
    /// State of the job; reads the journals of its runs.
    #[must_use]
    pub fn state(&self) -> ShopJobState {
        let states: Vec<(&LedgerRun, RunState)> = self.runs.iter().map(|run| (run, run_state(run))).collect();
        let has = |state: RunState| states.iter().any(|&(run, of)| of == state && !run.is_scrap);
        // also a run whose piece is scrap moves the machine
        let is_running = states.iter().any(|&(_, of)| of == RunState::Running);
        if self.is_returned {
            ShopJobState::Returned
        } else if self.is_refused {
            ShopJobState::Refused
        } else if is_running {
            ShopJobState::Running
        } else if good_pieces(&states) >= self.job.quantity {
            ShopJobState::Done
        } else if self.is_given_up {
            ShopJobState::EndedEarly
        } else if has(RunState::Interrupted) {
            ShopJobState::Interrupted
        } else if has(RunState::Unknown) {
            ShopJobState::Unknown
        } else if self.check.is_some() {
            ShopJobState::Ready
        } else {
            ShopJobState::Taken
        }
    }

    /// Number of good pieces, by the ledger and the journals.
    #[must_use]
    pub fn good_pieces_now(&self) -> u32 {
        good_pieces(&self.runs.iter().map(|run| (run, run_state(run))).collect::<Vec<_>>())
    }
}

fn good_pieces(states: &[(&LedgerRun, RunState)]) -> u32 {
    states.iter().filter(|(run, state)| *state == RunState::Completed && !run.is_scrap).count() as u32
}
