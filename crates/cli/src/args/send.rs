//! Arguments of `retrace send`.

use std::path::PathBuf;

use clap::Args;

/// `retrace send`
#[derive(Debug, Args)]
pub struct Send {
    /// Program.
    #[cfg_attr(feature = "shop", arg(required_unless_present = "job"))]
    #[cfg_attr(not(feature = "shop"), arg(required = true))]
    pub program: Option<PathBuf>,
    /// Send the next piece of a job of the shop, by its name or a unique prefix. The operator says if it is good.
    #[cfg(feature = "shop")]
    #[arg(long, value_name = "ID", conflicts_with = "program")]
    pub job: Option<String>,
    /// Shop file of the old machine.
    #[cfg(feature = "shop")]
    #[arg(long, value_name = "FILE.toml", requires = "job")]
    pub shop_file: Option<PathBuf>,
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
