//! The wear of the consumables of each cutter since they were changed (CUT-62), in a file of the machine in the state
//! folder.
//!
//! Invariant: the file is replaced whole, one process at a time; what a job adds is added to what is there.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use retrace_config::NumberedError;
use serde::{Deserialize, Serialize};

use crate::state_file::{self, FileAccess};
use crate::timestamp::Timestamp;

/// What the consumables of a cutter have done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConsumableWear {
    /// Number of times that the cutter was lit, also those in which it did not start.
    pub starts: u64,
    /// Number of those in which it was not proven.
    pub failed_starts: u64,
    /// Time in s for which it was on.
    pub lit_s: f64,
    /// Length that it cut, in m.
    pub cut_m: f64,
}

impl ConsumableWear {
    /// Adds what another one has done.
    pub fn add(&mut self, more: &Self) {
        self.starts += more.starts;
        self.failed_starts += more.failed_starts;
        self.lit_s += more.lit_s;
        self.cut_m += more.cut_m;
    }
}

/// The consumables of a cutter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ConsumableSet {
    /// Time at which they were changed, or at which counting began.
    pub since: Timestamp,
    /// Their wear.
    #[serde(flatten)]
    pub wear: ConsumableWear,
}

/// The consumables of a machine's cutters, by the names of these.
pub type ConsumableSets = BTreeMap<String, ConsumableSet>;

/// The file of a machine.
#[derive(Clone, Debug)]
pub struct ConsumableFile(PathBuf);

impl ConsumableFile {
    /// The file at this path.
    #[must_use]
    pub fn at(path: &Path) -> Self {
        Self(path.to_owned())
    }

    /// Reads the sets; none where nothing was counted yet, or the file cannot be read.
    #[must_use]
    pub fn read(&self) -> ConsumableSets {
        let text = std::fs::read(&self.0).unwrap_or_default();
        serde_json::from_slice(&text).unwrap_or_default()
    }

    /// Adds the wear of a job.
    ///
    /// # Errors
    /// `E2105`: it cannot be written.
    pub fn add(&self, wear: &BTreeMap<String, ConsumableWear>) -> Result<ConsumableSets, NumberedError> {
        self.change(|sets| {
            for (name, more) in wear {
                let new = || ConsumableSet { since: Timestamp::now(), wear: ConsumableWear::default() };
                sets.entry(name.clone()).or_insert_with(new).wear.add(more);
            }
        })
    }

    /// The consumables of these cutters are new.
    ///
    /// # Errors
    /// `E2105`: it cannot be written.
    pub fn begin(&self, names: &[String]) -> Result<ConsumableSets, NumberedError> {
        let new = ConsumableSet { since: Timestamp::now(), wear: ConsumableWear::default() };
        self.change(|sets| sets.extend(names.iter().map(|name| (name.clone(), new))))
    }

    fn change(&self, change: impl FnOnce(&mut ConsumableSets)) -> Result<ConsumableSets, NumberedError> {
        let change = || -> io::Result<ConsumableSets> {
            self.0.parent().map_or(Ok(()), state_file::create_private_folder)?;
            let lock = state_file::open_lock(&self.0.with_extension("lock"))?;
            lock.lock()?;
            let mut sets = self.read();
            change(&mut sets);
            state_file::replace(&self.0, &serde_json::to_vec_pretty(&sets)?, FileAccess::Private)?;
            Ok(sets)
        };
        change().map_err(|error| {
            let what = format!("{} cannot be written: {error}", self.0.display());
            NumberedError::new("E2105", what, "check the folder's permissions and its disk: the wear is counted there")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wear_adds_up_until_the_consumables_are_new() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = ConsumableFile::at(&folder.path().join("state/table.consumables.json"));
        assert!(file.read().is_empty());
        let wear = ConsumableWear { starts: 3, failed_starts: 1, lit_s: 20.5, cut_m: 0.75 };
        let job: BTreeMap<_, _> = ["torch", "scribe"].map(|name| (name.to_owned(), wear)).into();
        file.add(&job).expect("a file");
        let sets = file.add(&job).expect("a file");
        assert_eq!(sets["torch"].wear, ConsumableWear { starts: 6, failed_starts: 2, lit_s: 41.0, cut_m: 1.5 });
        assert_eq!(sets, file.read());
        let new = file.begin(&["torch".to_owned()]).expect("a file");
        assert_eq!(new["torch"].wear, ConsumableWear::default());
        assert!(new["torch"].since >= sets["torch"].since && new["scribe"] == sets["scribe"]);
        std::fs::write(folder.path().join("state/table.consumables.json"), "torn").expect("a file");
        assert_eq!(file.add(&job).expect("a file")["torch"].wear, wear, "what cannot be read is counted anew");
    }
}
