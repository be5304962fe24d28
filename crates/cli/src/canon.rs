//! `retrace canon`: prints the canonical functions of a program, one per line, as LinuxCNC's `rs274 -g` does.
//!
//! Invariant: the output depends only on the program and the files on the command line.

use retrace_gcode::{CanonText, Setup, Severity};

use crate::args;
use crate::command_failure::CommandFailure;
use crate::files::unwritable;
use crate::program::Program;

/// Runs the command.
///
/// # Errors
/// The program or the files have errors.
pub fn run(args: &args::Canon) -> Result<(), CommandFailure> {
    let program = Program::with_setup(&args.reading, Setup::rs274())?;
    let mut steps = Vec::new();
    let mut source = program.source();
    let mut out = CanonText::new(std::io::stdout().lock());
    let mut is_refused = false;
    loop {
        steps.clear();
        let progress = source.advance(&mut steps);
        for step in &steps {
            match out.write(step) {
                Ok(()) => {}
                // the reader of the list has seen enough
                Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => return Ok(()),
                Err(error) => return Err(unwritable("standard output", &error).into()),
            }
        }
        if !source.interpreter().diagnostics().is_empty() {
            for diagnostic in source.interpreter_mut().take_diagnostics() {
                is_refused |= diagnostic.severity() == Severity::Error;
                eprintln!("{}", source.render(&diagnostic, program.name()));
            }
        }
        if is_refused || progress == retrace_gcode::Progress::End {
            break;
        }
    }
    let flushed = out.flush();
    if let Err(error) = flushed
        && error.kind() != std::io::ErrorKind::BrokenPipe
    {
        return Err(unwritable("standard output", &error).into());
    }
    if is_refused { Err(CommandFailure::Program) } else { Ok(()) }
}
