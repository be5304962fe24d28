//! State of a job that runs without a screen, as it is reported on the local socket.
//!
//! Invariant: it has the number of lines, and neither the text of the program nor its path, so that a program of any
//! size costs nothing here.

use std::sync::{Arc, Mutex};

use retrace_config::MachineConfig;
use retrace_controller::{Observer, Telemetry};
use retrace_tui::{ModelObserver, ProgramFacts, ScreenModel, Text, lock_model};

use crate::files;
use crate::state_socket::StateSocket;

/// State that is reported until it is dropped.
pub struct ReportedState {
    model: Arc<Mutex<ScreenModel>>,
    observer: ModelObserver,
    _socket: StateSocket,
}

impl ReportedState {
    /// State of a job with a program of this name and number of lines. None where it cannot be reported.
    pub fn of(machine: &MachineConfig, program: &str, lines: Option<u64>) -> Option<Self> {
        let model = Arc::new(Mutex::new(ScreenModel::new(Arc::new(facts(machine, program, lines)))));
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

/// Facts of a program of which name and number of lines are enough; 0 lines where it is not known. Where no planned
/// path is known, the executed one is recorded, to be drawn: nobody draws here, so the planned one is empty.
fn facts(machine: &MachineConfig, program: &str, lines: Option<u64>) -> ProgramFacts {
    let name = files::last_name(program);
    let unread = Text::unread(&name, lines.and_then(|lines| lines.try_into().ok()).unwrap_or_default());
    let planned_path = Some(Arc::default());
    ProgramFacts { planned_path, program: unread, ..ProgramFacts::of(machine, &name, "") }
}

#[cfg(test)]
mod tests {
    use retrace_controller::{Event, EventKind, PeriodRecord};
    use retrace_core::{Place, RecordIndex};
    use retrace_link::{CardStatus, PathStart};

    use super::*;

    #[test]
    fn the_path_of_a_job_is_not_kept() {
        let machine = MachineConfig::parse("", "test").expect("valid");
        let model = Arc::new(Mutex::new(ScreenModel::new(Arc::new(facts(&machine, "jobs/part.ngc", Some(7))))));
        let program = lock_model(&model).facts.program.clone();
        assert_eq!((program.name.as_str(), program.lines(), program.line(1)), ("part.ngc", 7, None));
        let mut observer = ModelObserver::new(Arc::clone(&model));
        let started = Event { period: 0, time_s: 0.0, place: Place::default(), line: 0, kind: EventKind::Started };
        Observer::<3>::on_telemetry(&mut observer, &Telemetry::Event(started));
        let mut period = PeriodRecord::<3>::from_status(&CardStatus::at_rest(PathStart::default()));
        for number in 1..20_000_u32 {
            period.period = u64::from(number);
            period.place = Place::start_of(RecordIndex::new(number));
            period.counts[0] = i64::from(number % 500);
            observer.on_telemetry(&Telemetry::Period(period));
        }
        assert!(lock_model(&model).machine_mm(0) > 0.0, "it follows the machine");
        assert!(lock_model(&model).executed_path.is_none());
    }
}
