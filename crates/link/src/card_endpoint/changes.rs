//! What a control period has changed, as entries of a report.
//!
//! Invariant: what is reported is remembered, so that every change is reported once.

use super::{CardEndpoint, EntryStorage, ReportedLatch};
use crate::wire::ReportEntry;
use crate::{CardStatus, HeightState, OutputChange, ProbeLatch, SpindleStatus};

impl<const A: usize, const E: usize, S: EntryStorage> CardEndpoint<A, E, S> {
    /// Adds entries for every difference from the state that the host knows.
    pub(super) fn push_changes(&mut self, status: &CardStatus<A>) {
        if status.alarm != self.reported.alarm {
            self.reported.alarm = status.alarm;
            self.push(ReportEntry::Alarm(status.alarm));
            self.urgent = true;
        }
        if status.outputs != self.reported.outputs {
            for (number, &value) in status.outputs.iter().enumerate() {
                if value != self.reported.outputs[number] {
                    self.push(ReportEntry::Output(OutputChange { channel: number as u8, value }));
                }
            }
            self.reported.outputs = status.outputs;
        }
        self.push_cutting_changes(status);
        self.push_probe_changes(status);
        self.push_spindle_changes(&status.spindle);
        if status.inputs != self.reported.inputs {
            self.reported.inputs = status.inputs;
            self.push(ReportEntry::Inputs(status.inputs));
        }
        self.push_analog_changes(status);
        if status.wheel != 0 {
            self.push(ReportEntry::Wheel(status.wheel));
        }
        if status.executed != self.reported.executed {
            self.reported.executed = status.executed;
            self.push(ReportEntry::Executed(status.executed));
            self.urgent = true;
        }
    }

    /// Adds an entry for each analog input whose reading has changed, once in an interval of the reports: noise does
    /// not fill the line, and at rest the host knows every reading after an interval.
    fn push_analog_changes(&mut self, status: &CardStatus<A>) {
        if !status.period.is_multiple_of(u64::from(self.report_periods)) {
            return;
        }
        for (number, reading) in status.analog_inputs.into_iter().enumerate() {
            if reading != self.reported.analog_inputs[number] {
                self.push(ReportEntry::AnalogInput { number: number as u8, reading });
            }
        }
        self.reported.analog_inputs = status.analog_inputs;
    }

    /// Adds entries for changes of the probe's latch.
    fn push_probe_changes(&mut self, status: &CardStatus<A>) {
        if let Some(edge) = status.probe_edge {
            self.push(ReportEntry::ProbeEdge(edge));
        }
        let latch = match status.probe {
            ProbeLatch::Idle => ReportedLatch::Idle,
            ProbeLatch::Armed => ReportedLatch::Armed,
            ProbeLatch::Edge(_) => ReportedLatch::Edge,
            ProbeLatch::Touched(_) => ReportedLatch::Touched,
        };
        if latch == self.reported.probe {
            return;
        }
        self.reported.probe = latch;
        match latch {
            // Only an epoch ends it, and that is what the host knows.
            ReportedLatch::Idle | ReportedLatch::Edge => {}
            ReportedLatch::Armed => self.push(ReportEntry::ProbeArmed),
            ReportedLatch::Touched => self.push(ReportEntry::ProbeTouched),
        }
        self.urgent = true;
    }

    /// Adds entries for changes of the gear, and of the speed by more than a part in 512 and half a turn per minute.
    fn push_spindle_changes(&mut self, now: &SpindleStatus) {
        let told = self.reported.spindle;
        if (now.gear, now.armed_again) != (told.gear, told.armed_again) {
            (self.reported.spindle.gear, self.reported.spindle.armed_again) = (now.gear, now.armed_again);
            let SpindleStatus { gear, largest_lag, armed_again, .. } = *now;
            self.push(ReportEntry::Gear { state: gear, largest_lag, armed_again });
            self.urgent = true;
        }
        let Some(speed) = now.speed else { return };
        let least = told.speed.map_or(0, |told| 500 + told.unsigned_abs() / 512);
        if told.speed.is_none_or(|told| told.abs_diff(speed) > least || told != 0 && speed == 0) {
            self.reported.spindle.speed = now.speed;
            self.push(ReportEntry::SpindleSpeed(speed));
        }
    }

    /// Adds entries for changes of the cutting outputs, of repeated instructions and of the block.
    fn push_cutting_changes(&mut self, status: &CardStatus<A>) {
        // Where it rests, since an instruction is complete only then; where the height is controlled, also once in an
        // interval of the reports.
        let rests = core::mem::replace(&mut self.reported.last_layer, status.layer) == status.layer;
        let is_due =
            status.height_state() != HeightState::Off && status.period.is_multiple_of(u64::from(self.report_periods));
        if (rests || is_due) && status.layer != self.reported.layer {
            self.reported.layer = status.layer;
            self.push(ReportEntry::Layer(status.layer));
        }
        if status.height != self.reported.height {
            self.reported.height = status.height;
            self.push(ReportEntry::Height(status.height_state()));
        }
        if let Some(off) = status.cutter_off {
            self.push(ReportEntry::CutterOff(off));
            self.urgent = true;
        }
        if status.repeated != self.reported.repeated {
            self.reported.repeated = status.repeated;
            self.push(ReportEntry::Repeated(status.repeated));
            self.urgent = true;
        }
        if status.blocked != self.reported.blocked {
            self.reported.blocked = status.blocked;
            self.push(ReportEntry::Blocked(status.blocked));
            self.urgent = true;
        }
    }
}
