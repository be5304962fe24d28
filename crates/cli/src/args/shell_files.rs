//! Arguments of the hidden subcommands `completions` and `man`.
//!
//! Invariant: nothing here runs anything.

use std::path::PathBuf;

use clap::Subcommand;
use clap_complete::Shell;

/// The hidden subcommands for packages.
#[derive(Debug, Subcommand)]
pub enum ShellFiles {
    /// Print a completion script for a shell.
    #[command(hide = true, after_help = "Example:\n  retrace completions bash > retrace.bash")]
    Completions {
        /// The shell that reads the script.
        shell: Shell,
    },
    /// Write the manual pages.
    #[command(hide = true, after_help = "Example:\n  retrace man target/man")]
    Man {
        /// Folder to write the pages into; it is created where it is missing.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}
