//! `retrace check`: decodes and scans a program; nothing moves.
//!
//! Invariant: it says exactly what `retrace run` would say before it moves.

use crate::args;
use crate::files;
use crate::program::{Failure, Program};

/// Runs the command.
///
/// # Errors
/// What is wrong with the program or the files.
pub fn run(args: &args::Check) -> Result<(), Failure> {
    let machine = files::machine(args.machine.as_deref())?;
    let program = Program::open(&args.reading, &machine)?;
    let Some(checked) = program.check(&machine)? else {
        let refusal = retrace_controller::refusal::Refusal::new(
            "E2142",
            "standard input is checked as it runs",
            "give a file, or `retrace run -`",
        );
        return Err(refusal.into());
    };
    say!("{}: no errors, {} blocks, {} moves", program.name(), checked.blocks, checked.scan.moves);
    if let Some(extents) = checked.scan.extents_mm {
        for (axis, [least, greatest]) in machine.axes.iter().zip(extents) {
            let [low, high] = axis.travel_mm;
            let name = axis.name.to_ascii_uppercase();
            say!("  {name} {least:.3} … {greatest:.3} mm, within the soft limits {low} … {high} mm");
        }
    }
    Ok(())
}
