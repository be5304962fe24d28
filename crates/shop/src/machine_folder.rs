//! The folder of one machine below the root of a shop: `ROOT/MACHINE/{queue, inbox}`.
//!
//! Invariant: every path of a machine's files is made here, from checked names only.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use retrace_journal::state_file;

use crate::machine_name::MachineName;

/// The folder of one machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MachineFolder {
    path: PathBuf,
    name: MachineName,
}

impl MachineFolder {
    /// The folder of this machine, which need not exist.
    #[must_use]
    pub fn of(root: &Path, name: &MachineName) -> Self {
        Self { path: root.join(name.as_str()), name: name.clone() }
    }

    /// The machines of a root, by their names.
    ///
    /// # Errors
    /// `E5010` where the root exists and cannot be read.
    pub fn all(root: &Path) -> Result<Vec<Self>, NumberedError> {
        let mut all: Vec<Self> = folder_names(root)?
            .into_iter()
            .filter_map(|name| name.parse().ok())
            .map(|name| Self::of(root, &name))
            .filter(Self::exists)
            .collect();
        all.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(all)
    }

    /// Its path.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Name of the machine.
    #[must_use]
    pub fn name(&self) -> &MachineName {
        &self.name
    }

    /// Whether the machine has a folder in this root.
    #[must_use]
    pub fn exists(&self) -> bool {
        self.queue().is_dir()
    }

    /// Whether no other machine has its folder in this root. A command does not say which of several machines of one
    /// computer it operates.
    #[must_use]
    pub fn is_alone(&self) -> bool {
        let others = self.path.parent().map(Self::all);
        matches!(others, Some(Ok(all)) if all.iter().all(|other| other.name == self.name))
    }

    /// Creates what is missing, for its user only, and makes it durable.
    ///
    /// # Errors
    /// `E5010`
    pub fn create(&self) -> Result<(), NumberedError> {
        for folder in [self.queue(), self.inbox()] {
            state_file::create_private_folder(&folder).map_err(|error| unusable(&folder, &error))?;
        }
        sync_folder(&self.path)
    }

    /// Jobs that wait to be taken.
    #[must_use]
    pub fn queue(&self) -> PathBuf {
        self.path.join("queue")
    }

    /// Jobs that the machine has taken.
    #[must_use]
    pub fn inbox(&self) -> PathBuf {
        self.path.join("inbox")
    }

    /// The machine's ledger.
    #[must_use]
    pub fn ledger(&self) -> PathBuf {
        self.inbox().join("ledger")
    }

    /// The log of messages that were obeyed or shown.
    #[must_use]
    pub fn messages(&self) -> PathBuf {
        self.inbox().join("messages")
    }

    /// The log of files that came from the watched folder.
    #[must_use]
    pub(crate) fn watch_log(&self) -> PathBuf {
        self.path.join("watched")
    }

    /// The number of the last connection of the Sparkplug edge node.
    #[cfg(unix)]
    #[must_use]
    pub(crate) fn birth_death_number(&self) -> PathBuf {
        self.path.join("sparkplug")
    }

    /// Locks the machine against another agent, until the file is dropped or the process ends.
    ///
    /// # Errors
    /// `E5011` where another agent runs; `E5010`.
    pub fn lock_agent(&self) -> Result<File, NumberedError> {
        lock(&self.inbox().join("agent.lock"))?.ok_or_else(|| {
            let what = format!("another agent of machine {} is running", self.name);
            NumberedError::new("E5011", what, "one agent is enough; stop the other one first")
        })
    }

    /// Locks the machine against another Sparkplug edge node, until the file is dropped or the process ends.
    ///
    /// # Errors
    /// `E5026` where another one runs; `E5010`.
    pub fn lock_sparkplug(&self) -> Result<File, NumberedError> {
        lock(&self.path.join("sparkplug.lock"))?.ok_or_else(|| {
            let what = format!("machine {} is an edge node already: another `retrace shop sparkplug` runs", self.name);
            NumberedError::new("E5026", what, "one is enough; stop the other one first")
        })
    }
}

/// Locks a file; none where another process has locked it.
fn lock(path: &Path) -> Result<Option<File>, NumberedError> {
    let file = state_file::open_lock(path).map_err(|error| unusable(path, &error))?;
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(fs::TryLockError::WouldBlock) => Ok(None),
        Err(fs::TryLockError::Error(error)) => Err(unusable(path, &error)),
    }
}

/// Names of the entries of a folder, sorted; none where it does not exist. A name that is not Unicode is none of ours.
///
/// # Errors
/// `E5010`
pub(crate) fn folder_names(folder: &Path) -> Result<Vec<String>, NumberedError> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(unusable(folder, &error)),
    };
    let mut names = Vec::new();
    for entry in entries {
        let entry = entry.map_err(|error| unusable(folder, &error))?;
        names.extend(entry.file_name().into_string());
    }
    names.sort();
    Ok(names)
}

/// Makes the entries of a folder durable; where a folder cannot be opened as a file, the system takes care of that.
///
/// # Errors
/// `E5010`
pub(crate) fn sync_folder(folder: &Path) -> Result<(), NumberedError> {
    if !cfg!(unix) {
        return Ok(());
    }
    File::open(folder).and_then(|file| file.sync_all()).map_err(|error| unusable(folder, &error))
}

/// Deletes a folder with everything in it, if it is there.
///
/// # Errors
/// `E5010`
pub(crate) fn delete_folder(folder: &Path) -> Result<(), NumberedError> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(unusable(folder, &error)),
        _ => Ok(()),
    }
}

/// Writes a new file that only its user can read, durably.
pub(crate) fn write_new(path: &Path, bytes: &[u8]) -> Result<(), NumberedError> {
    let write = || {
        let mut file = state_file::private().write(true).create(true).truncate(true).open(path)?;
        file.write_all(bytes)?;
        file.sync_all()
    };
    write().map_err(|error| unusable(path, &error))
}

/// A file or folder that cannot be read or written.
pub(crate) fn unusable(path: &Path, error: &io::Error) -> NumberedError {
    let what = format!("{}: {error}", path.display());
    NumberedError::new("E5010", what, "check the permissions and the disk, or name another `root` in the shop file")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_machines_of_a_root_and_one_agent_each() {
        let root = tempfile::tempdir().expect("a folder");
        let folder = MachineFolder::of(root.path(), &MachineName::local());
        assert_eq!(MachineFolder::all(root.path()), Ok(Vec::new()));
        folder.create().expect("created");
        fs::create_dir(root.path().join("Not_a_machine")).expect("a folder");
        assert_eq!(MachineFolder::all(root.path()), Ok(vec![folder.clone()]));
        let held = folder.lock_agent().expect("free");
        assert_eq!(folder.lock_agent().expect_err("held").number, "E5011");
        drop(held);
        folder.lock_agent().expect("free again");
        fs::write(root.path().join("file"), "").expect("a file");
        assert_eq!(MachineFolder::all(&root.path().join("file")).expect_err("a file").number, "E5010");
    }
}
