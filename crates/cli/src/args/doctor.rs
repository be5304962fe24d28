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
    #[command(flatten)]
    pub format: JsonObject,
}
