//! Runs a program and returns the result as text.

use retrace_gcode::{CanonText, Prescan, Program, Progress, Setup, Severity};
use std::sync::Arc;

/// Result of a program.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// Canonical functions up to the first error.
    pub(crate) text: String,
    /// File and line of the first error, if there was one.
    pub(crate) refused: Option<(u16, u32)>,
    /// Number of that error.
    pub(crate) error: Option<&'static str>,
}

/// Returns the canonical text of a program, up to its first error, and whether it had one.
#[allow(dead_code)] // not every test has the plain setup
pub(crate) fn canon_text(program: &str) -> (String, bool) {
    canon_text_with(program, Setup::rs274())
}

/// Returns the same with another setup.
#[allow(dead_code)] // as above
pub(crate) fn canon_text_with(program: &str, setup: Setup) -> (String, bool) {
    let outcome = carried_out(program, setup);
    (outcome.text, outcome.refused.is_some())
}

/// Executes a program up to its first error.
pub(crate) fn carried_out(program: &str, setup: Setup) -> Outcome {
    let prescan = Prescan::scan("program.ngc", program.into(), &setup);
    let mut program = Program::<&[u8]>::prescanned(Arc::new(prescan), setup);
    let mut text = CanonText::new(Vec::new());
    let mut steps = Vec::new();
    loop {
        let mut progress = program.advance(&mut steps);
        if progress == Progress::BlockError {
            progress = program.close(&mut steps);
        }
        for step in steps.drain(..) {
            text.write(&step).expect("writing to memory");
        }
        if progress == Progress::End {
            break;
        }
    }
    let failed = program.interpreter().diagnostics().iter().find(|found| found.severity() == Severity::Error);
    let text = String::from_utf8(text.into_inner().expect("memory")).expect("text");
    Outcome {
        text,
        refused: failed.map(|found| (found.file, found.line)),
        error: failed.map(retrace_gcode::Diagnostic::number),
    }
}
