//! The inbox of a machine: the files of the jobs that it has taken.
//!
//! Invariant: the files of a job are whole and durable before the ledger has `taken`. The inbox is bounded, and never
//! takes the last of the disk: the journals of runs come first (SHP-22).

use std::path::PathBuf;

use retrace_config::NumberedError;
use retrace_journal::state_file;

use crate::bundle::Bundle;
use crate::free_space::free_bytes;
use crate::inbox_limits::{InboxLimits, no_room};
use crate::job_id::ShopJobId;
use crate::ledger::{Ledger, LedgerJob};
use crate::machine_folder::{MachineFolder, delete_folder, folder_names, sync_folder, unusable, write_new};
use crate::queue::QueuedJob;

/// The inbox of a machine.
#[derive(Clone, Debug)]
pub struct Inbox {
    folder: PathBuf,
}

impl Inbox {
    /// The inbox of this machine.
    #[must_use]
    pub fn of(machine: &MachineFolder) -> Self {
        Self { folder: machine.inbox() }
    }

    /// Path of a job's main program.
    #[must_use]
    pub fn program(&self, job: &LedgerJob) -> PathBuf {
        self.files(job.job.id).join(&job.program)
    }

    fn job_folder(&self, id: ShopJobId) -> PathBuf {
        self.folder.join(id.to_string())
    }

    /// Folder with the files of a job, under their names.
    #[must_use]
    pub fn files(&self, id: ShopJobId) -> PathBuf {
        self.job_folder(id).join("files")
    }

    /// Verifies that the files of a job are those that were submitted.
    ///
    /// # Errors
    /// `E5006` where one is missing or was changed, `E5010` where it cannot be read.
    pub fn verify(&self, job: &LedgerJob) -> Result<(), NumberedError> {
        self.bundle(job)?.verify_folder(&self.files(job.job.id))
    }

    /// Folder with the cycles of a job; `None` where it has none of its own, and is run with those of the machine.
    ///
    /// # Errors
    /// `E5006`, `E5010` where its list of files was changed or cannot be read.
    pub fn cycles(&self, job: &LedgerJob) -> Result<Option<PathBuf>, NumberedError> {
        Ok(self.bundle(job)?.has_cycles().then(|| self.files(job.job.id)))
    }

    fn bundle(&self, job: &LedgerJob) -> Result<Bundle, NumberedError> {
        Bundle::read(&self.job_folder(job.job.id).join("bundle.json"), job.job.bundle)
    }

    /// Makes room for a job: deletes the files of jobs from which nothing more can come, the oldest first.
    ///
    /// # Errors
    /// `E5008` where there is no room, `E5010`.
    pub(crate) fn make_room(&self, ledger: &Ledger, bytes: u64, limits: InboxLimits) -> Result<(), NumberedError> {
        let stored = |job: &&LedgerJob| self.job_folder(job.job.id).is_dir();
        let mut used: u64 = ledger.jobs().iter().filter(stored).map(|job| job.bytes).sum();
        let mut deletable = ledger.jobs().iter().filter(stored).filter(|job| job.state().is_final());
        loop {
            let free = free_bytes(&self.folder).map_err(|error| unusable(&self.folder, &error))?;
            let fits_disk = free >= bytes.saturating_add(limits.disk_reserve_bytes);
            if fits_disk && used.saturating_add(bytes) <= limits.max_bytes {
                return Ok(());
            }
            let Some(job) = deletable.next() else {
                let what = format!("it has {} MiB, its disk {} MiB free", used >> 20, free >> 20);
                return Err(no_room(&self.folder, bytes, &what, limits));
            };
            delete_folder(&self.job_folder(job.job.id))?;
            used = used.saturating_sub(job.bytes);
        }
    }

    /// Stores a job of the queue, verified and durable. Returns its bundle.
    ///
    /// # Errors
    /// `E5005`, `E5006` and `E5007` where the files are not a bundle that may be stored, `E5008` where there is no
    /// room, `E5010` where they cannot be read or written.
    pub(crate) fn store(
        &self,
        queued: &QueuedJob,
        ledger: &Ledger,
        limits: InboxLimits,
    ) -> Result<Bundle, NumberedError> {
        let bundle = Bundle::read(&queued.folder.join("bundle.json"), queued.job.bundle)?;
        self.make_room(ledger, bundle.bytes(), limits)?;
        let (folder, files) = (self.job_folder(queued.job.id), self.files(queued.job.id));
        // what an agent has left that was killed
        delete_folder(&folder)?;
        for new in [&folder, &files] {
            state_file::create_new_private_folder(new).map_err(|error| unusable(new, &error))?;
        }
        let stored = bundle.unpack(&queued.folder.join("files"), &files).and_then(|()| {
            write_new(&folder.join("bundle.json"), bundle.json().as_bytes())?;
            [&files, &folder, &self.folder].into_iter().try_for_each(|folder| sync_folder(folder))
        });
        if let Err(refusal) = stored {
            let _ = delete_folder(&folder);
            return Err(refusal);
        }
        Ok(bundle)
    }

    /// Deletes the files of a job.
    ///
    /// # Errors
    /// `E5010`
    pub fn delete(&self, id: ShopJobId) -> Result<(), NumberedError> {
        delete_folder(&self.job_folder(id))
    }

    /// Deletes the folders of jobs that the machine does not hold: half-written ones of an agent that was killed, and
    /// those of jobs that were given back (SHP-20).
    ///
    /// # Errors
    /// `E5010`
    pub fn delete_unheld(&self, ledger: &Ledger) -> Result<(), NumberedError> {
        let ids = folder_names(&self.folder)?.into_iter().filter_map(|name| name.parse::<ShopJobId>().ok());
        for id in ids.filter(|&id| !ledger.job(id).is_some_and(LedgerJob::is_held)) {
            delete_folder(&self.job_folder(id))?;
        }
        Ok(())
    }
}
