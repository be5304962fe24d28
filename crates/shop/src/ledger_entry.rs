//! Entries of a machine's ledger.
//!
//! Invariant: an entry is a fact that does not change: what follows from it is calculated.

use std::io::{self, BufReader, Read};
use std::path::PathBuf;

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::job::ShopJob;
use crate::job_id::ShopJobId;

/// An entry of a ledger.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "entry", rename_all = "snake_case")]
pub enum LedgerEntry {
    /// The machine has verified and stored everything of a job, and holds it from now on.
    Taken {
        /// Time, by the machine's clock, in UTC.
        when: Timestamp,
        /// The job.
        job: ShopJob,
        /// Name of its main program.
        program: String,
        /// Length of its files in bytes.
        bytes: u64,
    },
    /// The check of a job has found no error.
    Checked {
        /// Time.
        when: Timestamp,
        /// The job.
        id: ShopJobId,
        /// What the check has found.
        check: CheckSummary,
    },
    /// The check of a job has found errors, or its files are not those that were submitted.
    Refused {
        /// Time.
        when: Timestamp,
        /// The job.
        id: ShopJobId,
        /// The errors.
        check: CheckSummary,
        /// The job, where it was not taken.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        not_taken: Option<Box<ShopJob>>,
    },
    /// The operator starts a run of a job; nothing of it has moved.
    Started {
        /// Time.
        when: Timestamp,
        /// The job.
        id: ShopJobId,
        /// Folder of journals that has the run; empty where its program is sent to an old machine.
        journal: PathBuf,
        /// Name of the run's journal job.
        run: String,
    },
    /// A run cannot be resumed any more.
    Ended {
        /// Time.
        when: Timestamp,
        /// The job.
        id: ShopJobId,
        /// Name of the run's journal job.
        run: String,
        /// What became of it.
        outcome: RunOutcome,
    },
    /// The machine has given a job back, or has let go of it before it was taken.
    Returned {
        /// Time.
        when: Timestamp,
        /// The job.
        id: ShopJobId,
        /// The job, where it was not taken.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        not_taken: Option<Box<ShopJob>>,
    },
    /// The operator has given a job up: what is missing of it is not cut.
    GivenUp {
        /// Time.
        when: Timestamp,
        /// The job.
        id: ShopJobId,
    },
    /// The piece of a run is scrap, and does not count.
    Scrap {
        /// Time.
        when: Timestamp,
        /// The job.
        id: ShopJobId,
        /// Name of the run's journal job.
        run: String,
    },
}

/// What became of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunOutcome {
    /// The program came to its end.
    Completed,
    /// Nothing has moved.
    NeverBegan,
}

/// Result of a check.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CheckSummary {
    /// Number of errors.
    pub errors: usize,
    /// Number of warnings.
    pub warnings: usize,
    /// The first of them, as `retrace check --json` prints them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub diagnostics: Vec<Value>,
    /// Machine time in seconds, where the check has calculated one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

/// Maximum number of diagnostics in a ledger.
const MAX_DIAGNOSTICS: usize = 20;
/// Maximum length of a diagnostic in a ledger, as JSON text in bytes.
const MAX_DIAGNOSTIC_BYTES: usize = 4000;

/// The part of a check's output that is retained.
#[derive(Deserialize)]
struct CheckOutput {
    diagnostics: Vec<Value>,
    total_s: Option<f64>,
}

impl CheckSummary {
    /// Summary of the output of `retrace check --json`.
    ///
    /// # Errors
    /// The output cannot be read or is not that of a check.
    pub fn read(output: impl Read) -> io::Result<Self> {
        let CheckOutput { diagnostics, total_s } = serde_json::from_reader(BufReader::new(output))?;
        Ok(Self::of(&diagnostics, total_s))
    }

    /// Summary of these diagnostics, each with its `severity`: the first 20 that are not too long are retained, errors
    /// before warnings.
    #[must_use]
    pub fn of(diagnostics: &[Value], time_s: Option<f64>) -> Self {
        let is_error = |one: &Value| one["severity"] == "error";
        let (errors, others): (Vec<&Value>, Vec<&Value>) = diagnostics.iter().partition(|one| is_error(one));
        let is_short = |one: &&&Value| one.to_string().len() <= MAX_DIAGNOSTIC_BYTES;
        let retained = errors.iter().chain(&others).filter(is_short).take(MAX_DIAGNOSTICS);
        Self {
            errors: errors.len(),
            warnings: others.len(),
            diagnostics: retained.map(|one| (*one).clone()).collect(),
            time_s,
        }
    }
}

impl CheckSummary {
    /// Summary for a job that was refused before its check.
    #[must_use]
    pub(crate) fn of_refusal(refusal: &NumberedError) -> Self {
        Self::of(&[json!({"severity": "error", "number": refusal.number, "message": refusal.cause})], None)
    }
}

impl LedgerEntry {
    /// Time of the entry, by the machine's clock, in UTC.
    #[must_use]
    pub fn when(&self) -> Timestamp {
        match self {
            Self::Taken { when, .. }
            | Self::Checked { when, .. }
            | Self::Refused { when, .. }
            | Self::Started { when, .. }
            | Self::Ended { when, .. }
            | Self::Returned { when, .. }
            | Self::GivenUp { when, .. }
            | Self::Scrap { when, .. } => *when,
        }
    }

    /// The job of the entry.
    #[must_use]
    pub fn id(&self) -> ShopJobId {
        match self {
            Self::Taken { job, .. } => job.id,
            Self::Checked { id, .. }
            | Self::Refused { id, .. }
            | Self::Started { id, .. }
            | Self::Ended { id, .. }
            | Self::Returned { id, .. }
            | Self::GivenUp { id, .. }
            | Self::Scrap { id, .. } => *id,
        }
    }
}
