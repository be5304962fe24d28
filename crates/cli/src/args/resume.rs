//! Arguments of `retrace resume` and `retrace jobs`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::page::PageOptions;
use super::shared::{JobsFolder, JsonLines, JsonObject, OperationOptions, SimulatedWork};

/// `retrace resume`
#[derive(Clone, Debug, Args)]
#[command(
    mut_arg("tui", |tui| tui.conflicts_with("json")),
    mut_arg("optional_stop", |stop| stop.help(
        "Whether M1 stops. By default as when the job was interrupted; otherwise it stops in wall time without \
         --operator and without the screen, where Enter is cycle start",
    )),
)]
pub struct Resume {
    /// Name of the job or a unique prefix; by default the newest job that can be resumed.
    #[arg(value_name = "JOB")]
    pub job: Option<String>,
    #[command(flatten)]
    pub jobs: JobsFolder,
    /// The card, if it is at another port now: `sim` for a job of the simulated card, else a serial port.
    #[arg(long, value_name = "CARD")]
    pub card: Option<String>,
    /// Confirm the resume, including the outputs that it switches.
    #[arg(short, long)]
    pub yes: bool,
    /// Where the program is now, or is sent from again: a file, `-`, or `tcp://HOST:PORT`.
    #[arg(long, value_name = "PROGRAM")]
    pub program: Option<PathBuf>,
    /// Start a new job at this program line instead, from the current position, with the modal state in force there.
    #[arg(long, value_name = "N")]
    pub from_line: Option<u32>,
    /// The card was restarted and the machine has not moved: trust its counts where no home switch confirms them, and
    /// return from there to the last breakpoint in the journal.
    #[arg(long, conflicts_with = "from_line")]
    pub assume_position: bool,
    #[command(flatten)]
    pub work: SimulatedWork,
    #[command(flatten)]
    pub operation: OperationOptions,
    #[command(flatten)]
    pub page: PageOptions,
    #[command(flatten)]
    pub format: JsonLines,
    /// Rejected: a job resumes with the machine file that it started with.
    #[arg(long, value_name = "FILE.toml", hide = true)]
    pub machine: Option<PathBuf>,
}

impl Resume {
    /// Whether the job is operated at a screen.
    #[must_use]
    pub fn is_at_screen(&self) -> bool {
        self.operation.tui || self.page.serve
    }
}

/// `retrace jobs`
#[derive(Debug, Args)]
pub struct Jobs {
    /// Action; lists jobs by default.
    #[command(subcommand)]
    pub action: Option<JobsAction>,
    /// List every job, including those that never started; by default the newest 20.
    #[arg(long)]
    pub all: bool,
    #[command(flatten)]
    pub format: JsonObject,
    #[command(flatten)]
    pub jobs: JobsFolder,
}

/// Actions of `retrace jobs`.
#[derive(Debug, Subcommand)]
pub enum JobsAction {
    /// Print all details of a job: progress, last position, outputs.
    #[command(after_help = "Example:\n  retrace jobs show 20261122-004627-part --json")]
    Show {
        /// Name of the job or a unique prefix.
        id: String,
    },
}
