//! State of a job that runs without a screen, as it is reported on the local socket.
//!
//! Invariant: it has no program text, so that a program of any size costs nothing here.

use std::sync::{Arc, Mutex};

use retrace_config::MachineConfig;
use retrace_controller::{Observer, Telemetry};
use retrace_tui::{ModelObserver, ProgramFacts, ScreenModel, lock_model};

use crate::files;
use crate::state_socket::StateSocket;

/// State that is reported until it is dropped.
pub struct ReportedState {
    model: Arc<Mutex<ScreenModel>>,
    observer: ModelObserver,
    _socket: StateSocket,
}

impl ReportedState {
    /// State of a job with a program of this name. None where it cannot be reported.
    pub fn of(machine: &MachineConfig, program: &str) -> Option<Self> {
        let facts = ProgramFacts::of(machine, &files::last_name(program), "");
        let model = Arc::new(Mutex::new(ScreenModel::new(Arc::new(facts))));
        let socket = StateSocket::serve(&model)?;
        Some(Self { observer: ModelObserver::new(Arc::clone(&model)), model, _socket: socket })
    }

    /// Takes what happens in the job.
    pub fn observe<const A: usize>(&mut self, telemetry: &Telemetry<A>) {
        self.observer.on_telemetry(telemetry);
    }

    /// Reports the end of the job, in words, as the last state.
    pub fn end(self, how: &str) {
        lock_model(&self.model).end(how);
    }
}
