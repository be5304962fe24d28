//! Arguments of `retrace run`.

use std::path::PathBuf;

use clap::Args;
use retrace_controller::StartPoint;

use super::page::PageOptions;
use super::reading::Reading;
use super::shared::{
    CardPort, JobsFolder, JsonLines, MachineFile, OperationOptions, Planning, SimulatedSource, SimulatedWork,
};

/// `retrace run`
#[derive(Clone, Debug, Args)]
#[command(
    mut_arg("tui", |tui| tui.help("Full-screen operation, in wall time. Default with --realtime on a terminal")),
    mut_arg("optional_stop", |stop| stop.help(
        "Whether M1 stops. By default it stops in wall time without --operator and without the screen; Enter is cycle \
         start there",
    )),
)]
pub struct Run {
    #[command(flatten)]
    pub reading: Reading,
    #[command(flatten)]
    pub port: CardPort,
    #[command(flatten)]
    pub machine_file: MachineFile,
    #[command(flatten)]
    pub operation: OperationOptions,
    /// No full-screen operation.
    // in the help between --tui and --operator: it has the order of the latter, and comes first by its name
    #[arg(long, conflicts_with = "tui", display_order = 12)]
    pub no_tui: bool,
    /// With the simulated card: write a trace of pins, outputs and inputs for wave viewers.
    #[arg(long, value_name = "FILE.vcd")]
    pub vcd: Option<PathBuf>,
    #[command(flatten)]
    pub source: SimulatedSource,
    #[command(flatten)]
    pub work: SimulatedWork,
    #[command(flatten)]
    pub planning: Planning,
    /// Dry run: the axes move and every cutter stays off.
    #[arg(long)]
    pub dry_run: bool,
    /// Write the materials that the program declares with `(o=1, …)` and `(o=2, …)` into the material table of the
    /// machine, when the program has completed. Comments in the table stay.
    #[arg(long, conflicts_with = "tui")]
    pub save_materials: bool,
    #[command(flatten)]
    pub format: JsonLines,
    /// Start at this program line with the modal state in force there.
    #[arg(long, value_name = "N")]
    pub start_line: Option<u32>,
    /// Start at this contour, by its number in `retrace check`: its cutter is lit where it begins.
    #[arg(long, value_name = "N", conflicts_with = "start_line", value_parser = clap::value_parser!(u32).range(1..))]
    pub contour: Option<u32>,
    #[command(flatten)]
    pub jobs: JobsFolder,
    #[cfg(feature = "shop")]
    #[command(flatten)]
    pub shop: super::shop::ShopJobOptions,
    #[command(flatten)]
    pub page: PageOptions,
    /// Write no journal; the job cannot be resumed.
    #[arg(long, conflicts_with = "journal")]
    pub no_journal: bool,
}

impl Run {
    /// Whether a run of this program is a piece of a job of the shop.
    pub fn is_piece(&self, program: &str) -> bool {
        #[cfg(feature = "shop")]
        return self.shop.recorder.as_ref().is_some_and(|recorder| recorder.is_of(program));
        #[cfg(not(feature = "shop"))]
        {
            let _ = program;
            false
        }
    }

    /// Where in the program the job begins, if not at its first block.
    pub fn start_point(&self) -> Option<StartPoint> {
        self.start_line.map(StartPoint::Line).or(self.contour.map(StartPoint::Contour))
    }
}
