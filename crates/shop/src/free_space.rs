//! Free space of a disk.
//!
//! Invariant: what is reported may be used by this user; space that is reserved for others is not counted.

use std::io;
use std::path::Path;

/// Free bytes of the disk that holds a folder. `u64::MAX` on systems where that cannot be asked.
///
/// # Errors
/// The error of the system.
#[cfg(unix)]
pub(crate) fn free_bytes(folder: &Path) -> io::Result<u64> {
    let found = rustix::fs::statvfs(folder)?;
    Ok(found.f_bavail.saturating_mul(found.f_frsize))
}

/// Free bytes of the disk that holds a folder. `u64::MAX` on systems where that cannot be asked.
///
/// # Errors
/// None.
#[cfg(not(unix))]
pub(crate) fn free_bytes(_folder: &Path) -> io::Result<u64> {
    Ok(u64::MAX)
}
