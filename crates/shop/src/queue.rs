//! The local queue of a machine: a folder per job, which the machine's agent takes.
//!
//! Invariant: a job is in the queue whole or not at all: it is written under another name, made durable, and renamed.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use retrace_config::NumberedError;
use retrace_journal::state_file;

use crate::bundle::{Bundle, SourceFile};
use crate::free_space::free_bytes;
use crate::inbox_limits::{InboxLimits, no_room};
use crate::job::ShopJob;
use crate::job_id::ShopJobId;
use crate::machine_folder::{MachineFolder, delete_folder, folder_names, sync_folder, unusable, write_new};

/// Beginning of the name of a folder that is being written.
const NEW: &str = ".new-";
/// Age after which a folder that is being written is one of a process that was killed.
const ABANDONED_AGE: Duration = Duration::from_secs(86_400);

/// The queue of a machine.
#[derive(Clone, Debug)]
pub struct JobQueue {
    folder: PathBuf,
}

/// A job that waits in the queue.
#[derive(Clone, Debug)]
pub struct QueuedJob {
    /// The job.
    pub job: ShopJob,
    /// Its folder.
    pub(crate) folder: PathBuf,
}

/// Files of a job that is being submitted; they are deleted with it.
#[derive(Debug)]
pub struct StagedFiles {
    queue: PathBuf,
    folder: PathBuf,
    bundle: Bundle,
}

impl JobQueue {
    /// The queue of this machine.
    #[must_use]
    pub fn of(machine: &MachineFolder) -> Self {
        Self { folder: machine.queue() }
    }

    /// Copies the files of a job that is to be submitted to this queue.
    ///
    /// # Errors
    /// As [`Bundle::store`]; `E5008` where the disk has no room.
    pub fn stage(&self, sources: &[SourceFile], limits: InboxLimits) -> Result<StagedFiles, NumberedError> {
        let bytes: u64 = sources.iter().filter_map(|source| fs::metadata(&source.path).ok()).map(|of| of.len()).sum();
        self.stage_by(bytes, limits, |files| Bundle::store(sources, files))
    }

    /// Checks that the disk has room for so many bytes.
    ///
    /// # Errors
    /// `E5008` where it does not, `E5010` where that cannot be found out.
    pub(crate) fn check_room(&self, bytes: u64, limits: InboxLimits) -> Result<(), NumberedError> {
        let free = free_bytes(&self.folder).map_err(|error| unusable(&self.folder, &error))?;
        if free < bytes.saturating_add(limits.disk_reserve_bytes) {
            return Err(no_room(&self.folder, bytes, &format!("its disk has {} MiB free", free >> 20), limits));
        }
        Ok(())
    }

    /// Stages a job of so many bytes whose files `store` writes to the folder that it gets, each under its hash.
    ///
    /// # Errors
    /// Those of `store`; `E5008` where the disk has no room; `E5010`.
    pub(crate) fn stage_by(
        &self,
        bytes: u64,
        limits: InboxLimits,
        store: impl FnOnce(&Path) -> Result<Bundle, NumberedError>,
    ) -> Result<StagedFiles, NumberedError> {
        self.check_room(bytes, limits)?;
        let folder = self.folder.join(format!("{NEW}{}", ShopJobId::new_now()?));
        state_file::create_new_private_folder(&folder).map_err(|error| unusable(&folder, &error))?;
        let files = folder.join("files");
        let stored = state_file::create_new_private_folder(&files)
            .map_err(|error| unusable(&files, &error))
            .and_then(|()| store(&files));
        match stored {
            Ok(bundle) => Ok(StagedFiles { queue: self.folder.clone(), folder, bundle }),
            Err(refusal) => {
                let _ = delete_folder(&folder);
                Err(refusal)
            }
        }
    }

    /// The jobs that this computer has submitted to others below a root, until a machine has taken them.
    ///
    /// # Errors
    /// `E5010`
    pub(crate) fn outbox(root: &Path) -> Result<Self, NumberedError> {
        // not the name of a machine
        let folder = root.join("_outbox");
        state_file::create_private_folder(&folder).map_err(|error| unusable(&folder, &error))?;
        Ok(Self { folder })
    }

    /// Path of a file of its own.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Whether a job is in the queue.
    #[must_use]
    pub fn contains(&self, id: ShopJobId) -> bool {
        self.folder.join(id.to_string()).is_dir()
    }

    /// Names of the waiting jobs, the oldest first.
    ///
    /// # Errors
    /// `E5010`
    pub fn ids(&self) -> Result<Vec<ShopJobId>, NumberedError> {
        Ok(folder_names(&self.folder)?.into_iter().filter_map(|name| name.parse().ok()).collect())
    }

    /// Reads a waiting job. `None` where it is not there any more.
    ///
    /// # Errors
    /// `E5006` where its text is not this job, `E5010` where it cannot be read.
    pub fn read(&self, id: ShopJobId) -> Result<Option<QueuedJob>, NumberedError> {
        let folder = self.folder.join(id.to_string());
        let path = folder.join("job.json");
        let text = match fs::read(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound && !folder.exists() => return Ok(None),
            Err(error) => return Err(unusable(&path, &error)),
        };
        let wrong = |why: String| {
            let what = format!("{}: {why}", path.display());
            NumberedError::new("E5006", what, "delete that folder and submit the job again; check the disk")
        };
        let job: ShopJob = serde_json::from_slice(&text).map_err(|error| wrong(error.to_string()))?;
        if job.id != id {
            return Err(wrong(format!("it is job {}", job.id)));
        }
        job.check()?;
        Ok(Some(QueuedJob { job, folder }))
    }

    /// Deletes a job that was taken, or is not to be taken.
    ///
    /// # Errors
    /// `E5010`
    pub fn remove(&self, id: ShopJobId) -> Result<(), NumberedError> {
        delete_folder(&self.folder.join(id.to_string()))
    }

    /// Deletes what processes have left that were killed while they submitted a job more than a day ago.
    ///
    /// # Errors
    /// `E5010`
    pub fn delete_abandoned(&self) -> Result<(), NumberedError> {
        for name in folder_names(&self.folder)?.into_iter().filter(|name| name.starts_with(NEW)) {
            let path = self.folder.join(name);
            let age = fs::metadata(&path).and_then(|of| of.modified()).ok().and_then(|then| then.elapsed().ok());
            if age.is_some_and(|age| age > ABANDONED_AGE) {
                delete_folder(&path)?;
            }
        }
        Ok(())
    }
}

impl StagedFiles {
    /// The bundle of the files.
    #[must_use]
    pub fn bundle(&self) -> &Bundle {
        &self.bundle
    }

    /// Puts the job into the queue, durably. A job that is there already stays as it is.
    ///
    /// # Errors
    /// `E5006` for a job with wrong texts or of another bundle; `E5010`.
    pub fn submit(self, job: &ShopJob) -> Result<(), NumberedError> {
        job.check()?;
        if job.bundle != self.bundle.hash() {
            let what = format!("job {} names another bundle than its files", job.id);
            return Err(NumberedError::new("E5006", what, "submit the job again"));
        }
        let text = serde_json::to_string(job).map_err(|error| unusable(&self.folder, &error.into()))?;
        write_new(&self.folder.join("job.json"), text.as_bytes())?;
        write_new(&self.folder.join("bundle.json"), self.bundle.json().as_bytes())?;
        sync_folder(&self.folder.join("files"))?;
        sync_folder(&self.folder)?;
        let target = self.queue.join(job.id.to_string());
        match fs::rename(&self.folder, &target) {
            // it was submitted before; a folder with files is not replaced
            Err(_) if target.is_dir() => Ok(()),
            Err(error) => Err(unusable(&target, &error)),
            Ok(()) => sync_folder(&self.queue),
        }
    }
}

impl Drop for StagedFiles {
    fn drop(&mut self) {
        // it is gone where it was submitted
        let _ = delete_folder(&self.folder);
    }
}
