//! Arguments of `retrace cycles`, and the folders of cycles that every reader of a program takes.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// `retrace cycles`
#[derive(Debug, Args)]
pub struct Cycles {
    /// Action; `list` by default.
    #[command(subcommand)]
    pub action: Option<CyclesAction>,
    #[command(flatten)]
    pub folders: CycleFolders,
}

/// Actions of `retrace cycles`.
#[derive(Debug, Subcommand)]
pub enum CyclesAction {
    /// List them: name, kind, origin, up to date or compiled now, parameters.
    #[command(after_help = "Example:\n  retrace cycles list --cycles my-cycles")]
    List,
    /// Print every error of every source; writes nothing.
    #[command(after_help = "Example:\n  retrace cycles check --cycles my-cycles")]
    Check,
    /// Compile the cycles that are not up to date, and keep the compiled forms.
    #[command(after_help = "Example:\n  retrace cycles compile --cycles my-cycles --compiled my-cache")]
    Compile,
    /// Print the source of a cycle.
    #[command(after_help = "Example:\n  retrace cycles show HOLES2")]
    Show {
        /// Name of the cycle.
        name: String,
    },
}

/// The two folders of cycles.
#[derive(Clone, Debug, Default, Args)]
pub struct CycleFolders {
    /// Folder with sources of cycles, `*.SPF`; by default `retrace/cycles` in the user's configuration folder.
    #[arg(long, value_name = "DIR", global = true)]
    pub cycles: Option<PathBuf>,
    /// Folder for their compiled forms; by default `retrace/cycles` in the user's cache folder.
    #[arg(long, value_name = "DIR", global = true)]
    pub compiled: Option<PathBuf>,
}
