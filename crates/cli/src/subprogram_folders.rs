//! Subprograms in files of their own: `O<part> call` finds `part.ngc`.
//!
//! Invariant: the program's own folder comes first, then those of the command line in their order; no file outside them
//! is read.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use retrace_gcode::{SubFile, SubFiles, Text};
use retrace_journal::{FileHash, FileRole, ReadFile};

use crate::files;

/// Folders that are searched, and the files found there.
#[derive(Debug)]
pub struct Folders {
    folders: Vec<PathBuf>,
    read: Mutex<Vec<ReadFile>>,
}

impl Folders {
    /// The folder of a program, and further ones.
    #[must_use]
    pub fn of(program: &Path, more: &[PathBuf]) -> Self {
        let own = if crate::program_stream::StreamSource::named(program).is_some() {
            None
        } else {
            program.parent().map(Path::to_path_buf)
        };
        Self { folders: own.into_iter().chain(more.iter().cloned()).collect(), read: Mutex::default() }
    }

    /// Clears the list of files: the program is opened again, for another job.
    pub fn forget(&self) {
        self.read.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Files that were read so far, each once.
    #[must_use]
    pub fn read(&self) -> Vec<ReadFile> {
        self.read.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl SubFiles for Folders {
    fn find(&self, name: &str) -> Option<SubFile> {
        // A label is a name, not a path.
        if name.is_empty() || name.contains(['/', '\\', '\0']) || name.starts_with('.') {
            return None;
        }
        let path = self.folders.iter().map(|folder| folder.join(format!("{name}.ngc"))).find(|path| path.is_file())?;
        let mut hash = FileHash::of(b"");
        let text = File::open(&path).and_then(|file| Text::read(file, |part| hash = hash.extend(part)));
        if text.is_ok() {
            let file = ReadFile { role: FileRole::Subprogram, path: files::absolute(&path), hash };
            let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
            if !read.contains(&file) {
                read.push(file);
            }
        }
        let text = text.map_err(|error| error.to_string());
        Some(SubFile { name: path.display().to_string(), text })
    }
}
