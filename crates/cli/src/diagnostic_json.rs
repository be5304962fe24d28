//! Diagnostics of a program, for a person and for a script.
//!
//! Invariant: both forms have the same message and location; the order is that of the lines.

use retrace_controller::{CheckFinding, more_rounds_text};
use retrace_gcode::{Diagnostic, Severity};
use serde_json::{Value, json};

use crate::decoder::Decoder;
use crate::escape;
use crate::program::Program;

/// Error or warning in both forms.
#[derive(Clone, Debug)]
pub struct DiagnosticPrinter {
    /// File, where 0 is the program itself, and line.
    place: (u16, u32),
    /// Whether it prevents the program from running.
    pub is_error: bool,
    /// Text with source line and mark, for a person.
    pub text: String,
    /// JSON with file and range, for an editor.
    pub json: Value,
}

/// All diagnostics of a checked program, each once for a number and a place, with the number of its repetitions.
pub fn all(program: &Program, decoder: &mut Decoder, findings: &[CheckFinding]) -> Vec<DiagnosticPrinter> {
    if decoder.is_at_end {
        decoder.program.check_after_end();
    }
    let diagnostics = decoder.program.interpreter().diagnostics();
    let with_rounds = diagnostics.iter().enumerate().map(|(index, one)| {
        let rounds = more_rounds_text(decoder.program.interpreter().more_rounds(index));
        Diagnostic { message: format!("{}{rounds}", one.message), ..one.clone() }
    });
    let mut all: Vec<DiagnosticPrinter> = with_rounds.map(|one| of_diagnostic(program, &one)).collect();
    all.extend(findings.iter().map(|finding| of_finding(program, finding)));
    all.sort_by_key(|one| one.place);
    all
}

fn of_diagnostic(program: &Program, diagnostic: &Diagnostic) -> DiagnosticPrinter {
    let (name, line) = match program.prescan() {
        Some(prescan) => (prescan.file_name(diagnostic.file), prescan.line_text(diagnostic.file, diagnostic.line)),
        None => (program.name(), Vec::new()),
    };
    let source = String::from_utf8_lossy(&line);
    let column = |byte: u32| {
        let end = line.len().min(byte as usize);
        String::from_utf8_lossy(&line[..end]).chars().count() + 1
    };
    let is_error = diagnostic.severity() == Severity::Error;
    let columns = (column(diagnostic.span.start), column(diagnostic.span.end));
    DiagnosticPrinter {
        place: (diagnostic.file, diagnostic.line),
        is_error,
        text: diagnostic.render(&escape::name(name), &source),
        json: as_json(
            name,
            (diagnostic.line, columns),
            is_error,
            [diagnostic.number(), &diagnostic.message, diagnostic.help()],
        ),
    }
}

/// A finding with its source line, in the form of the diagnostics.
fn of_finding(program: &Program, finding: &CheckFinding) -> DiagnosticPrinter {
    let CheckFinding { line, word, number, cause, remedy, more_rounds } = finding;
    let what = &format!("{cause}{}", more_rounds_text(*more_rounds));
    let gutter = " ".repeat(line.to_string().len());
    let source = program.prescan().map_or_else(Vec::new, |prescan| prescan.line_text(0, *line));
    let source = String::from_utf8_lossy(&source);
    let column = word.and_then(|letter| column_of(&source, letter)).unwrap_or(1);
    let mark = " ".repeat(column - 1);
    let level = if finding.is_error() { "error" } else { "warning" };
    let text = format!(
        "{level}[{number}]: {what}\n{gutter}--> {}:{line}:{column}\n{gutter} |\n{line} | {source}\n{gutter} | \
            {mark}^\n{gutter} |\n\
         {gutter} = help: {remedy}",
        escape::name(program.name())
    );
    let range = (*line, (column, column + 1));
    let json = as_json(program.name(), range, finding.is_error(), [*number, what, remedy]);
    DiagnosticPrinter { place: (0, *line), is_error: finding.is_error(), text, json }
}

/// Formats as JSON. Lines and columns count from 1, columns in characters; the end is exclusive.
fn as_json(
    file: &str,
    (line, (start, end)): (u32, (usize, usize)),
    is_error: bool,
    [code, message, help]: [&str; 3],
) -> Value {
    json!({
        "file": file,
        "range": {
            "start": { "line": line, "column": start },
            "end": { "line": line, "column": end.max(start) },
        },
        "severity": if is_error { "error" } else { "warning" },
        "number": code,
        "cause": message,
        "remedy": help,
    })
}

/// Column, from 1, of the first word with that letter outside comments.
fn column_of(line: &str, letter: char) -> Option<usize> {
    let mut is_comment = false;
    for (at, c) in line.chars().enumerate() {
        match c {
            '(' => is_comment = true,
            ')' => is_comment = false,
            ';' if !is_comment => return None,
            _ if !is_comment && c.eq_ignore_ascii_case(&letter) => return Some(at + 1),
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_is_found_outside_of_comments() {
        assert_eq!(column_of("N10 (x) G0 X5", 'X'), Some(12));
        assert_eq!(column_of("g1 x5", 'X'), Some(4));
        assert_eq!(column_of("G1 ; X5", 'X'), None);
    }
}
