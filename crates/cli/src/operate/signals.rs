//! Signals that end the operator's presence: the terminal was closed, or the command is to terminate.
//!
//! Invariant: a signal only sets a flag here; threads act on it.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether a signal has arrived.
#[derive(Debug)]
pub(super) struct Signals(Arc<AtomicBool>);

impl Signals {
    /// Registers the signals, for the rest of the process.
    ///
    /// # Errors
    /// The system rejects the registration.
    pub(super) fn listen() -> io::Result<Self> {
        let came = Arc::new(AtomicBool::new(false));
        #[cfg(unix)]
        for signal in [signal_hook::consts::SIGHUP, signal_hook::consts::SIGTERM, signal_hook::consts::SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&came))?;
        }
        Ok(Self(came))
    }

    /// Whether a signal has arrived.
    pub(super) fn have_arrived(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
