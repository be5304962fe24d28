//! The library of callable cycles: the shipped ones and those of the user's folder, compiled and linked.
//!
//! Invariant: every call within a cycle leads to a cycle of the same library that accepts its arguments. A cycle with
//! an error is not in the library, nor is one that calls it. A shipped cycle does not replace a user's cycle that has
//! errors.

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

/// An error or warning in a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LibraryFinding {
    /// Source: its path, or the name of a shipped one.
    pub source: PathBuf,
    /// The error or warning.
    pub diagnostic: Diagnostic,
}

/// Library of callable cycles.
#[derive(Clone, Debug, Default)]
pub struct CycleLibrary {
    cycles: Vec<Cycle>,
    findings: Vec<LibraryFinding>,
    identity: u128,
    source_files: Vec<(PathBuf, u128)>,
    /// Whether a name has a digit after its first letter.
    has_early_digit: bool,
}

impl CycleLibrary {
    /// Creates a library of the shipped cycles alone.
    #[must_use]
    pub fn shipped() -> Self {
        Self::open(Folders::default())
    }

    /// Opens the shipped cycles and those of a folder. Up-to-date compiled forms are loaded; the other sources are
    /// compiled and their forms stored. Cycles with errors are left out and reported by [`CycleLibrary::findings`].
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

    /// Creates a library of these cycles alone, given as file names and sources and treated as a user's cycles; for
    /// tests and tools.
    #[must_use]
    pub fn of_sources(sources: &[(&str, &str)]) -> Self {
        let sources =
            sources.iter().map(|(name, text)| Source::new(Path::new(name), Origin::User, text.as_bytes().into()));
        Self::of(sources.collect(), Folders::default(), Vec::new())
    }

    /// Creates a library of cycles without sources.
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
        // Sorted by name, so that a name is found by binary search and the numbers do not depend on the order of a
        // folder.
        forms.sort_by(|a, b| a.unit.name.cmp(&b.unit.name));
        let keys: Vec<u8> = forms.iter().flat_map(|form| form.key.to_le_bytes()).collect();
        let cycles = linker::link(forms, &mut findings);
        findings.sort_by(|a, b| (&a.source, a.diagnostic.line).cmp(&(&b.source, b.diagnostic.line)));
        let has_early_digit = cycles.iter().any(|cycle| cycle.name().as_bytes().get(1).is_some_and(u8::is_ascii_digit));
        Self { cycles, findings, identity: stored::hash(&[&keys]), source_files: Vec::new(), has_early_digit }
    }

    /// Returns the cycle of this name, in either case. It does not allocate.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<CycleId> {
        let wanted = || name.bytes().map(|byte| byte.to_ascii_uppercase());
        let at = self.cycles.binary_search_by(|cycle| cycle.name().bytes().cmp(wanted())).ok()?;
        Some(CycleId(at as u16))
    }

    /// Whether a cycle has a digit after the first letter of its name, as a word of a block has.
    #[must_use]
    pub const fn has_early_digit(&self) -> bool {
        self.has_early_digit
    }

    /// Returns a cycle, if the identifier belongs to this library.
    #[must_use]
    pub fn get(&self, id: CycleId) -> Option<&Cycle> {
        self.cycles.get(usize::from(id.0))
    }

    /// Returns all cycles with their identifiers, sorted by name.
    pub fn iter(&self) -> impl Iterator<Item = (CycleId, &Cycle)> {
        self.cycles.iter().enumerate().map(|(index, cycle)| (CycleId(index as u16), cycle))
    }

    /// Returns the errors and warnings of the sources.
    #[must_use]
    pub fn findings(&self) -> &[LibraryFinding] {
        &self.findings
    }

    /// Returns every source of the user's folder that was read, with a hash of its text; those with errors are
    /// included.
    #[must_use]
    pub fn source_files(&self) -> &[(PathBuf, u128)] {
        &self.source_files
    }

    /// Returns a hash that changes with the shipped cycles and with the compiler version.
    #[must_use]
    pub fn shipped_identity() -> u128 {
        let keys: Vec<u8> =
            builtin::SOURCES.iter().flat_map(|(name, text)| stored::key(text.as_bytes(), name).to_le_bytes()).collect();
        stored::hash(&[&keys])
    }

    /// Returns a hash that changes with any cycle: the key for data derived from a program and these cycles.
    #[must_use]
    pub const fn identity(&self) -> u128 {
        self.identity
    }
}
