//! Arguments of `retrace consumables`.

use clap::Args;

use super::shared::{CardPort, JsonObject, MachineFile};

/// `retrace consumables`
#[derive(Debug, Args)]
pub struct Consumables {
    #[command(flatten)]
    pub machine_file: MachineFile,
    #[command(flatten)]
    pub port: CardPort,
    /// They are new: count from 0 again, those of one cutter or of all.
    #[arg(long, value_name = "CUTTER")]
    pub changed: Option<Option<String>>,
    #[command(flatten)]
    pub format: JsonObject,
}
