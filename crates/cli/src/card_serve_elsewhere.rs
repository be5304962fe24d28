//! `retrace card serve` on systems without pseudo-terminals.

use retrace_config::NumberedError;

use crate::args;

/// Rejects the command.
///
/// # Errors
/// Always: a simulated card is served on a pseudo-terminal.
pub fn run(_: &args::Serve) -> Result<(), NumberedError> {
    let what = "this system has no pseudo-terminals to serve a card on";
    Err(NumberedError::new("E2149", what, "`--card sim` runs the simulated card in the process"))
}
