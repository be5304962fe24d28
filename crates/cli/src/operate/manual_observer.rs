//! Observer of manual tasks at a screen.
//!
//! Invariant: a manual task never looks like a job.

use retrace_controller::{Event, EventKind, Observer, PeriodRecord, Telemetry};
use retrace_tui::ModelObserver;

/// Observer of manual tasks: to the controller an MDI block is a job of its own, to the screen it is none.
pub(super) struct ManualObserver(pub(super) ModelObserver);

impl<const A: usize> Observer<A> for ManualObserver {
    fn on_telemetry(&mut self, telemetry: &Telemetry<A>) {
        match telemetry {
            Telemetry::Event(Event { kind: EventKind::Started, .. }) => {}
            Telemetry::Period(period) => {
                self.0.on_telemetry(&Telemetry::Period(PeriodRecord { off_path: true, ..*period }))
            }
            telemetry => self.0.on_telemetry(telemetry),
        }
    }
}
