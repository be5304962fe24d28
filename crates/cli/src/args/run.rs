//! Arguments of `retrace run`.

use std::path::PathBuf;

use clap::Args;

use super::reading::Reading;
use super::shared::{CardPort, JobsFolder, JsonLines, MachineFile, OnOff};

/// `retrace run`
#[derive(Clone, Debug, Args)]
pub struct Run {
    #[command(flatten)]
    pub reading: Reading,
    #[command(flatten)]
    pub port: CardPort,
    #[command(flatten)]
    pub machine_file: MachineFile,
    /// Run in wall time; without it the simulated card runs as fast as possible.
    #[arg(long)]
    pub realtime: bool,
    /// Full-screen operation, in wall time. Default with --realtime on a terminal.
    #[arg(long, conflicts_with = "no_tui")]
    pub tui: bool,
    /// No full-screen operation.
    #[arg(long)]
    pub no_tui: bool,
    /// Scripted operator.
    #[arg(long, value_name = "FILE")]
    pub operator: Option<PathBuf>,
    /// Whether M1 stops. By default it stops in wall time without --operator and without the screen; Enter is cycle
    /// start there.
    #[arg(long, value_enum, value_name = "on|off")]
    pub optional_stop: Option<OnOff>,
    /// Write what the card executed, one row per control period.
    #[arg(long, value_name = "FILE.csv")]
    pub records: Option<PathBuf>,
    /// With the simulated card: write a trace of pins, outputs and inputs for wave viewers.
    #[arg(long, value_name = "FILE.vcd")]
    pub vcd: Option<PathBuf>,
    /// Dry run: the axes move and every cutter stays off.
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub format: JsonLines,
    /// Start at this program line with the modal state in force there.
    #[arg(long, value_name = "N")]
    pub start_line: Option<u32>,
    #[command(flatten)]
    pub jobs: JobsFolder,
    /// Write no journal; the job cannot be resumed.
    #[arg(long, conflicts_with = "journal")]
    pub no_journal: bool,
}
