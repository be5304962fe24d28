//! `retrace card serve` on systems without pseudo-terminals.

use retrace_controller::numbered_error::NumberedError;

use crate::args;

/// Refuses the command.
///
/// # Errors
/// Always: a simulated card is served behind a pseudo-terminal.
pub fn run(_: &args::Serve) -> Result<(), NumberedError> {
    let what = "there are no pseudo-terminals on this system to serve a card behind";
    Err(NumberedError::new("E2149", what, "`--card sim` runs the simulated card in the process"))
}
