//! The log of files that came from a watched folder.
//!
//! Invariant: a file is in the log with the identity of its job before the job is submitted, so that a process that is
//! killed in between submits the same job again and not another one.

use std::path::Path;

use retrace_config::NumberedError;
use retrace_journal::Timestamp;
use serde::{Deserialize, Serialize};

use crate::checked_log::OpenLog;
use crate::content_hash::ContentHash;
use crate::job_id::ShopJobId;

/// An entry of the log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "entry", rename_all = "snake_case")]
enum WatchEntry {
    /// A file was found whole.
    Found(FoundFile),
    /// It was submitted and moved away.
    Moved {
        /// Its job.
        id: ShopJobId,
    },
}

/// A file that was found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct FoundFile {
    /// Time.
    pub when: Timestamp,
    /// Its name.
    pub name: String,
    /// Hash of its content.
    pub sha256: ContentHash,
    /// Its job.
    pub id: ShopJobId,
    /// Name that it gets in the folder of submitted files.
    pub moved_name: String,
}

/// The log, locked against other processes.
#[derive(Debug)]
pub(crate) struct WatchLog {
    log: OpenLog,
    entries: Vec<WatchEntry>,
}

impl WatchLog {
    /// Opens the log. Files that have arrived in `done` count as moved.
    pub(crate) fn open(path: &Path, done: &Path) -> Result<Self, NumberedError> {
        let (log, entries) = OpenLog::open(path)?;
        let mut this = Self { log, entries };
        let arrived: Vec<ShopJobId> =
            this.pending().filter(|found| done.join(&found.moved_name).exists()).map(|found| found.id).collect();
        arrived.into_iter().try_for_each(|id| this.append(WatchEntry::Moved { id }))?;
        Ok(this)
    }

    fn append(&mut self, entry: WatchEntry) -> Result<(), NumberedError> {
        self.log.append(&entry)?;
        self.entries.push(entry);
        Ok(())
    }

    fn found(&self) -> impl Iterator<Item = &FoundFile> {
        self.entries.iter().filter_map(|entry| match entry {
            WatchEntry::Found(found) => Some(found),
            WatchEntry::Moved { .. } => None,
        })
    }

    fn pending(&self) -> impl Iterator<Item = &FoundFile> {
        let is_moved = |id: ShopJobId| self.entries.contains(&WatchEntry::Moved { id });
        self.found().filter(move |found| !is_moved(found.id))
    }

    /// The file of this name and content that was found and not moved yet.
    pub(crate) fn pending_file(&self, name: &str, sha256: ContentHash) -> Option<FoundFile> {
        self.pending().find(|found| found.name == name && found.sha256 == sha256).cloned()
    }

    /// Whether a file of this name and content was submitted before.
    pub(crate) fn has(&self, name: &str, sha256: ContentHash) -> bool {
        self.found().any(|found| found.name == name && found.sha256 == sha256)
    }

    /// Appends a file that was found.
    pub(crate) fn append_found(&mut self, found: FoundFile) -> Result<(), NumberedError> {
        self.append(WatchEntry::Found(found))
    }

    /// Appends that the file of this job was moved.
    pub(crate) fn append_moved(&mut self, id: ShopJobId) -> Result<(), NumberedError> {
        self.append(WatchEntry::Moved { id })
    }
}
