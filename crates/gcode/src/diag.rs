//! Diagnostics: what is wrong with a program, where, and what to do.
//!
//! Invariant: columns count bytes of the line from 1, and a span is always within its line.

use crate::error_codes::ErrorCode;
use annotate_snippets::{AnnotationKind, Level, Renderer, Snippet};
pub use retrace_cycles::Severity;
use std::fmt;

/// A range of bytes of one line. `end` is the first byte after it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Span {
    /// First byte.
    pub start: u32,
    /// Byte after the last.
    pub end: u32,
}

impl Span {
    pub(crate) fn new(start: usize, end: usize) -> Span {
        Span { start: start as u32, end: end.max(start) as u32 }
    }
}

/// One error or warning in a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// Code of the error; its number is listed in `docs/errors.md`.
    pub code: ErrorCode,
    /// File: 0 for the program itself, and above it the files of its subprograms, as numbered by the pre-scan.
    pub file: u16,
    /// Line of the file, counted from 1.
    pub line: u32,
    /// Range within that line.
    pub span: Span,
    /// Description of this occurrence.
    pub message: String,
}

impl Diagnostic {
    /// Returns whether it is an error or a warning.
    #[must_use]
    pub fn severity(&self) -> Severity {
        self.code.severity()
    }

    /// Returns the number that users see, such as `E1101`.
    #[must_use]
    pub fn number(&self) -> &'static str {
        self.code.number()
    }

    /// Returns the column of the first byte of the span, counted from 1.
    #[must_use]
    pub fn column(&self) -> u32 {
        self.span.start + 1
    }

    /// Returns the remedy.
    #[must_use]
    pub fn help(&self) -> &'static str {
        self.code.remedy()
    }

    /// Renders the diagnostic with its source line, a mark under the span, and the help. `source_line` is the line
    /// without its end.
    #[must_use]
    pub fn render(&self, file_name: &str, source_line: &str) -> String {
        let level = match self.severity() {
            Severity::Error => Level::ERROR,
            Severity::Warning => Level::WARNING,
        };
        let start = floor_char_boundary(source_line, self.span.start as usize);
        let end = floor_char_boundary(source_line, self.span.end as usize).max(start);
        let snippet = Snippet::source(source_line)
            .path(file_name)
            .line_start(self.line.max(1) as usize)
            .annotation(AnnotationKind::Primary.span(start..end));
        let report = [level
            .primary_title(self.message.as_str())
            .id(self.number())
            .element(snippet)
            .element(Level::HELP.message(self.help()))];
        Renderer::plain().render(&report).to_string()
    }
}

/// Returns the greatest character boundary of `text` that is at most `at`.
fn floor_char_boundary(text: &str, at: usize) -> usize {
    let mut at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

/// An error found while a line is read or executed. The line number is added where it is recorded.
#[derive(Debug)]
pub(crate) struct BlockError {
    pub(crate) code: ErrorCode,
    pub(crate) span: Span,
    pub(crate) message: String,
}

impl BlockError {
    #[cold]
    pub(crate) fn new(code: ErrorCode, span: Span, message: impl Into<String>) -> BlockError {
        BlockError { code, span, message: message.into() }
    }

    /// Creates an error whose general title is sufficient.
    #[cold]
    pub(crate) fn plain(code: ErrorCode, span: Span) -> BlockError {
        BlockError::new(code, span, code.title())
    }
}

impl fmt::Display for BlockError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.code.number(), self.message)
    }
}

impl std::error::Error for BlockError {}

/// Result of reading or executing a block.
pub(crate) type BlockResult<T> = Result<T, Box<BlockError>>;

#[cold]
pub(crate) fn fault<T>(code: ErrorCode, span: Span, message: impl Into<String>) -> BlockResult<T> {
    Err(Box::new(BlockError::new(code, span, message)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rendered_diagnostic_shows_number_place_line_mark_and_help() {
        let diagnostic = Diagnostic {
            code: ErrorCode::WordTwice,
            file: 0,
            line: 7,
            span: Span { start: 6, end: 8 },
            message: "X is given twice".to_owned(),
        };
        let shown = diagnostic.render("part.ngc", "G0 X1 X2");
        for wanted in ["error[E1407]: X is given twice", "part.ngc:7:7", "7 | G0 X1 X2", "^^", "help: Remove one."] {
            assert!(shown.contains(wanted), "{wanted} is not in\n{shown}");
        }
    }

    #[test]
    fn a_span_beyond_the_line_or_inside_a_character_does_not_panic() {
        let mut diagnostic = Diagnostic {
            code: ErrorCode::NotText,
            file: 0,
            line: 0,
            span: Span { start: 1, end: 900 },
            message: String::new(),
        };
        assert!(diagnostic.render("p", "ä").contains("E1002"));
        diagnostic.span = Span { start: 5, end: 2 };
        assert!(diagnostic.render("p", "").contains("E1002"));
    }
}
