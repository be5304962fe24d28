//! The cycles that can be called: the shipped ones and those of the user's folder, compiled and joined.
//!
//! Invariant: every call within a cycle leads to a cycle of the same library that takes its arguments. A cycle with an error is
//! not in it, and neither is one that calls it; nor does a shipped cycle stand in for a user's that has errors.

mod folders;
mod linker;
mod name;

use crate::builtin;
use crate::cycle::{Cycle, CycleId, Origin};
use crate::diag::Diagnostic;
use crate::error_codes::ErrorCode;
use crate::stored;
use folders::Source;
use std::path::{Path, PathBuf};

pub use folders::Folders;

/// Something wrong with a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LibraryFinding {
    /// The source: its path, or the name of a shipped one.
    pub source: PathBuf,
    /// What is wrong.
    pub diagnostic: Diagnostic,
}

/// The cycles that can be called.
#[derive(Clone, Debug, Default)]
pub struct CycleLibrary {
    cycles: Vec<Cycle>,
    findings: Vec<LibraryFinding>,
    identity: u128,
    source_files: Vec<(PathBuf, u128)>,
    /// A name has a digit behind its first letter.
    has_early_digit: bool,
}

impl CycleLibrary {
    /// The shipped cycles alone.
    #[must_use]
    pub fn shipped() -> Self {
        Self::open(Folders::default())
    }

    /// The shipped cycles and those of a folder; what is fresh among the compiled forms is taken, the rest compiled and kept.
    /// Cycles with errors are left out; [`Library::findings`] tells them.
    #[must_use]
    pub fn open(folders: Folders<'_>) -> Self {
        let mut findings = Vec::new();
        let mut sources = folders.users(&mut findings);
        let source_files = sources.iter().map(Source::identified).collect();
        let shipped = builtin::SOURCES.iter();
        sources
            .extend(shipped.map(|(name, text)| Source::new(Path::new(name), Origin::Shipped, text.as_bytes().into())));
        Self { source_files, ..Self::of(sources, folders, findings) }
    }

    /// A library of these cycles alone, names of files and sources, as if they were a user's; for tests and tools.
    #[must_use]
    pub fn of_sources(sources: &[(&str, &str)]) -> Self {
        let sources =
            sources.iter().map(|(name, text)| Source::new(Path::new(name), Origin::User, text.as_bytes().into()));
        Self::of(sources.collect(), Folders::default(), Vec::new())
    }

    /// A library of cycles that no source stands behind.
    #[cfg(test)]
    pub(crate) fn of_cycles(cycles: Vec<Cycle>) -> Self {
        Self { cycles, ..Self::default() }
    }

    fn of(sources: Vec<Source>, folders: Folders<'_>, mut findings: Vec<LibraryFinding>) -> Self {
        let mut forms = folders::forms(sources, folders, &mut findings);
        forms.retain(|form| match name::cannot_be_called(&form.unit.name) {
            None => true,
            Some(message) => {
                let diagnostic = Diagnostic { code: ErrorCode::NameNotCallable, line: 1, start: 0, end: 0, message };
                findings.push(LibraryFinding { source: form.path.clone(), diagnostic });
                false
            }
        });
        // By name, so that a name is found by halving and the numbers do not depend on the order of a folder.
        forms.sort_by(|a, b| a.unit.name.cmp(&b.unit.name));
        let keys: Vec<u8> = forms.iter().flat_map(|form| form.key.to_le_bytes()).collect();
        let cycles = linker::join(forms, &mut findings);
        findings.sort_by(|a, b| (&a.source, a.diagnostic.line).cmp(&(&b.source, b.diagnostic.line)));
        let has_early_digit = cycles.iter().any(|cycle| cycle.name().as_bytes().get(1).is_some_and(u8::is_ascii_digit));
        Self { cycles, findings, identity: stored::hash(&[&keys]), source_files: Vec::new(), has_early_digit }
    }

    /// The cycle of this name, in capitals or not. Does not allocate.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<CycleId> {
        let wanted = || name.bytes().map(|byte| byte.to_ascii_uppercase());
        let at = self.cycles.binary_search_by(|cycle| cycle.name().bytes().cmp(wanted())).ok()?;
        Some(CycleId(at as u16))
    }

    /// Whether a cycle has a digit behind the first letter of its name, as a word of a block has.
    #[must_use]
    pub const fn has_early_digit(&self) -> bool {
        self.has_early_digit
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

    /// What is wrong with the sources, and what is suspicious.
    #[must_use]
    pub fn findings(&self) -> &[LibraryFinding] {
        &self.findings
    }

    /// Every source of the user's folder that was read, with a number that changes with its text; those with errors are among them.
    #[must_use]
    pub fn source_files(&self) -> &[(PathBuf, u128)] {
        &self.source_files
    }

    /// A number that changes with the shipped cycles and with how this version compiles them.
    #[must_use]
    pub fn shipped_identity() -> u128 {
        let keys: Vec<u8> =
            builtin::SOURCES.iter().flat_map(|(name, text)| stored::key(text.as_bytes(), name).to_le_bytes()).collect();
        stored::hash(&[&keys])
    }

    /// A number that changes with any cycle: the key for what is derived from a program and these cycles.
    #[must_use]
    pub const fn identity(&self) -> u128 {
        self.identity
    }
}
