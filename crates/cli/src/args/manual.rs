//! Arguments of `retrace home`, `jog` and `mdi`.

use std::path::PathBuf;

use clap::Args;

use super::shared::{CardPort, JsonLines, MachineFile};

/// Options that `home`, `jog` and `mdi` share.
#[derive(Debug, Args)]
pub struct ManualOptions {
    #[command(flatten)]
    pub port: CardPort,
    #[command(flatten)]
    pub machine_file: MachineFile,
    #[command(flatten)]
    pub format: JsonLines,
}

/// `retrace home`
#[derive(Debug, Args)]
pub struct Home {
    /// Axis to home; by default all axes in the order of the machine file.
    pub axis: Option<char>,
    #[command(flatten)]
    pub manual: ManualOptions,
}

/// `retrace jog`
#[derive(Debug, Args)]
pub struct Jog {
    /// The axis.
    pub axis: char,
    /// Distance in mm (degrees), signed.
    #[arg(allow_negative_numbers = true)]
    pub mm: f64,
    #[command(flatten)]
    pub manual: ManualOptions,
}

/// `retrace mdi`
#[derive(Debug, Args)]
pub struct Mdi {
    /// The block.
    pub block: String,
    #[command(flatten)]
    pub options: MdiOptions,
}

/// Options that `mdi` and `probe` share.
#[derive(Debug, Args)]
pub struct MdiOptions {
    /// Tool table.
    #[arg(long, value_name = "FILE")]
    pub tools: Option<PathBuf>,
    /// Parameter file, read before the block and rewritten after it. With --machine or --card the default is the
    /// machine's own file in the user's state folder.
    #[arg(long, value_name = "FILE")]
    pub params: Option<PathBuf>,
    /// Check the block only; nothing moves.
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub manual: ManualOptions,
}
