//! The two folders (PRE-1): sources, and compiled forms.
//!
//! Invariant: a missing folder is not an error; a compiled form is written completely or not at all.

use super::LibraryFinding;
use crate::code::Unit;
use crate::compile::compile;
use crate::cycle::Origin;
use crate::diag::Diagnostic;
use crate::error_codes::{ErrorCode, Severity};
use crate::stored::{self, FormError};
use std::borrow::Cow;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// File extension of sources.
const SOURCE_ENDING: &str = "SPF";
/// File extension of compiled forms.
const FORM_ENDING: &str = "CYC";
/// Maximum length of a source that is read.
const MAX_SOURCE_BYTES: u64 = 2 << 20;

/// The two folders. Either may be absent.
#[derive(Clone, Copy, Debug, Default)]
pub struct Folders<'a> {
    /// Sources, files `*.SPF`.
    pub sources: Option<&'a Path>,
    /// Compiled forms, files `*.CYC`; the folder is created if it is missing.
    pub compiled: Option<&'a Path>,
}

/// A source before it is compiled.
#[derive(Debug)]
pub(super) struct Source {
    path: PathBuf,
    origin: Origin,
    text: Cow<'static, [u8]>,
}

/// A compiled source.
#[derive(Debug)]
pub(super) struct Form {
    pub(super) unit: Unit,
    pub(super) origin: Origin,
    pub(super) path: PathBuf,
    /// Whether the compiled form was loaded from its folder.
    pub(super) is_from_cache: bool,
    pub(super) key: u128,
}

impl Source {
    pub(super) fn new(path: &Path, origin: Origin, text: Vec<u8>) -> Self {
        Self { path: path.to_owned(), origin, text: Cow::Owned(text) }
    }

    /// Returns the path, and a hash of the text.
    pub(super) fn identified(&self) -> (PathBuf, u128) {
        (self.path.clone(), stored::hash(&[&self.text]))
    }

    /// Returns the name of the file without its extension, in capitals.
    fn stem(&self) -> String {
        self.path.file_stem().unwrap_or_default().to_string_lossy().to_ascii_uppercase()
    }
}

impl Folders<'_> {
    /// Returns the sources of the user's folder, sorted by name.
    pub(super) fn users(self, findings: &mut Vec<LibraryFinding>) -> Vec<Source> {
        let Some(folder) = self.sources else { return Vec::new() };
        let mut refuse = |path: &Path, error: &std::io::Error| {
            let diagnostic = Diagnostic::of_file(ErrorCode::SourceUnreadable, format!("cannot be read: {error}"));
            findings.push(LibraryFinding { source: path.to_owned(), diagnostic });
        };
        let entries = match std::fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(error) => {
                if error.kind() != ErrorKind::NotFound {
                    refuse(folder, &error);
                }
                return Vec::new();
            }
        };
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.retain(|path| path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(SOURCE_ENDING)));
        paths.sort();
        let mut sources = Vec::new();
        for path in paths {
            match read_source(&path) {
                Ok(text) => sources.push(Source::new(&path, Origin::User, text)),
                Err(error) => refuse(&path, &error),
            }
        }
        sources
    }
}

fn read_source(path: &Path) -> std::io::Result<Vec<u8>> {
    let length = std::fs::metadata(path)?.len();
    if length > MAX_SOURCE_BYTES {
        return Err(std::io::Error::other(format!("{length} bytes are too many for a source file")));
    }
    std::fs::read(path)
}

/// Compiles the sources, or loads their forms. A repeated name is refused; a shipped one is replaced.
pub(super) fn forms(sources: Vec<Source>, folders: Folders<'_>, findings: &mut Vec<LibraryFinding>) -> Vec<Form> {
    let mut forms: Vec<Form> = Vec::new();
    // Names in use, also of sources with errors.
    let mut taken: Vec<(String, PathBuf)> = Vec::new();
    for source in sources {
        let stem = source.stem();
        let holder = |name: &str| taken.iter().find(|(known, _)| known == name).map(|(_, path)| path.clone());
        if let (Origin::Shipped, Some(path)) = (source.origin, holder(&stem)) {
            let diagnostic =
                Diagnostic::of_file(ErrorCode::ShippedReplaced, format!("{stem} replaces the shipped cycle"));
            findings.push(LibraryFinding { source: path, diagnostic });
            continue;
        }
        let key = stored::key(&source.text, &stem);
        let stored = folders.compiled.map(|folder| folder.join(&stem).with_extension(FORM_ENDING));
        let fresh = stored.as_deref().and_then(|path| load_form(path, key, &source.path, findings));
        let is_from_cache = fresh.is_some();
        let (unit, diagnostics) = match fresh {
            Some((unit, warnings)) => (Some(unit), warnings),
            None => {
                let compiled = compile(&source.text, &stem);
                if let (Some(unit), Some(path)) = (&compiled.unit, &stored) {
                    store_form(path, &stored::write(unit, &compiled.diagnostics, key), &source.path, findings);
                }
                (compiled.unit, compiled.diagnostics)
            }
        };
        let found =
            diagnostics.into_iter().map(|diagnostic| LibraryFinding { source: source.path.clone(), diagnostic });
        findings.extend(found);
        let Some(unit) = unit else {
            taken.push((stem, source.path));
            continue;
        };
        if let Some(path) = holder(&unit.name) {
            let message = format!("{} is also defined in {}", unit.name, path.display());
            let diagnostic = Diagnostic::of_file(ErrorCode::CycleTwice, message);
            findings.push(LibraryFinding { source: source.path, diagnostic });
            continue;
        }
        taken.push((unit.name.clone(), source.path.clone()));
        forms.push(Form { unit, origin: source.origin, path: source.path, is_from_cache, key });
    }
    forms
}

/// Returns the form in a file, if it is usable.
fn load_form(
    path: &Path,
    key: u128,
    source: &Path,
    findings: &mut Vec<LibraryFinding>,
) -> Option<(Unit, Vec<Diagnostic>)> {
    let bytes = std::fs::read(path).ok()?;
    match stored::read(&bytes, key) {
        Ok((unit, warnings)) if warnings.iter().all(|warning| warning.severity() == Severity::Warning) => {
            Some((unit, warnings))
        }
        Err(FormError::Stale) => None,
        Ok(_) | Err(FormError::Torn) => {
            let message = format!("{} is damaged or of another program", path.display());
            let diagnostic = Diagnostic::of_file(ErrorCode::StoredTorn, message);
            findings.push(LibraryFinding { source: source.to_owned(), diagnostic });
            None
        }
    }
}

/// Writes a form under another name first, so that a partial form is never read.
fn store_form(path: &Path, bytes: &[u8], source: &Path, findings: &mut Vec<LibraryFinding>) {
    let unfinished = path.with_extension(format!("{}.new", std::process::id()));
    let folder = path.parent().unwrap_or(path);
    let written = std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(&unfinished, bytes))
        .and_then(|()| std::fs::rename(&unfinished, path));
    if let Err(error) = written {
        // The partial file is of no use; a failure to remove it is ignored.
        let _ = std::fs::remove_file(&unfinished);
        let diagnostic =
            Diagnostic::of_file(ErrorCode::NotStored, format!("{} cannot be written: {error}", path.display()));
        findings.push(LibraryFinding { source: source.to_owned(), diagnostic });
    }
}
