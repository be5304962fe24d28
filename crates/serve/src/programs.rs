//! Folders of programs: the one that pages store programs in, and one that is watched.
//!
//! Invariant: a name has no folder part, so that nothing outside the folders is read or written; a file appears under
//! its name only when it is whole.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::Serialize;

/// Maximum length of a name, bytes.
const MAX_NAME: usize = 200;

/// Maximum number of programs that are listed.
const MAX_LISTED: usize = 10_000;

/// The folders.
#[derive(Clone, Debug, Default)]
pub struct ProgramFolders {
    /// Folder in which programs are stored.
    pub programs: Option<PathBuf>,
    /// Folder into which other programs write, for reading only.
    pub watched: Option<PathBuf>,
}

/// A program in a folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct StoredProgram {
    /// Its name.
    pub(crate) name: String,
    /// Its size.
    pub(crate) bytes: u64,
    /// Time of its last change, s since 1970.
    pub(crate) modified_s: u64,
    /// Whether it is in the watched folder.
    pub(crate) is_watched: bool,
}

/// Why a program is not stored.
#[derive(Debug)]
pub(crate) enum StoreError {
    /// There is no folder for programs.
    NoFolder,
    /// The name is not one of a file in the folder.
    BadName,
    /// There is a program of this name.
    Exists,
    /// There is no program of this name.
    Missing,
    /// The system reports an error.
    Io(io::Error),
}

impl std::fmt::Display for StoreError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NoFolder => f.write_str("there is no folder for programs"),
            Self::BadName => f.write_str("a program's name has no folder part and no control characters"),
            Self::Exists => f.write_str("there is a program of this name already"),
            Self::Missing => f.write_str("there is no program of this name"),
            Self::Io(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for StoreError {}

/// Whether a name is one of a file without a folder.
pub(crate) fn is_file_name(name: &str) -> bool {
    let has_forbidden = name.chars().any(|c| c.is_control() || matches!(c, '/' | '\\' | ':'));
    !name.is_empty() && name.len() <= MAX_NAME && !name.starts_with('.') && !has_forbidden && name.trim() == name
}

impl ProgramFolders {
    /// Programs in the folders, the newest first.
    pub(crate) fn list(&self) -> Vec<StoredProgram> {
        let folders = [(self.programs.as_deref(), false), (self.watched.as_deref(), true)];
        let mut listed: Vec<StoredProgram> =
            folders.into_iter().filter_map(|(folder, is_watched)| Some(list(folder?, is_watched))).flatten().collect();
        listed.sort_by(|a, b| b.modified_s.cmp(&a.modified_s).then_with(|| a.name.cmp(&b.name)));
        listed.truncate(MAX_LISTED);
        listed
    }

    /// Programs in the watched folder.
    pub(crate) fn list_watched(&self) -> Vec<StoredProgram> {
        self.watched.as_deref().map_or_else(Vec::new, |folder| list(folder, true))
    }

    /// Path of a program.
    pub(crate) fn find(&self, name: &str) -> Option<PathBuf> {
        let folders = [self.programs.as_deref(), self.watched.as_deref()];
        let mut paths = folders.into_iter().flatten().filter(|_| is_file_name(name)).map(|folder| folder.join(name));
        paths.find(|path| path.is_file())
    }

    /// Begins to store a program: a temporary file in its folder.
    ///
    /// # Errors
    /// Why it cannot be stored.
    pub(crate) fn begin(&self, name: &str) -> Result<PartialProgram, StoreError> {
        let folder = self.programs.as_deref().ok_or(StoreError::NoFolder)?;
        if !is_file_name(name) {
            return Err(StoreError::BadName);
        }
        let unique = crate::session::new_secret().map_err(|error| StoreError::Io(io::Error::other(error)))?;
        let temporary = folder.join(format!(".{unique}.part"));
        let file = fs::File::create_new(&temporary).map_err(StoreError::Io)?;
        Ok(PartialProgram { file, temporary, target: folder.join(name), is_kept: false })
    }

    /// Deletes a stored program. Those in the watched folder belong to others.
    ///
    /// # Errors
    /// Why it is not deleted.
    pub(crate) fn delete(&self, name: &str) -> Result<(), StoreError> {
        let folder = self.programs.as_deref().ok_or(StoreError::NoFolder)?;
        if !is_file_name(name) {
            return Err(StoreError::BadName);
        }
        match fs::remove_file(folder.join(name)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Err(StoreError::Missing),
            done => done.map_err(StoreError::Io),
        }
    }

    /// A name that is not used yet: with a number before its extension where it is.
    pub(crate) fn unused_name(&self, name: &str) -> String {
        let (stem, extension) =
            name.rsplit_once('.').map_or((name, String::new()), |(stem, it)| (stem, format!(".{it}")));
        let numbered = (2..10_000).map(|n| format!("{stem}-{n}{extension}"));
        let mut names = std::iter::once(name.to_owned()).chain(numbered);
        names.find(|name| self.find(name).is_none()).unwrap_or_else(|| name.to_owned())
    }
}

fn list(folder: &Path, is_watched: bool) -> Vec<StoredProgram> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let program = |entry: fs::DirEntry| {
        let (name, data) = (entry.file_name().into_string().ok()?, entry.metadata().ok()?);
        let modified = data.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
        (data.is_file() && is_file_name(&name)).then_some(StoredProgram {
            name,
            bytes: data.len(),
            modified_s: modified.as_secs(),
            is_watched,
        })
    };
    entries.flatten().filter_map(program).take(MAX_LISTED).collect()
}

/// A program that is being stored. Dropped before it is whole, it leaves nothing behind.
#[derive(Debug)]
pub(crate) struct PartialProgram {
    file: fs::File,
    temporary: PathBuf,
    target: PathBuf,
    is_kept: bool,
}

impl PartialProgram {
    /// Adds bytes.
    ///
    /// # Errors
    /// That of the system.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// [`StoreError::Exists`] where the name is used and must not be.
    pub(crate) fn finish(mut self, replaces: bool) -> Result<(), StoreError> {
        self.file.sync_all().map_err(StoreError::Io)?;
        if replaces {
            fs::rename(&self.temporary, &self.target).map_err(StoreError::Io)?;
            self.is_kept = true;
            return Ok(());
        }
        // A link fails where there is such a file, in one step.
        match fs::hard_link(&self.temporary, &self.target) {
            Ok(()) => Ok(()),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Err(StoreError::Exists),
            Err(error) => Err(StoreError::Io(error)),
        }
    }
}

impl Drop for PartialProgram {
    fn drop(&mut self) {
        if !self.is_kept {
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_no_folder_part() {
        for name in ["part.ngc", "part 2.nc", "Teil-ü.tap", "a"] {
            assert!(is_file_name(name), "{name}");
        }
        let long = "x".repeat(201);
        for name in ["", ".", "..", "../x", "a/b", "a\\b", ".hidden", "c:x", "a\0b", "a\nb", " a", "a ", &long] {
            assert!(!is_file_name(name), "{name}");
        }
    }

    #[test]
    fn a_program_appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let folders = ProgramFolders { programs: Some(folder.path().to_owned()), watched: None };
        let mut part = folders.begin("part.ngc").expect("begun");
        part.write(b"G0 X1\n").expect("written");
        assert!(folders.list().is_empty() && folders.find("part.ngc").is_none());
        part.finish(false).expect("finished");
        assert_eq!(folders.list().iter().map(|it| (it.name.as_str(), it.bytes)).collect::<Vec<_>>(), [("part.ngc", 6)]);
        let again = folders.begin("part.ngc").expect("begun");
        assert!(matches!(again.finish(false), Err(StoreError::Exists)));
        assert_eq!(folders.unused_name("part.ngc"), "part-2.ngc");
        drop(folders.begin("other.ngc").expect("begun"));
        let files = std::fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(files, 1, "nothing is left behind");
        assert!(matches!(folders.begin("../part.ngc"), Err(StoreError::BadName)));
        folders.delete("part.ngc").expect("deleted");
        assert!(folders.list().is_empty());
        assert!(matches!(ProgramFolders::default().begin("a"), Err(StoreError::NoFolder)));
    }
}
