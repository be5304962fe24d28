//! Arguments of the page: `retrace serve`, and `--serve` of `retrace run`.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;

use crate::page_session::PageSession;

/// Address of the page where none is given: only browsers on this computer reach it.
const DEFAULT_ADDRESS: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 8181);

/// Options of the page in a browser.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Page in a browser")]
pub struct PageOptions {
    /// Serve the page in a browser as well, in wall time.
    #[arg(long)]
    pub serve: bool,
    /// Address to listen at. Other computers reach the page where it is not the loopback address.
    #[arg(long, value_name = "ADDRESS:PORT", default_value_t = DEFAULT_ADDRESS)]
    pub listen: SocketAddr,
    /// Folder in which the page stores programs, and from which it opens them.
    #[arg(long, value_name = "DIR")]
    pub programs: Option<PathBuf>,
    /// Folder into which a CAM program writes; the page lists its programs too.
    #[arg(long, value_name = "DIR")]
    pub watch: Option<PathBuf>,
    /// Serve over TLS, with a certificate and its private key as PEM files.
    #[arg(long, value_names = ["CERT", "KEY"], num_args = 2)]
    pub tls: Option<Vec<PathBuf>>,
    /// Name by which browsers may address the page, besides localhost and addresses.
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Print a key with which CAM programs and slicers can upload programs, in the form of OctoPrint.
    #[arg(long)]
    pub upload_key: bool,
    /// Simulated plasma table with a program whose arc is lost, to try everything.
    #[arg(long, hide = true)]
    pub demo: bool,
    /// What stays the same while cards are closed and opened again.
    #[arg(skip)]
    pub session: Arc<PageSession>,
}
