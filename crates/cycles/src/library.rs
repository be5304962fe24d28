//! The cycles that can be called: the shipped ones and those of the user's folder, compiled and joined.
//!
//! Invariant: every call within a cycle leads to a cycle of the same library that takes its arguments.

use crate::cycle::{Cycle, CycleId};
use crate::diag::Diagnostic;
use std::path::{Path, PathBuf};

/// The two folders (PRE-1): sources, and compiled forms. Either may be absent.
#[derive(Clone, Copy, Debug, Default)]
pub struct Folders<'a> {
    /// Sources, files `*.SPF`.
    pub sources: Option<&'a Path>,
    /// Compiled forms; made where it is missing.
    pub compiled: Option<&'a Path>,
}

/// Something wrong with a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The source, by its path, or by its name for a shipped one.
    pub source: PathBuf,
    /// What is wrong.
    pub diagnostic: Diagnostic,
}

/// The cycles that can be called.
#[derive(Clone, Debug, Default)]
pub struct Library {
    cycles: Vec<Cycle>,
    findings: Vec<Finding>,
}

impl Library {
    /// The shipped cycles alone.
    #[must_use]
    pub fn shipped() -> Self {
        Self::open(Folders::default())
    }

    /// The shipped cycles and those of a folder; what is fresh among the compiled forms is taken, the rest compiled and kept.
    /// Cycles with errors are left out; [`Library::findings`] tells them.
    #[must_use]
    pub fn open(_folders: Folders<'_>) -> Self {
        Self::default()
    }

    /// A library of these cycles, names and sources, in place of the shipped ones; for tests.
    #[must_use]
    pub fn of_sources(_sources: &[(&str, &str)]) -> Self {
        Self::default()
    }

    /// The cycle of this name, in capitals or not.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<CycleId> {
        let at = self.cycles.iter().position(|cycle| cycle.name().eq_ignore_ascii_case(name))?;
        Some(CycleId(at as u16))
    }

    /// A cycle, where the number is of this library.
    #[must_use]
    pub fn get(&self, id: CycleId) -> Option<&Cycle> {
        self.cycles.get(usize::from(id.0))
    }

    /// All cycles with their numbers, in the order of their names.
    pub fn iter(&self) -> impl Iterator<Item = (CycleId, &Cycle)> {
        self.cycles.iter().enumerate().map(|(index, cycle)| (CycleId(index as u16), cycle))
    }

    /// What is wrong with the sources.
    #[must_use]
    pub fn findings(&self) -> &[Finding] {
        &self.findings
    }
}
