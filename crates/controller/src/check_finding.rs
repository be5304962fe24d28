//! Findings of the check of a program.
//!
//! Invariant: each has a number in `docs/errors.md`, a cause and a remedy.

/// A finding of a check: an error, which prevents the run, or a warning.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckFinding {
    /// Program line.
    pub line: u32,
    /// Letter of the word that it is about, if any.
    pub word: Option<char>,
    /// Number in `docs/errors.md`.
    pub number: &'static str,
    /// Cause.
    pub cause: String,
    /// Remedy.
    pub remedy: String,
}

impl CheckFinding {
    /// Whether it prevents the program from being run. Otherwise it is a warning.
    #[must_use]
    pub fn is_error(&self) -> bool {
        self.number.starts_with('E')
    }
}
