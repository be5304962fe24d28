//! Converts reported entries to control periods, one after the other.
//!
//! Invariant: increments and counts are those of the records between the places; a mismatch with the card's check is an
//! error.

use retrace_core::Distance;
use retrace_core::playback::emission;

use super::{HostEndpoint, LinkError};
use crate::wire::ReportEntry;
use crate::{CardStatus, HEIGHT_CONTROLS, ProbeLatch, SpindleStatus, state_crc};

impl<const A: usize, const CELLS: usize, const ENTRIES: usize, const COMMANDS: usize>
    HostEndpoint<A, CELLS, ENTRIES, COMMANDS>
{
    /// Advances to the next control period that the card reported: [`HostEndpoint::status`] is then the status at its
    /// end. Returns false if none is available yet.
    pub fn next_period(&mut self) -> bool {
        if self.waiting > 0 && core::mem::take(&mut self.period_emitted) {
            (self.status.wheel, self.status.cutter_off) = (0, None);
        }
        while self.waiting > 0 && self.fault.is_none() {
            let at = usize::from(self.first_waiting) % ENTRIES;
            let entry = self.entries[at];
            if let ReportEntry::Ran { distance, count, starved, at_rest } = entry {
                if count > 1 {
                    self.entries[at] = ReportEntry::Ran { distance, count: count - 1, starved, at_rest };
                } else {
                    self.drop_entry();
                }
                self.run_period(distance, starved, at_rest);
                self.period_emitted = true;
                return true;
            }
            self.drop_entry();
            self.apply_entry(entry);
        }
        false
    }

    fn drop_entry(&mut self) {
        self.first_waiting = self.first_waiting.wrapping_add(1);
        self.waiting -= 1;
    }

    fn apply_entry(&mut self, entry: ReportEntry) {
        match entry {
            ReportEntry::Output(change) => {
                if let Some(output) = self.status.outputs.get_mut(usize::from(change.channel)) {
                    *output = change.value;
                }
            }
            ReportEntry::Executed(number) => self.status.executed = number,
            ReportEntry::Alarm(alarm) => {
                self.alarm = alarm;
                self.status.alarm = alarm;
            }
            ReportEntry::Inputs(inputs) => self.status.inputs = inputs,
            ReportEntry::Wheel(counts) => self.status.wheel = self.status.wheel.saturating_add(counts),
            ReportEntry::CutterOff(off) => self.status.cutter_off = Some(off),
            ReportEntry::Repeated(number) => self.status.repeated = number,
            ReportEntry::Blocked(blocked) => self.status.blocked = blocked,
            ReportEntry::Layer(layer) => self.status.layer = layer,
            ReportEntry::Height(state) => self.status.height = [state; HEIGHT_CONTROLS],
            ReportEntry::ProbeArmed => self.status.probe = ProbeLatch::Armed,
            ReportEntry::ProbeEdge(edge) => {
                let CardStatus { counts, increments, .. } = &self.status;
                self.status.probe = ProbeLatch::Edge(edge.touch(counts, increments, &self.earlier));
            }
            ReportEntry::ProbeTouched => {
                if let ProbeLatch::Edge(touch) = self.status.probe {
                    self.status.probe = ProbeLatch::Touched(touch);
                }
            }
            ReportEntry::SpindleSpeed(speed) => self.status.spindle.speed = Some(speed),
            ReportEntry::AnalogInput { number, reading } => {
                if let Some(input) = self.status.analog_inputs.get_mut(usize::from(number)) {
                    *input = reading;
                }
            }
            ReportEntry::Gear { state, largest_lag, armed_again } => {
                let speed = self.status.spindle.speed;
                self.status.spindle = SpindleStatus { speed, gear: state, largest_lag, armed_again };
            }
            ReportEntry::Refused(number) | ReportEntry::RepeatRefused(number) => {
                // While an alarm is latched, that is what must be reported.
                if self.alarm.is_none() {
                    self.fault = Some(LinkError::Refused(number));
                }
            }
            ReportEntry::Ran { .. } => {}
        }
    }

    fn run_period(&mut self, distance: Distance, starved: bool, at_rest: bool) {
        let from = self.status.place;
        let to = from.moved(distance);
        let Some(increments) = emission(from, to, |place| self.predicted.record(place)) else {
            self.fault = Some(LinkError::StateMismatch);
            return;
        };
        let status = &mut self.status;
        status.period += 1;
        (status.place, status.rate, status.starved, status.at_rest) = (to, distance.per_period(), starved, at_rest);
        self.earlier = status.increments;
        // at most nine records a period
        status.increments = increments.map(|pulses| pulses as i32);
        for (count, increment) in status.counts.iter_mut().zip(increments) {
            *count += increment;
        }
        let under = if distance < Distance::ZERO { to.record } else { to.boundary_ahead() - 1 };
        if let Some(record) = self.predicted.record(under) {
            status.line = record.line;
        }
        if status.reached.is_before(to.boundary_ahead()) {
            status.reached = to.boundary_ahead();
        }
        if self.waiting == 0
            && let (Some(told), Some(settings)) = (self.reported_crc.take(), &self.settings)
            && !self.off_path
            && told != state_crc(status.place, &status.counts, settings.axes)
        {
            self.fault = Some(LinkError::StateMismatch);
        }
    }
}
