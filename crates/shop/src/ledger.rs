//! The ledger of a machine: which jobs it has, and what became of them.
//!
//! Invariant: a job is in a ledger once. An entry that contradicts those before it changes nothing, and is reported.

use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_journal::Timestamp;

use crate::checked_log::{self, OpenLog};
use crate::job::ShopJob;
use crate::job_id::ShopJobId;
use crate::ledger_entry::{CheckSummary, LedgerEntry, RunOutcome};

/// A run of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LedgerRun {
    /// Folder of journals that has it; empty where its program was sent to an old machine.
    pub journal: PathBuf,
    /// Name of its journal job.
    pub id: String,
    /// Time of its start, in UTC.
    pub started: Timestamp,
    /// What became of it; `None` while it runs or can be resumed.
    pub outcome: Option<RunOutcome>,
    /// Whether its piece is scrap.
    pub is_scrap: bool,
}

impl LedgerRun {
    /// Whether its program was sent to an old machine, which has no journal: the operator says what became of it.
    #[must_use]
    pub fn is_sent(&self) -> bool {
        self.journal.as_os_str().is_empty()
    }
}

/// A job of a ledger.
#[derive(Clone, Debug, PartialEq)]
pub struct LedgerJob {
    /// The job.
    pub job: ShopJob,
    /// Name of its main program; empty where it was not taken.
    pub program: String,
    /// Length of its files in bytes.
    pub bytes: u64,
    /// Whether the machine has taken it.
    pub is_taken: bool,
    /// Result of its check, once it was checked.
    pub check: Option<CheckSummary>,
    /// Whether it was refused.
    pub is_refused: bool,
    /// Its runs, in order.
    pub runs: Vec<LedgerRun>,
    /// Whether it was given back.
    pub is_returned: bool,
    /// Whether it was given up.
    pub is_given_up: bool,
}

impl LedgerJob {
    fn of(job: ShopJob) -> Self {
        Self {
            job,
            program: String::new(),
            bytes: 0,
            is_taken: false,
            check: None,
            is_refused: false,
            runs: Vec::new(),
            is_returned: false,
            is_given_up: false,
        }
    }

    /// Number of good pieces: runs that came to their end and are not scrap.
    #[must_use]
    pub fn good_pieces(&self) -> u32 {
        let is_good = |run: &&LedgerRun| run.outcome == Some(RunOutcome::Completed) && !run.is_scrap;
        self.runs.iter().filter(is_good).count() as u32
    }

    /// Whether the machine holds it: it was taken and not given back.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.is_taken && !self.is_returned
    }
}

/// What a ledger contains.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ledger {
    jobs: Vec<LedgerJob>,
    contradictions: Vec<String>,
}

impl Ledger {
    /// Reads a ledger; one that does not exist is empty. A process may append meanwhile.
    ///
    /// # Errors
    /// `E5009` where it is damaged, `E5010` where it cannot be read.
    pub fn read(path: &Path) -> Result<Self, NumberedError> {
        Ok(Self::of(checked_log::read(path)?.entries))
    }

    fn of(entries: Vec<LedgerEntry>) -> Self {
        let mut ledger = Self::default();
        for (number, entry) in entries.into_iter().enumerate() {
            if let Err(why) = ledger.apply(entry) {
                ledger.contradictions.push(format!("entry {}: {why}", number + 1));
            }
        }
        ledger
    }

    /// Its jobs, in the order of their entries.
    #[must_use]
    pub fn jobs(&self) -> &[LedgerJob] {
        &self.jobs
    }

    /// The job of this identity.
    #[must_use]
    pub fn job(&self, id: ShopJobId) -> Option<&LedgerJob> {
        self.jobs.iter().find(|job| job.job.id == id)
    }

    /// Entries that contradict those before them, as text; none where every process kept to the rules.
    #[must_use]
    pub fn contradictions(&self) -> &[String] {
        &self.contradictions
    }

    /// Applies an entry, or tells why it cannot be.
    fn apply(&mut self, entry: LedgerEntry) -> Result<(), String> {
        let id = entry.id();
        let refuse = |why: &str| Err(format!("job {id} {why}"));
        let Some(job) = self.jobs.iter_mut().find(|job| job.job.id == id) else {
            self.jobs.push(first_of(entry)?);
            return Ok(());
        };
        let is_open = job.is_held() && !job.is_given_up && !job.is_refused;
        match entry {
            LedgerEntry::Taken { .. } => return refuse("was taken twice"),
            LedgerEntry::Checked { .. } | LedgerEntry::Refused { .. } if job.check.is_some() || !is_open => {
                return refuse("was checked, though it cannot be");
            }
            LedgerEntry::Checked { check, .. } => job.check = Some(check),
            LedgerEntry::Refused { check, .. } => (job.check, job.is_refused) = (Some(check), true),
            LedgerEntry::Started { .. } if !is_open || job.check.is_none() => {
                return refuse("was started, though it is not ready");
            }
            LedgerEntry::Started { when, journal, run, .. } => {
                if job.runs.iter().any(|before| before.id == run && before.journal == journal) {
                    return refuse("was started twice with one journal");
                }
                job.runs.push(LedgerRun { journal, id: run, started: when, outcome: None, is_scrap: false });
            }
            LedgerEntry::Ended { run, outcome, .. } => match job.runs.iter_mut().rev().find(|known| known.id == run) {
                Some(run) if run.outcome.is_none() => run.outcome = Some(outcome),
                Some(_) => return refuse("has a run that ended twice"),
                None => return refuse("has an end without a start"),
            },
            LedgerEntry::Returned { .. } if !is_open => return refuse("was given back, though it is not held"),
            LedgerEntry::Returned { .. } => job.is_returned = true,
            LedgerEntry::GivenUp { .. } if !is_open => return refuse("was given up, though it is not held"),
            LedgerEntry::GivenUp { .. } => job.is_given_up = true,
            LedgerEntry::Scrap { run, .. } => match job.runs.iter_mut().rev().find(|known| known.id == run) {
                Some(run) => run.is_scrap = true,
                None => return refuse("has scrap of an unknown run"),
            },
        }
        Ok(())
    }
}

/// The job that an entry begins.
fn first_of(entry: LedgerEntry) -> Result<LedgerJob, String> {
    match entry {
        LedgerEntry::Taken { job, program, bytes, .. } => {
            Ok(LedgerJob { program, bytes, is_taken: true, ..LedgerJob::of(job) })
        }
        LedgerEntry::Returned { not_taken: Some(job), .. } => {
            Ok(LedgerJob { is_returned: true, ..LedgerJob::of(*job) })
        }
        LedgerEntry::Refused { not_taken: Some(job), check, .. } => {
            Ok(LedgerJob { is_refused: true, check: Some(check), ..LedgerJob::of(*job) })
        }
        other => Err(format!("job {} was never taken", other.id())),
    }
}

/// A ledger that is locked against other processes.
#[derive(Debug)]
pub struct OpenLedger {
    log: OpenLog,
    ledger: Ledger,
}

impl OpenLedger {
    /// Locks a ledger and reads it. Waits for a process that appends.
    ///
    /// # Errors
    /// `E5009` where it is damaged, `E5010` where it cannot be written.
    pub fn open(path: &Path) -> Result<Self, NumberedError> {
        let (log, entries) = OpenLog::open(path)?;
        Ok(Self { log, ledger: Ledger::of(entries) })
    }

    /// What it contains.
    #[must_use]
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// Appends an entry durably.
    ///
    /// # Errors
    /// `E5010` where it cannot be written, or contradicts the entries before it; the ledger is as before then.
    pub fn append(&mut self, entry: LedgerEntry) -> Result<(), NumberedError> {
        let mut next = self.ledger.clone();
        next.apply(entry.clone()).map_err(|why| {
            let what = format!("the ledger does not allow this entry: {why}");
            NumberedError::new("E5010", what, "look at the job with `retrace shop show`, then repeat the command")
        })?;
        self.log.append(&entry)?;
        self.ledger = next;
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::content_hash::ContentHash;
    use crate::job::tests::job;
    use proptest::prelude::*;

    pub(crate) fn taken(number: u64) -> LedgerEntry {
        let job = job(number, ContentHash::of(b""));
        LedgerEntry::Taken { when: Timestamp::from_ms(0), job, program: "part.ngc".into(), bytes: 3 }
    }

    fn entry(kind: u8, number: u64, run: u8) -> LedgerEntry {
        let (when, id) = (Timestamp::from_ms(0), job(number, ContentHash::of(b"")).id);
        let (check, run) = (CheckSummary::default(), run.to_string());
        match kind {
            0 => taken(number),
            1 => LedgerEntry::Checked { when, id, check },
            2 => LedgerEntry::Refused { when, id, check, not_taken: None },
            3 => LedgerEntry::Started { when, id, journal: "jobs".into(), run },
            4 => LedgerEntry::Ended { when, id, run, outcome: RunOutcome::Completed },
            5 => LedgerEntry::Returned { when, id, not_taken: None },
            6 => LedgerEntry::GivenUp { when, id },
            _ => LedgerEntry::Scrap { when, id, run },
        }
    }

    #[test]
    fn a_job_is_taken_once_and_its_runs_are_counted() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ledger");
        let mut open = OpenLedger::open(&path).expect("a ledger");
        for (kind, run) in [(0, 0), (1, 0), (3, 1), (4, 1), (3, 2), (4, 2), (7, 1)] {
            open.append(entry(kind, 1, run)).expect("allowed");
        }
        for (kind, run) in [(0, 0), (1, 0), (2, 0), (4, 1), (4, 9), (3, 2), (7, 9)] {
            assert_eq!(open.append(entry(kind, 1, run)).expect_err("refused").number, "E5010", "{kind} {run}");
        }
        let ledger = Ledger::read(&path).expect("whole");
        assert_eq!(&ledger, open.ledger());
        let job = &ledger.jobs()[0];
        assert_eq!((ledger.jobs().len(), job.runs.len(), job.good_pieces(), job.is_held()), (1, 2, 1, true));
    }

    #[test]
    fn a_torn_ledger_has_the_entries_before() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ledger");
        let mut open = OpenLedger::open(&path).expect("a ledger");
        for number in 0..3 {
            open.append(taken(number)).expect("allowed");
        }
        drop(open);
        let bytes = std::fs::read(&path).expect("a file");
        for length in 0..bytes.len() {
            std::fs::write(&path, &bytes[..length]).expect("written");
            let whole = bytes[..length].iter().filter(|&&byte| byte == b'\n').count();
            let mut open = OpenLedger::open(&path).expect("torn, not damaged");
            assert_eq!(open.ledger().jobs().len(), whole, "{length} bytes");
            // the delivery comes again
            open.append(taken(whole as u64)).expect("allowed");
            assert_eq!(Ledger::read(&path).expect("whole").jobs().len(), whole + 1);
        }
    }

    proptest! {
        #[test]
        fn any_entries_leave_each_job_once(
            entries in prop::collection::vec((0..8_u8, 0..3_u64, 0..3_u8), 0..40),
        ) {
            let all: Vec<LedgerEntry> = entries.iter().map(|&(kind, number, run)| entry(kind, number, run)).collect();
            let ledger = Ledger::of(all);
            for job in ledger.jobs() {
                prop_assert_eq!(ledger.jobs().iter().filter(|other| other.job.id == job.job.id).count(), 1);
                prop_assert!(job.is_taken);
                prop_assert!(job.runs.is_empty() || job.check.is_some() && !job.is_refused);
            }
        }
    }
}
