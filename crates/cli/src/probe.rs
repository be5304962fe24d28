//! `retrace probe`: a probing cycle from the shell, as the MDI block that calls it (PRB-20).
//!
//! Invariant: the same words do the same at the screen.

use retrace_config::NumberedError;
use retrace_gcode::probing_block;

use crate::args::Probe;
use crate::command_failure::CommandFailure;
use crate::manual;

/// Runs the command. Returns its exit code.
///
/// # Errors
/// `E2121` for words that call no cycle; otherwise whatever prevents the cycle.
pub fn run(args: &Probe) -> Result<u8, CommandFailure> {
    let block = probing_block(&args.words.join(" "))
        .map_err(|why| NumberedError::new("E2121", why, "`retrace probe --help` lists the cycles"))?;
    manual::mdi(&block, &args.options)
}
