//! How much the jobs of a machine may take of its disk (SHP-22).
//!
//! Invariant: the limits are those of the files alone; the journals of runs have what is reserved.

use std::path::Path;

use retrace_config::NumberedError;

/// How much an inbox may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InboxLimits {
    /// Maximum length of the files of all jobs, in bytes.
    pub max_bytes: u64,
    /// Free bytes that stay on the disk.
    pub disk_reserve_bytes: u64,
}

impl Default for InboxLimits {
    /// 2 GiB, and the last 1 GiB of the disk stays free.
    fn default() -> Self {
        Self { max_bytes: 2 << 30, disk_reserve_bytes: 1 << 30 }
    }
}

/// A folder has no room for a job.
pub(crate) fn no_room(folder: &Path, bytes: u64, has: &str, limits: InboxLimits) -> NumberedError {
    let InboxLimits { max_bytes, disk_reserve_bytes } = limits;
    let what = format!(
        "{} has no room for a job of {bytes} bytes: {has}; {} MiB are allowed, and the last {} MiB of the disk stay \
            free",
        folder.display(),
        max_bytes >> 20,
        disk_reserve_bytes >> 20
    );
    let remedy = "make room on the disk, finish or recall jobs, or raise `inbox_gib` in the shop file; the job waits";
    NumberedError::new("E5008", what, remedy)
}
