//! Diagnostics of cycle sources: what is wrong, where, and what to do.
//!
//! Invariant: columns count bytes of the line from 1; a span never leaves its line.

use crate::error_codes::ErrorCode;
use std::fmt;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// The cycle cannot be called.
    Error,
    /// Legal, and suspicious.
    Warning,
}

/// One thing that is wrong with a cycle source or a folder of cycles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// What it is about; its number stands in `docs/errors.md`.
    pub code: ErrorCode,
    /// Line of the source, counted from 1; 0 where it is about the whole file.
    pub line: u32,
    /// First byte of the line that is meant, from 0.
    pub start: u32,
    /// Byte after the last.
    pub end: u32,
    /// What is wrong here.
    pub message: String,
}

impl Diagnostic {
    /// A diagnostic about the whole file.
    pub(crate) fn of_file(code: ErrorCode, message: impl Into<String>) -> Self {
        Self { code, line: 0, start: 0, end: 0, message: message.into() }
    }

    /// Error or warning.
    #[must_use]
    pub fn severity(&self) -> Severity {
        if self.code.number().starts_with('W') { Severity::Warning } else { Severity::Error }
    }

    /// The number that users see, such as `E1905`.
    #[must_use]
    pub fn number(&self) -> &'static str {
        self.code.number()
    }

    /// Column of the span's first byte, counted from 1.
    #[must_use]
    pub fn column(&self) -> u32 {
        self.start + 1
    }

    /// What to do about it.
    #[must_use]
    pub fn help(&self) -> &'static str {
        self.code.remedy()
    }
}

impl fmt::Display for Diagnostic {
    /// `12:5: error[E1906]: …` and the help in a line of its own; no place where it is about the whole file.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line > 0 {
            write!(f, "{}:{}: ", self.line, self.column())?;
        }
        let level = if self.severity() == Severity::Error { "error" } else { "warning" };
        write!(f, "{level}[{}]: {}\n  help: {}", self.number(), self.message, self.help())
    }
}
