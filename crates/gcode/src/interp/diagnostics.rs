//! Diagnostics that the interpreter collects.
//!
//! Invariant: one diagnostic for a number and a place; how often it was found again is counted (PRB-19).

use super::{Interpreter, MAX_ERRORS};
use crate::diag::{BlockError, Diagnostic, Severity, Span};
use crate::error_codes::ErrorCode;

impl Interpreter {
    /// Returns the number of times that the diagnostic of this index was found again, in a loop or a call.
    #[must_use]
    pub fn more_rounds(&self, index: usize) -> u32 {
        self.more_rounds.get(index).copied().unwrap_or_default()
    }

    /// Returns the diagnostics so far.
    #[must_use]
    pub fn diagnostics(&self) -> &[Diagnostic] {
        &self.diagnostics
    }

    /// Returns the diagnostics since the last call.
    pub fn take_diagnostics(&mut self) -> Vec<Diagnostic> {
        self.more_rounds.clear();
        std::mem::take(&mut self.diagnostics)
    }

    /// Whether the maximum number of errors is reached and checking stops.
    #[must_use]
    pub fn has_too_many_errors(&self) -> bool {
        self.errors >= MAX_ERRORS
    }

    /// Records an error for the current line.
    pub(crate) fn report(&mut self, fault: BlockError) {
        let BlockError { code, span, message } = fault;
        let diagnostic = Diagnostic { code, file: self.file, line: self.line, span, message };
        self.record(diagnostic);
    }

    /// Records a diagnostic, unless it exists already: a loop executes the same line repeatedly.
    pub(crate) fn record(&mut self, diagnostic: Diagnostic) {
        let same = |known: &Diagnostic| {
            (known.code, known.file, known.line) == (diagnostic.code, diagnostic.file, diagnostic.line)
                && known.span == diagnostic.span
        };
        if let Some(known) = self.diagnostics.iter().position(same) {
            self.more_rounds.resize(self.diagnostics.len(), 0);
            self.more_rounds[known] = self.more_rounds[known].saturating_add(1);
            return;
        }
        let is_error = diagnostic.severity() == Severity::Error;
        let count = if is_error { &mut self.errors } else { &mut self.warnings };
        if *count >= MAX_ERRORS {
            return;
        }
        *count += 1;
        self.diagnostics.push(diagnostic);
        if is_error && self.has_too_many_errors() {
            let BlockError { code, span, message } = BlockError::plain(ErrorCode::TooManyErrors, Span::default());
            self.diagnostics.push(Diagnostic { code, file: self.file, line: self.line, span, message });
        }
    }
}
