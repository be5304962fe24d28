//! The jobs of this machine: those of its ledger, and those that wait in its queue.
//!
//! Invariant: a job that is in both is taken; it is not listed twice.

use retrace_config::{NumberedError, nearest};
use retrace_shop::{JobQueue, Ledger, LedgerJob, MachineFolder, ShopFile, ShopJob, ShopJobId};

/// The jobs of a machine.
#[derive(Debug)]
pub struct ShopJobs {
    /// Folder of the machine.
    pub machine: MachineFolder,
    /// Jobs that the machine has taken, returned or refused.
    pub ledger: Ledger,
    /// Jobs that wait to be taken.
    pub queued: Vec<ShopJob>,
}

/// A job of a machine.
#[derive(Clone, Copy, Debug)]
pub enum FoundJob<'a> {
    /// It is in the ledger.
    Listed(&'a LedgerJob),
    /// It waits to be taken.
    Queued(&'a ShopJob),
}

impl ShopJobs {
    /// Reads the ledger and the queue.
    ///
    /// # Errors
    /// `E5009` where the ledger is damaged, `E5010` where it or the queue cannot be read.
    pub fn read(file: &ShopFile) -> Result<Self, NumberedError> {
        let (jobs, unreadable) = Self::read_silently(file)?;
        for refusal in unreadable {
            eprintln!("{}", crate::escape::lines(&refusal.to_string()));
        }
        Ok(jobs)
    }

    /// Reads the ledger and the queue. Returns the errors of jobs of the queue that cannot be read, too.
    ///
    /// # Errors
    /// As [`ShopJobs::read`].
    pub fn read_silently(file: &ShopFile) -> Result<(Self, Vec<NumberedError>), NumberedError> {
        let machine = file.machine_folder();
        let queue = JobQueue::of(&machine);
        // The queue first: what is taken meanwhile is in the ledger then.
        let (mut queued, mut unreadable) = (Vec::new(), Vec::new());
        for id in queue.ids()? {
            match queue.read(id) {
                Ok(found) => queued.extend(found.map(|found| found.job)),
                Err(refusal) => unreadable.push(refusal),
            }
        }
        let ledger = Ledger::read(&machine.ledger())?;
        queued.retain(|job| ledger.job(job.id).is_none());
        Ok((Self { machine, ledger, queued }, unreadable))
    }

    /// Finds the job of this name, or the only one whose name begins so.
    ///
    /// # Errors
    /// `E5004` with the job that may have been meant.
    pub fn find(&self, name: &str) -> Result<FoundJob<'_>, NumberedError> {
        let listed = self.ledger.jobs().iter().map(|job| (job.job.id.to_string(), FoundJob::Listed(job)));
        let queued = self.queued.iter().map(|job| (job.id.to_string(), FoundJob::Queued(job)));
        let all: Vec<(String, FoundJob<'_>)> = listed.chain(queued).collect();
        let mut near = all.iter().filter(|(id, _)| !name.is_empty() && id.starts_with(name));
        match (near.next(), near.next()) {
            (Some((_, job)), None) => return Ok(*job),
            (Some(_), Some(_)) => {
                let what = format!("more than one job of machine {} begins with {name}", self.machine.name());
                return Err(NumberedError::new("E5004", what, "give more of its name; `retrace shop jobs` lists them"));
            }
            (None, _) => {}
        }
        let remedy = match nearest(name, all.iter().map(|(id, _)| id.as_str())) {
            Some(near) => format!("did you mean {near}?"),
            None => "`retrace shop jobs --all` lists them; --shop-file names another shop".into(),
        };
        Err(NumberedError::new("E5004", format!("machine {} has no job {name}", self.machine.name()), remedy))
    }
}

impl FoundJob<'_> {
    /// Identity of the job.
    #[must_use]
    pub fn id(self) -> ShopJobId {
        match self {
            Self::Listed(job) => job.job.id,
            Self::Queued(job) => job.id,
        }
    }
}
