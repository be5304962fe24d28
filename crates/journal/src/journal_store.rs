//! Storage of a journal: bytes that are appended, made durable, and truncated.
//!
//! Invariant: a store that has failed reports an error in every call until it works again; it never reports success for
//! bytes that are not stored.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

use crate::state_file;

/// Storage for bytes.
pub trait JournalStore: Send {
    /// Appends these bytes. Where it fails, any part of them may be written.
    ///
    /// # Errors
    /// The error of the system.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Makes everything that was written durable.
    ///
    /// # Errors
    /// The error of the system; what was written since the last sync may be lost then, and has to be written again.
    fn sync(&mut self) -> io::Result<()>;

    /// Truncates the store to its first `length` bytes.
    ///
    /// # Errors
    /// The error of the system.
    fn truncate(&mut self, length: u64) -> io::Result<()>;
}

/// A file.
#[derive(Debug)]
pub struct FileStore(File);

impl FileStore {
    /// Creates a new file, private to its user. It must not exist yet.
    ///
    /// # Errors
    /// The error of the system.
    pub fn create(path: &Path) -> io::Result<Self> {
        state_file::private().append(true).create_new(true).open(path).map(Self)
    }

    /// Opens an existing file for appending.
    ///
    /// # Errors
    /// The error of the system.
    pub fn open(path: &Path) -> io::Result<Self> {
        OpenOptions::new().append(true).open(path).map(Self)
    }
}

impl JournalStore for FileStore {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.0.sync_data()
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.0.set_len(length)
    }
}
