//! What the server is given: its settings, and the machine behind the screen model.
//!
//! Invariant: the server knows the machine by this trait only.

use std::net::SocketAddr;

use retrace_config::{NumberedError, OnLostControl};
use retrace_tui::UiCommand;
use serde_json::Value;

use crate::programs::ProgramFolders;
use crate::tls::TlsFiles;

/// Settings of a server.
#[derive(Clone, Debug)]
pub struct ServeOptions {
    /// Address to listen at.
    pub listen: SocketAddr,
    /// Name by which the server may be addressed, besides `localhost` and addresses.
    pub name: Option<String>,
    /// Certificate and key, where the page is served over TLS.
    pub tls: Option<TlsFiles>,
    /// Folders of programs.
    pub folders: ProgramFolders,
    /// What happens to a running program when the page in control loses its link.
    pub lost_control: OnLostControl,
    /// Time of recorded motion for a count of the handwheel, s.
    pub seconds_per_count: f64,
    /// Whether this is a demonstration.
    pub is_demo: bool,
}

/// What the server needs of the machine besides its screen model.
pub trait ServeHost: Send + Sync {
    /// Passes on a command of the operator. Returns whether it was: not while another task is being performed.
    fn send(&self, command: UiCommand) -> bool;
    /// The jobs, as `retrace jobs --json` prints them.
    fn jobs(&self) -> Value;
    /// A job, as `retrace jobs show ID --json` prints it.
    ///
    /// # Errors
    /// Why it cannot be shown.
    fn job(&self, id: &str) -> Result<Value, NumberedError>;
}
