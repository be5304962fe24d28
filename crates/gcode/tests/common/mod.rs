//! What the interpreter makes of a program, as text.

use retrace_gcode::{CanonText, Program, Progress, Setup, Severity};

/// The canonical text of a program, up to its first error, and whether it had one.
pub(crate) fn canon_text(program: &str) -> (String, bool) {
    canon_text_with(program, Setup::rs274())
}

/// The same with another setup.
pub(crate) fn canon_text_with(program: &str, setup: Setup) -> (String, bool) {
    let mut program = Program::new(program.as_bytes(), setup);
    let mut text = CanonText::new(Vec::new());
    let mut steps = Vec::new();
    loop {
        let mut progress = program.advance(&mut steps);
        if progress == Progress::Refused {
            progress = program.close(&mut steps);
        }
        for step in steps.drain(..) {
            text.write(&step).expect("writing to memory");
        }
        if progress == Progress::End {
            break;
        }
    }
    let failed = program.interpreter().diagnostics().iter().any(|found| found.severity() == Severity::Error);
    (String::from_utf8(text.into_inner()).expect("text"), failed)
}
