//! Diagnostics of cycle sources: what is wrong, where, and what to do.
//!
//! Invariant: columns count bytes of the line from 1; a span is always within its line.

use crate::error_codes::{ErrorCode, Severity};
use std::fmt;

/// One error or warning in a cycle source or a folder of cycles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Code of the error; its number is listed in `docs/errors.md`.
    pub code: ErrorCode,
    /// Line of the source, counted from 1; 0 for the whole file.
    pub line: u32,
    /// First byte of the span in the line, from 0.
    pub start: u32,
    /// Byte after the last.
    pub end: u32,
    /// Description of this occurrence.
    pub message: String,
}

impl Diagnostic {
    /// Creates a diagnostic for the whole file.
    pub(crate) fn of_file(code: ErrorCode, message: impl Into<String>) -> Self {
        Self { code, line: 0, start: 0, end: 0, message: message.into() }
    }

    /// Returns whether it is an error or a warning.
    #[must_use]
    pub fn severity(&self) -> Severity {
        self.code.severity()
    }

    /// Returns the number that users see, such as `E1905`.
    #[must_use]
    pub fn number(&self) -> &'static str {
        self.code.number()
    }

    /// Returns the column of the span's first byte, counted from 1.
    #[must_use]
    pub fn column(&self) -> u32 {
        self.start + 1
    }

    /// Returns the remedy.
    #[must_use]
    pub fn help(&self) -> &'static str {
        self.code.remedy()
    }
}

impl fmt::Display for Diagnostic {
    /// Writes `12:5: error[E1906]: …` and the help in a line of its own; without a position for the whole file.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line > 0 {
            write!(f, "{}:{}: ", self.line, self.column())?;
        }
        let level = if self.severity() == Severity::Error { "error" } else { "warning" };
        write!(f, "{level}[{}]: {}\n  help: {}", self.number(), self.message, self.help())
    }
}
