//! Arguments of `retrace doctor`.

use clap::Args;

use super::shared::{JsonObject, MachineFile};

/// `retrace doctor`
#[derive(Debug, Args)]
pub struct Doctor {
    /// Port of the card, `PATH[@BAUD]`; without a port only this computer is measured.
    pub port: Option<String>,
    #[command(flatten)]
    pub machine_file: MachineFile,
    /// Duration of the wake-up measurement in s.
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub seconds: f64,
    /// Turn this axis and compare the frequency at a wire from its step output to the frequency input of the card with
    /// what was ordered. The axis MOVES: uncouple its motor, or unplug its drive.
    #[arg(long, value_name = "AXIS", requires = "port")]
    pub step_test: Option<char>,
    /// Move it without asking.
    #[arg(long, requires = "step_test")]
    pub yes: bool,
    #[command(flatten)]
    pub format: JsonObject,
}
