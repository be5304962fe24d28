//! Records in the ledger that a run of a job is started, before anything of it moves.
//!
//! Invariant: the files of the job are those that were submitted. The ledger is locked from the look at the state of
//! the job to the entry, so that a piece is started once.

use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_journal::{JobStore, Timestamp};

use crate::inbox::Inbox;
use crate::job_id::ShopJobId;
use crate::job_state::ShopJobState;
use crate::ledger::{Ledger, LedgerJob, LedgerRun, OpenLedger};
use crate::ledger_entry::LedgerEntry;
use crate::machine_folder::MachineFolder;
use crate::run_state::{RunState, run_state};

/// Records the runs of one job.
#[derive(Clone, Debug)]
pub struct RunRecorder {
    machine: MachineFolder,
    id: ShopJobId,
    program: String,
}

impl RunRecorder {
    /// Recorder of the runs of this program for a job of a machine.
    #[must_use]
    pub fn new(machine: MachineFolder, id: ShopJobId, program: String) -> Self {
        Self { machine, id, program }
    }

    /// Path of the ledger.
    #[must_use]
    pub fn ledger(&self) -> PathBuf {
        self.machine.ledger()
    }

    /// Whether runs of this program are those of the job.
    #[must_use]
    pub fn is_of(&self, program: &str) -> bool {
        program == self.program
    }

    /// Error for a job that is not in the ledger yet.
    #[must_use]
    pub fn not_taken(id: ShopJobId) -> NumberedError {
        not_ready(id, ShopJobState::Queued, None)
    }

    /// Records that a run is started, whose journal job has this name and is locked by this process. A run of another
    /// program, which was opened at the screen, is none of the job. The program was read before: what is run was
    /// verified.
    ///
    /// # Errors
    /// `E5012`, `E5013` where the job cannot be started any more; `E5006` where a file of it was changed; `E5009`,
    /// `E5010` where the ledger cannot be written.
    pub fn record_started(&self, program: &str, store: &JobStore, run: &str) -> Result<(), NumberedError> {
        if !self.is_of(program) {
            return Ok(());
        }
        let path = self.ledger();
        let journal = std::path::absolute(store.folder()).unwrap_or_else(|_| store.folder().to_owned());
        self.append_started(&path, journal, run.to_owned())
    }

    /// Records that the program is sent to an old machine, which is told nothing yet. Returns the name of the run.
    ///
    /// # Errors
    /// Those of [`Self::record_started`].
    pub fn record_sent(&self) -> Result<String, NumberedError> {
        let run = format!("{}-sent", Timestamp::now().compact());
        self.append_started(&self.ledger(), PathBuf::new(), run.clone())?;
        Ok(run)
    }

    fn append_started(&self, path: &Path, journal: PathBuf, run: String) -> Result<(), NumberedError> {
        if let Some(job) = Ledger::read(path)?.job(self.id) {
            job.require_ready()?;
            Inbox::of(&self.machine).verify(job)?;
        }
        let mut open = OpenLedger::open(path)?;
        open.record_ended_runs()?;
        open.ledger().job(self.id).ok_or_else(|| Self::not_taken(self.id))?.require_ready()?;
        open.append(LedgerEntry::Started { when: Timestamp::now(), id: self.id, journal, run })
    }
}

impl LedgerJob {
    /// Checks that a run of the job can be started.
    ///
    /// # Errors
    /// `E5013` where all its pieces are good, `E5012` in any other state but ready.
    pub fn require_ready(&self) -> Result<(), NumberedError> {
        let (id, quantity) = (self.job.id, self.job.quantity);
        match self.state() {
            ShopJobState::Ready => Ok(()),
            ShopJobState::Done => {
                let what = format!("job {id} is done: {quantity} of {quantity} pieces are good");
                let remedy =
                    format!("mark a bad piece with `retrace shop scrap {id} RUN`, or submit the program again");
                Err(NumberedError::new("E5013", what, remedy))
            }
            state => Err(not_ready(id, state, Some(self))),
        }
    }

    /// The command that resumes the interrupted run of the job, if there is one.
    #[must_use]
    pub fn resume_command(&self) -> Option<String> {
        let is_interrupted = |run: &&LedgerRun| !run.is_scrap && run_state(run) == RunState::Interrupted;
        let run = self.runs.iter().find(is_interrupted)?;
        let usual = JobStore::open_or_default(None);
        let is_usual = usual.is_ok_and(|usual| usual.folder() == run.journal);
        let journal = if is_usual { String::new() } else { format!(" --journal {}", run.journal.display()) };
        Some(format!("retrace resume {}{journal}", run.id))
    }
}

fn not_ready(id: ShopJobId, state: ShopJobState, job: Option<&LedgerJob>) -> NumberedError {
    let remedy = match state {
        ShopJobState::Queued | ShopJobState::Taken => "`retrace shop agent --once` takes and checks it".into(),
        ShopJobState::Running => "wait for the end of the run".into(),
        ShopJobState::Interrupted => {
            let resume = job.and_then(LedgerJob::resume_command).unwrap_or_else(|| "retrace resume".into());
            format!("`{resume}` resumes it; `retrace shop give-up {id}` gives the job up")
        }
        _ => format!("see `retrace shop show {id}`"),
    };
    NumberedError::new("E5012", format!("job {id} is {}, not ready", state.word()), remedy)
}
