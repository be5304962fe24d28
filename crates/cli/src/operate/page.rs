//! The page in a browser: starts its server beside the machine thread, and gives it what it needs of the command line.
//!
//! Invariant: the page sends its commands by the same router as the terminal screen.

use std::io::IsTerminal;
use std::path::PathBuf;
use std::sync::Arc;

use retrace_config::{MachineConfig, NumberedError};
use retrace_serve::{ProgramFolders, ServeHandle, ServeHost, ServeOptions, TlsFiles};
use retrace_tui::UiCommand;
use serde_json::Value;

use super::command_router::CommandRouter;
use crate::args;
use crate::jobs;

/// What the page's server asks of the machine.
struct PageHost {
    router: Arc<CommandRouter>,
    journal: Option<PathBuf>,
}

impl ServeHost for PageHost {
    fn send(&self, command: UiCommand) -> bool {
        self.router.route_command(command)
    }

    fn jobs(&self) -> Value {
        jobs::listed(self.journal.as_deref()).unwrap_or_else(|_| serde_json::json!({"jobs": []}))
    }

    fn job(&self, id: &str) -> Result<Value, NumberedError> {
        jobs::shown(self.journal.as_deref(), id)
    }
}

/// Starts the server of the page, and prints its address.
///
/// # Errors
/// `E2419` where it cannot listen; `E2420` where a folder of programs is missing; `E2427` and `E2428` where the
/// certificate cannot be used.
pub(super) fn start(
    args: &args::Run,
    machine: &MachineConfig,
    router: &Arc<CommandRouter>,
) -> Result<ServeHandle, NumberedError> {
    let page = &args.page;
    for folder in [&page.programs, &page.watch].into_iter().flatten() {
        if !folder.is_dir() {
            let what = format!("{}: there is no such folder", folder.display());
            return Err(NumberedError::new("E2420", what, "create it, or name another one"));
        }
    }
    let counts_per_s =
        f64::from(machine.wheel_counts) / (f64::from(machine.wheel_periods).max(1.0) * machine.period_s());
    let options = ServeOptions {
        listen: page.listen,
        name: page.name.clone(),
        tls: page.tls.as_deref().and_then(tls_files),
        folders: ProgramFolders { programs: page.programs.clone(), watched: page.watch.clone() },
        lost_control: machine.on_lost_control,
        seconds_per_count: 1.0 / counts_per_s,
        is_demo: page.demo,
    };
    let identity = page.session.identity(page.upload_key)?;
    let host = PageHost { router: Arc::clone(router), journal: args.jobs.journal.clone() };
    retrace_serve::start(options, Arc::clone(&router.model), Arc::new(host), &identity)
}

/// The two files of `--tls`.
fn tls_files(paths: &[PathBuf]) -> Option<TlsFiles> {
    let [certificate, key] = paths else { return None };
    Some(TlsFiles { certificate: certificate.clone(), key: key.clone() })
}

/// Prints how the page is opened. With the terminal screen it is shown among the messages.
pub(super) fn announce(args: &args::Run, page: &ServeHandle, has_terminal_screen: bool) -> Vec<String> {
    let mut lines = vec![format!("page: {}", page.address()), format!("for watching only: {}", page.watch_address())];
    if let Some(key) = page.upload_key() {
        lines.push(format!("key for uploads (X-Api-Key): {key}"));
    }
    if !args.page.listen.ip().is_loopback() && args.page.tls.is_none() {
        lines.push(format!(
            "warning: other computers reach this page at {}; without TLS its address can be read on the network",
            args.page.listen
        ));
    }
    if !has_terminal_screen && std::io::stdout().is_terminal() {
        let code = retrace_serve::qr_code(page.address());
        lines.extend(code.iter().flat_map(|code| code.lines()).map(str::to_owned));
    }
    lines
}
