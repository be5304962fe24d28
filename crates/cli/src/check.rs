//! `retrace check`: decodes, scans and plans a program; nothing moves.
//!
//! Invariant: it rejects what `retrace run` would reject before motion, with the same messages.

use retrace_config::{MachineConfig, NumberedError};
use retrace_gcode::{BranchDestination, Prescan};
use serde_json::json;

use crate::args;
use crate::check_report::CheckReport;
use crate::command_failure::CommandFailure;
use crate::files;
use crate::program::Program;
use crate::saved_materials;

/// Runs the command.
///
/// # Errors
/// The program or the files have errors.
pub fn run(args: &args::Check) -> Result<(), CommandFailure> {
    let machine = args.planning.apply_to(files::machine(args.machine_file.path())?);
    let program = Program::open(&args.reading, &machine)?;
    if args.table
        && let Some(prescan) = program.prescan()
    {
        print_table(prescan);
    }
    // Planned exactly as it runs.
    match machine.axes.len() {
        0..=4 => print_report::<4>(args, &machine, &program)?,
        _ => print_report::<9>(args, &machine, &program)?,
    }
    if args.save_materials {
        saved_materials::save(&program, &machine)?;
    }
    Ok(())
}

fn print_report<const A: usize>(
    args: &args::Check,
    machine: &MachineConfig,
    program: &Program,
) -> Result<(), CommandFailure> {
    let mut diagnostics = Vec::new();
    let checked = match program.analyse_at_once::<A>(machine, &mut diagnostics) {
        Some(checked) => Ok(Some(checked)),
        // A program that cannot run is not planned: moves beyond the travel may have any length.
        None => match program.check_silently_with_progress(machine) {
            Ok(threads) => program.analyse::<A>(machine, threads, &mut diagnostics),
            Err(_) => program.check_for_script(machine, &mut diagnostics).map(|_| None),
        },
    };
    if let (true, Err(CommandFailure::Program)) = (args.format.json, &checked) {
        crate::out::line(json!({ "event": "check", "program": program.name(), "diagnostics": diagnostics }));
    }
    let Some(checked) = checked? else {
        let what = format!("{} is a stream, which is checked only while it runs", program.name());
        return Err(NumberedError::new("E2142", what, "name a file, or use `retrace run`").into());
    };
    let report = CheckReport { program, machine, blocks: checked.blocks, analysis: &checked.found, diagnostics };
    if args.format.json {
        crate::out::line(report.json());
    } else {
        crate::out::line(report.text());
    }
    Ok(())
}

/// Prints the branch table: number, location, kind and target of each branch.
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
            BranchDestination::Line { file, line } => place(file, line),
            BranchDestination::Cycle => "compiled cycle".to_owned(),
            BranchDestination::Calculated => "known when the program runs".to_owned(),
            BranchDestination::Missing => "nothing".to_owned(),
        };
        say!("{:>6}  {from:<24} {what:<20} -> {to}", branch.number);
    }
    say!("{} branches", branches.len());
}
