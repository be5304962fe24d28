//! Arguments of `retrace probe`.

use clap::Args;
use retrace_gcode::PROBING_FORMS;

use super::manual::MdiOptions;

/// `retrace probe`
#[derive(Debug, Args)]
pub struct Probe {
    /// The cycle, its lengths in mm, and G54 … G59.3 where the result is to become that zero.
    #[arg(required = true, value_name = "WORDS", allow_negative_numbers = true)]
    pub words: Vec<String>,
    #[command(flatten)]
    pub options: MdiOptions,
}

/// The cycles, for the end of the help.
pub(super) fn help() -> String {
    let widest = PROBING_FORMS.iter().map(|call| call.form.len()).max().unwrap_or(0);
    let rows: String =
        PROBING_FORMS.iter().map(|call| format!("  {:widest$}  {}\n", call.form, call.purpose)).collect();
    format!(
        "Cycles:\n{rows}\nTRAVEL is the maximum distance to the surface, OUT the distance from the start, over the \
         work,\nto a place beside it, DEPTH the distance below the start. See docs/probing.md.\n\nExamples:\n  \
         retrace probe surface z- 20 g54 --card /dev/ttyUSB0 --machine mill.toml\n  retrace probe outside-corner \
         x+ y+ 15 5 g54"
    )
}
