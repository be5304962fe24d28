//! What the interpreter makes of a program, as text.

use retrace_gcode::{CanonText, Prescan, Program, Progress, Setup, Severity};
use std::sync::Arc;

/// The canonical text of a program, up to its first error, and whether it had one.
#[allow(dead_code)] // not every test has the plain setup
pub(crate) fn canon_text(program: &str) -> (String, bool) {
    canon_text_with(program, Setup::rs274())
}

/// The same with another setup.
pub(crate) fn canon_text_with(program: &str, setup: Setup) -> (String, bool) {
    let prescan = Prescan::of("program.ngc", program.into(), &setup);
    let mut program = Program::<&[u8]>::prescanned(Arc::new(prescan), setup);
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
    (String::from_utf8(text.into_inner().expect("memory")).expect("text"), failed)
}
