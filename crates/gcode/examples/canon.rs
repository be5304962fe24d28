//! Prints the canonical functions of a program as LinuxCNC's `rs274 -g` does: `cargo run --example canon -- part.ngc`.

use retrace_gcode::{CanonText, Program, Progress, Setup};
use std::fs::File;
use std::io::{BufReader, BufWriter, Write as _, stdout};
use std::process::ExitCode;

fn main() -> std::io::Result<ExitCode> {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("usage: canon PROGRAM");
        return Ok(ExitCode::from(2));
    };
    let mut program = Program::new(BufReader::new(File::open(&path)?), Setup::rs274());
    let mut text = CanonText::new(BufWriter::new(stdout().lock()));
    let mut steps = Vec::new();
    loop {
        let mut progress = program.advance(&mut steps);
        if progress == Progress::BlockError {
            progress = program.close(&mut steps);
        }
        for step in steps.drain(..) {
            text.write(&step)?;
        }
        if progress == Progress::End {
            break;
        }
    }
    text.into_inner()?.flush()?;
    let diagnostics = program.interpreter().diagnostics();
    for diagnostic in diagnostics {
        eprintln!("{}", diagnostic.render(&path, &program.line_text()));
    }
    let failed = diagnostics.iter().any(|found| found.severity() == retrace_gcode::Severity::Error);
    Ok(ExitCode::from(u8::from(failed)))
}
