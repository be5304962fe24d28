//! Arguments of `retrace send`.

use std::path::PathBuf;

use clap::Args;

/// `retrace send`
#[derive(Debug, Args)]
pub struct Send {
    /// Program.
    pub program: PathBuf,
    /// Port with its settings, as `serial:PATH?baud=4800&format=7e2`; the others are those of `[serial]`.
    #[arg(long = "to", value_name = "PORT")]
    pub port: String,
    /// Machine file with `[serial]`.
    #[arg(long, value_name = "FILE.toml")]
    pub machine: Option<PathBuf>,
    /// Send at once, without waiting until the control asks by DC1.
    #[arg(long)]
    pub now: bool,
}
