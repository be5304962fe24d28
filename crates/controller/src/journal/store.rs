//! What a journal is kept in: bytes that are appended, made durable, and cut off again.
//!
//! Invariant: a store that has failed says so in every call until it works again; it never says that something is kept that is not.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

use crate::state_file;

/// Keeps bytes.
pub trait JournalStore: Send {
    /// Appends these bytes. Where it fails, any part of them may be there.
    ///
    /// # Errors
    /// As the system says.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Makes everything that was written durable.
    ///
    /// # Errors
    /// As the system says; what was written since the last time may be lost then, and has to be written again.
    fn sync(&mut self) -> io::Result<()>;

    /// Cuts off what lies behind the first `length` bytes.
    ///
    /// # Errors
    /// As the system says.
    fn truncate(&mut self, length: u64) -> io::Result<()>;
}

/// A file.
#[derive(Debug)]
pub struct FileStore(File);

impl FileStore {
    /// A new file, private to its user; there must be none of that name.
    ///
    /// # Errors
    /// As the system says.
    pub fn create(path: &Path) -> io::Result<Self> {
        state_file::private().append(true).create_new(true).open(path).map(Self)
    }

    /// A file that is there, to be gone on with.
    ///
    /// # Errors
    /// As the system says.
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
