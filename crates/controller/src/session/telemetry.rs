//! What the session tells whoever looks on.
//!
//! Invariant: nothing here allocates or formats; every event has the period and the place at which it happened.

use retrace_core::mode::Mode;
use retrace_link::{CardStatus, MotionCard, channel};

use super::Session;
use crate::event::{DifferingOutputs, Event, EventKind};
use crate::telemetry::{HoldReason, PeriodRecord, Telemetry};

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    pub(super) fn tell_period(&mut self, status: &CardStatus<A>) {
        self.teller.outputs(&status.outputs);
        let period = PeriodRecord {
            oldest: self.supply.oldest(),
            planned: self.supply.items_complete_until(),
            mode: self.operation.mode(),
            hold_reason: self.standing(),
            override_rate: self.overrides.asked(),
            rapid_override: self.operation.rapid_override(),
            ..PeriodRecord::of(status)
        };
        self.teller.send(Telemetry::Period(period));
    }

    /// Reports outputs that were switched because the path is retraced and outputs are replayed.
    pub(super) fn watch_replayed_outputs(&mut self, status: &CardStatus<A>) {
        let before = std::mem::replace(&mut self.outputs, status.outputs);
        if !self.replays || self.operation.mode() == Mode::Run || status.rate == 0 {
            return;
        }
        for at in (0..channel::COUNT).filter(|&at| before[at] != status.outputs[at]) {
            if !self.cutting.contains(&(at as u8)) {
                self.tell(EventKind::RetraceSwitched(at as u8, status.outputs[at]));
            }
        }
    }

    pub(super) fn standing(&self) -> HoldReason {
        if let Some(interrupted) = self.dnc.standing() {
            interrupted
        } else if self.waits_for_release() {
            HoldReason::Ended
        } else if self.operation.is_held() {
            HoldReason::Hold
        } else if self.program_stop {
            HoldReason::ProgramStop
        } else if self.single_stop {
            HoldReason::SingleBlock
        } else {
            HoldReason::None
        }
    }

    /// The outputs that differ from what the program expects, some at a time.
    pub(super) fn tell_differing(&mut self) {
        let want = *self.supply.expected();
        let are = self.outputs_compared_with(&want);
        let differs = (0..channel::COUNT).filter(|&at| are[at] != want[at]);
        let mut list = differs.map(|at| (at as u8, are[at], want[at])).peekable();
        while list.peek().is_some() {
            self.tell(EventKind::OutputsDiffer(DifferingOutputs::first(&mut list)));
        }
    }

    pub(super) fn tell_mode(&mut self) {
        let name = match self.operation.mode() {
            Mode::Run => "run",
            Mode::Reverse => "reverse",
            Mode::Forward => "forward",
            Mode::Wheel => "wheel",
            Mode::Rejoin => "rejoin",
            Mode::AwaitOutputs => "await_outputs",
        };
        self.tell(EventKind::Mode(name));
    }

    pub(super) fn tell(&mut self, happening: EventKind) {
        self.tell_at(self.card.status().line, happening);
    }

    pub(super) fn tell_at(&mut self, line: u32, happening: EventKind) {
        let status = self.card.status();
        let time_s = status.period as f64 * self.period_s;
        let event = Event { period: status.period, time_s, place: status.place, line, kind: happening };
        self.teller.send(Telemetry::Event(event));
    }
}
