//! `retrace check`: decodes and scans a program; nothing moves.
//!
//! Invariant: it says exactly what `retrace run` would say before it moves.

use retrace_gcode::{Prescan, Target};

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
    if args.table
        && let Some(prescan) = program.prescan()
    {
        print_table(prescan);
    }
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

/// The branch table: number, where the branch stands, what it is, where it goes.
fn print_table(prescan: &Prescan) {
    let place = |file, line| format!("{}:{line}", prescan.file_name(file));
    let branches = prescan.branches();
    for branch in &branches {
        let from = place(branch.file, branch.line);
        let what = match &branch.label {
            Some(label) => format!("{} {label}", branch.kind),
            None => branch.kind.to_owned(),
        };
        let to = match branch.target {
            Target::Line { file, line } => place(file, line),
            Target::Cycle => "compiled cycle".to_owned(),
            Target::Calculated => "known when the program runs".to_owned(),
            Target::Missing => "nothing".to_owned(),
        };
        say!("{:>6}  {from:<24} {what:<20} -> {to}", branch.number);
    }
    say!("{} branches", branches.len());
}
