//! What the session sends to the observers.
//!
//! Invariant: nothing here allocates or formats; every event has the period and the place at which it happened.

use retrace_core::mode::Mode;
use retrace_core::{Place, Rate};
use retrace_journal::HoldReason;
use retrace_link::{CardStatus, MotionCard, OutputChange, channel};

use super::{ProgramStop, Session};
use crate::differing_outputs::{DifferingOutput, DifferingOutputs};
use crate::event::{Event, EventKind};
use crate::record_streamer::{LeadIn, PassedItem};
use crate::telemetry::{PeriodRecord, Telemetry};

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    pub(super) fn emit_period(&mut self, status: &CardStatus<A>) {
        self.apply_speed_share();
        self.watch_speed_override(status);
        self.telemetry.send_output_changes(&self.outputs_as_set(&status.outputs));
        let contour = self.cut_map.current();
        let period = PeriodRecord {
            contour: contour.map_or(0, |contour| contour.number),
            cut_um: contour.map_or(0, |contour| u32::try_from(contour.cut_um()).unwrap_or(u32::MAX)),
            cut_from: self.cut_map.burns_from(),
            oldest: self.streamer.oldest(),
            planned: self.streamer.items_complete_until(),
            mode: self.mode_controller.mode(),
            hold_reason: self.hold_reason(),
            override_rate: self.overrides.requested(),
            rapid_override: self.mode_controller.rapid_override(),
            speed_override: self.asked_speed_override(),
            override_is_off: !self.override_applies(),
            off_path: self.is_on_lead_in(),
            line: self.line_at_cursor(status),
            is_probing: self.retraces_probing(status),
            ..PeriodRecord::from_status(status)
        };
        self.telemetry.send(Telemetry::Period(period));
    }

    /// Reports outputs that were switched because the path is retraced and outputs are replayed.
    pub(super) fn watch_replayed_outputs(&mut self, status: &CardStatus<A>) {
        if self.outputs == status.outputs {
            return;
        }
        let before = std::mem::replace(&mut self.outputs, status.outputs);
        let unwatched = usize::from(channel::UNWATCHED);
        if before[unwatched] != status.outputs[unwatched] {
            let is_watched = status.outputs[unwatched] == 0;
            self.emit(EventKind::LossWatch { is_watched });
            if is_watched {
                self.latch_unproven(status);
            }
        }
        if !self.config.replays_outputs || self.mode_controller.mode() == Mode::Run || status.rate == Rate::ZERO {
            return;
        }
        for at in (0..channel::COUNT).filter(|&at| before[at] != status.outputs[at]) {
            if !self.config.fire_channels.contains(&(at as u8)) && !is_of_cut(at as u8) {
                self.emit(EventKind::RetraceSwitched(at as u8, status.outputs[at]));
            }
        }
    }

    /// Reports an action that was passed. What belongs to a cut has an event or a figure of its own, and a height is no
    /// output.
    pub(super) fn emit_action(&mut self, line: u32, number: u8, value: i32) {
        if number != channel::HEIGHT && !is_of_cut(number) {
            self.emit_at(line, EventKind::OutputChanged(number, value));
        }
    }

    pub(super) fn hold_reason(&self) -> HoldReason {
        if let Some(interrupted) = self.dnc.hold_reason() {
            interrupted
        } else if self.waits_for_release() {
            HoldReason::Ended
        } else if self.mode_controller.is_held() {
            HoldReason::Hold
        } else if self.program_stop != ProgramStop::No {
            HoldReason::ProgramStop
        } else if self.single_stop {
            HoldReason::SingleBlock
        } else {
            HoldReason::None
        }
    }

    /// Reports the outputs that differ from what the program expects, several per event.
    pub(super) fn emit_differing_outputs(&mut self) {
        let want = self.wanted_outputs();
        let are = self.outputs_compared_with(&want);
        let differs = (0..channel::COUNT).filter(|&at| are[at] != want[at]);
        let entry = |at: usize| {
            let (code, line) = self.streamer.origin_of(at as u8, want[at]);
            DifferingOutput { channel: at as u8, actual: are[at], expected: want[at], code, line }
        };
        let (mut all, mut count) = ([DifferingOutput::default(); channel::COUNT], 0);
        for at in differs {
            all[count] = entry(at);
            count += 1;
        }
        let mut list = all[..count].iter().copied().peekable();
        while list.peek().is_some() {
            self.emit(EventKind::OutputsDiffer(DifferingOutputs::first(&mut list)));
        }
    }

    pub(super) fn emit_mode(&mut self) {
        self.emit(EventKind::Mode(self.mode_controller.mode()));
    }

    pub(super) fn emit(&mut self, kind: EventKind) {
        self.emit_at(self.line_at_cursor(self.card.status()), kind);
    }

    /// Program line at the cursor: that of the record that was executed last. A card that has begun a path anew reports
    /// none until it has executed a record of it; on a lead-in, the line is that of the place where it joins the path.
    pub(super) fn line_at_cursor(&self, status: &CardStatus<A>) -> u32 {
        if status.line != 0 {
            return status.line;
        }
        let join = self.streamer.lead_in().filter(|_| self.is_on_lead_in()).map(LeadIn::join);
        let last = match join {
            Some(join) => join - 1,
            None if status.place.fraction == 0 => status.place.record - 1,
            None => status.place.record,
        };
        self.streamer.record(last).map_or(0, |record| record.line)
    }

    /// Reports what the cursor has passed for the first time.
    pub(super) fn report_passed_items(&mut self) {
        while let Some(news) = self.streamer.next_passed_item() {
            match news {
                PassedItem::Action(action, line) => {
                    self.stats.switch_events += 1;
                    self.map_switching(
                        action.place,
                        line,
                        &[OutputChange { channel: action.channel, value: action.after }],
                    );
                    self.emit_action(line, action.channel, action.after);
                }
                PassedItem::Message(line, text) => self.emit_at(line, EventKind::Message(text)),
                PassedItem::Active(active) => {
                    self.cut_map.record_compensation(active.compensation);
                    self.note_speed_modes(&active);
                    self.telemetry.send(Telemetry::Active(active));
                }
            }
        }
    }

    pub(super) fn emit_at(&mut self, line: u32, kind: EventKind) {
        self.emit_at_place(line, self.card.status().place, kind);
    }

    /// Reports an event of another place than the card's, which is off the path.
    pub(super) fn emit_at_place(&mut self, line: u32, place: Place, kind: EventKind) {
        let status = self.card.status();
        let time_s = status.period as f64 * self.config.period_s;
        let event = Event { period: status.period, time_s, place, line, kind };
        self.telemetry.send(Telemetry::Event(event));
    }
}

/// Whether the channel is no output that anything is wired to, but a part of how the card cuts.
const fn is_of_cut(number: u8) -> bool {
    matches!(number, channel::UNWATCHED | channel::HEIGHT_HOLD | channel::HEIGHT_OFFSET)
}
