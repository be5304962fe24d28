//! Selects from the telemetry what goes into the journal: every event, and positions at sufficient intervals.
//!
//! Invariant: a position is recorded once per second of machine time, or every half a second while a cutter burns, a
//! tenth of a second after the machine has come to rest, with every change of the mode, of the hold reason and of the
//! completed instructions, and at the end. Positions off the path are never recorded.

use retrace_config::{ChannelNames, NumberedError};
use retrace_core::{Distance, Place, RecordIndex};
use retrace_journal::{
    HoldReason, JournalEntry, JournalEventWriter, JournalNotice, JournalWriter, PositionEntry, Timestamp,
};
use retrace_link::{Outputs, channel};

use crate::event::{CardError, EventKind};
use crate::telemetry::{PeriodRecord, Telemetry};

/// The reporting thread's end of the journal. The last position is saved when it is dropped, which is before
/// [`JournalWriter::end`].
#[derive(Debug)]
pub struct JournalRecorder<const A: usize> {
    journal: JournalEventWriter,
    axes: usize,
    sampler: PositionSampler<A>,
    outputs: Outputs,
    names: ChannelNames,
    cut: UnsavedCuts,
}

impl<const A: usize> JournalRecorder<A> {
    /// Creates a recorder for a machine with this number of axes and this control period in microseconds.
    #[must_use]
    pub fn new(journal: &JournalWriter, axes: usize, period_us: u32) -> Self {
        let periods = |ms: u64| (ms * 1000).div_ceil(u64::from(period_us.max(1)));
        let sampler = PositionSampler {
            second: periods(1000),
            cutting: periods(500),
            tenth: periods(100),
            recorded: None,
            last: None,
            rest: None,
        };
        Self {
            journal: journal.event_writer(),
            axes: axes.min(A),
            sampler,
            outputs: [0; channel::COUNT],
            names: ChannelNames::default(),
            cut: UnsavedCuts::default(),
        }
    }

    /// Sets the names of outputs in events.
    #[must_use]
    pub fn with_names(mut self, names: ChannelNames) -> Self {
        self.names = names;
        self
    }

    /// Records a telemetry message.
    pub fn record(&mut self, message: &Telemetry<A>) {
        match message {
            Telemetry::Period(period) => {
                if let Some(begin) = period.cut_from {
                    self.cut.record(begin, period.place);
                }
                if let Some(period) = self.sampler.sample(period) {
                    self.record_position(&period);
                }
            }
            Telemetry::Output(change) => {
                if let Some(output) = self.outputs.get_mut(usize::from(change.channel)) {
                    *output = change.value;
                }
            }
            Telemetry::Active(_) => {}
            // The journal has what was cut.
            Telemetry::Event(event) if matches!(event.kind, EventKind::ContoursRestored(_)) => {}
            Telemetry::Event(event) => self.journal.write(JournalEntry::Event(event.to_json_naming(&self.names))),
        }
    }

    /// Records the last position, if it is not recorded yet: before the operator is waited for, and at the end.
    pub fn record_last_position(&mut self) {
        if let Some(period) = self.sampler.take_unrecorded() {
            self.record_position(&period);
        }
    }

    /// Next notice to the operator about the journal itself: `E3020` where it cannot be written.
    #[must_use]
    pub fn next_notice(&self) -> Option<EventKind> {
        self.journal.next_notice().map(|notice| match notice {
            JournalNotice::Unwritable(NumberedError { number, cause, remedy }) => {
                EventKind::Alarm(CardError::Fault { number, cause, remedy })
            }
            JournalNotice::Writable => EventKind::Message("the journal can be written again".into()),
        })
    }

    fn record_position(&mut self, period: &PeriodRecord<A>) {
        let outputs = self.outputs.iter().enumerate().filter(|(_, value)| **value != 0);
        let at = PositionEntry {
            when: Timestamp::now(),
            period: period.period,
            place: period.place,
            reached: period.reached,
            executed: period.executed,
            at_rest: period.at_rest,
            counts: period.counts[..self.axes].to_vec(),
            layer: period.layer,
            outputs: outputs.map(|(number, &value)| (number as u8, value)).collect(),
            line: period.line,
            mode: period.mode,
            hold_reason: stored_hold_reason(period.hold_reason),
            cut: self.cut.take(),
        };
        self.journal.write(JournalEntry::Position(Box::new(at)));
    }
}

impl<const A: usize> Drop for JournalRecorder<A> {
    fn drop(&mut self) {
        self.record_last_position();
    }
}

/// Reason of a hold as the journal stores it. Where a program has ended, nothing is pending that resuming would need.
fn stored_hold_reason(reason: HoldReason) -> HoldReason {
    if reason == HoldReason::Ended { HoldReason::None } else { reason }
}

/// What was cut since the last position was saved.
#[derive(Debug, Default)]
struct UnsavedCuts {
    /// Stretches that are complete.
    complete: Vec<[RecordIndex; 2]>,
    /// The last stretch in which the cutter burnt without a break, up to a place.
    last: Option<[Place; 2]>,
    /// Whether the last stretch goes on behind what was saved of it.
    is_unsaved: bool,
}

impl UnsavedCuts {
    /// Records that the cutter burnt from `begin` on without a break up to a place.
    fn record(&mut self, begin: Place, to: Place) {
        let end = match self.last.filter(|[from, _]| *from == begin) {
            Some([_, end]) if to.distance_to(end) > Distance::ZERO => end,
            Some(_) => to,
            None => {
                self.complete.extend(self.last_records().filter(|_| self.is_unsaved));
                to
            }
        };
        self.last = Some([begin, end]);
        self.is_unsaved = true;
    }

    /// The whole records of the last stretch.
    fn last_records(&self) -> Option<[RecordIndex; 2]> {
        let range = self.last.map(|[begin, end]| [begin.boundary_ahead(), end.record]);
        range.filter(|[begin, end]| begin.is_before(*end))
    }

    /// What was cut since the last call; the last stretch comes again, longer, if it goes on.
    fn take(&mut self) -> Vec<[RecordIndex; 2]> {
        let mut cut = std::mem::take(&mut self.complete);
        cut.extend(self.last_records().filter(|_| std::mem::take(&mut self.is_unsaved)));
        cut
    }
}

/// Selects the periods to record.
#[derive(Debug)]
struct PositionSampler<const A: usize> {
    /// Number of periods in a second, and in a tenth of one.
    second: u64,
    tenth: u64,
    /// Number of periods between positions while a cutter burns: at most a second of the cut is unknown once the
    /// position is durable (CUT-46), so that half of it is left for the way to the disk.
    cutting: u64,
    /// The period that was recorded last.
    recorded: Option<PeriodRecord<A>>,
    /// The last period.
    last: Option<PeriodRecord<A>>,
    /// Number of the period in which the machine came to rest, unless that is recorded.
    rest: Option<u64>,
}

impl<const A: usize> PositionSampler<A> {
    /// Takes a period. Returns a period that is to be recorded, if any.
    fn sample(&mut self, period: &PeriodRecord<A>) -> Option<PeriodRecord<A>> {
        if period.off_path {
            // The last place on the path is where the job continues.
            return self.take_unrecorded();
        }
        let came_to_rest = period.at_rest && self.last.is_none_or(|last| !last.at_rest);
        if came_to_rest {
            self.rest = Some(period.period);
        } else if !period.at_rest {
            self.rest = None;
        }
        self.last = Some(*period);
        let since = |then: u64| period.period.saturating_sub(then);
        let longest = if period.cut_from.is_some() { self.cutting } else { self.second };
        let is_due = self.recorded.is_none_or(|kept| {
            let state = |of: &PeriodRecord<A>| (of.mode, of.hold_reason, of.executed);
            let has_returned = period.reached.is_before(kept.reached);
            has_returned || state(&kept) != state(period) || since(kept.period) >= longest
        });
        if !is_due && self.rest.is_none_or(|rest| since(rest) < self.tenth) {
            return None;
        }
        self.recorded = Some(*period);
        if period.at_rest && self.rest.is_some_and(|rest| since(rest) >= self.tenth) {
            self.rest = None;
        }
        Some(*period)
    }

    /// The last period, if it was not recorded.
    fn take_unrecorded(&mut self) -> Option<PeriodRecord<A>> {
        let period = self.last.take_if(|last| self.recorded.is_none_or(|kept| kept.period != last.period))?;
        self.recorded = Some(period);
        Some(period)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use retrace_core::Rate;

    fn often() -> PositionSampler<1> {
        PositionSampler { second: 1000, cutting: 500, tenth: 100, recorded: None, last: None, rest: None }
    }

    fn period(number: u64) -> PeriodRecord<1> {
        PeriodRecord {
            period: number,
            place: Place::start_of(RecordIndex::new(number as u32)),
            reached: RecordIndex::new(number as u32),
            oldest: RecordIndex::new(0),
            planned: RecordIndex::new(number as u32 + 500),
            window: [RecordIndex::new(0), RecordIndex::new(0)],
            rate: Rate::ONE,
            line: 1,
            increments: [1],
            counts: [number as i64],
            layer: 0,
            executed: 0,
            at_rest: false,
            starved: false,
            inputs: 0,
            mode: retrace_core::mode::Mode::Run,
            hold_reason: HoldReason::None,
            override_rate: Rate::ONE,
            rapid_override: Rate::ONE,
            speed_override: Rate::ONE,
            override_is_off: false,
            off_path: false,
            contour: 0,
            cut_um: 0,
            cut_from: None,
            spindle: retrace_link::SpindleStatus::default(),
            height: retrace_link::HeightState::Off,
            analog_inputs: retrace_link::AnalogInputs::default(),
            is_probing: false,
        }
    }

    /// Numbers of the recorded periods.
    fn kept(periods: impl IntoIterator<Item = PeriodRecord<1>>) -> Vec<u64> {
        let mut often = often();
        let mut kept: Vec<u64> = periods.into_iter().filter_map(|p| often.sample(&p)).map(|p| p.period).collect();
        kept.extend(often.take_unrecorded().map(|p| p.period));
        assert!(often.take_unrecorded().is_none());
        kept
    }

    #[test]
    fn once_a_second_and_at_the_end() {
        assert_eq!(kept((1..=2500).map(period)), [1, 1001, 2001, 2500]);
        assert_eq!(kept((1..=1001).map(period)), [1, 1001], "the last one is not kept twice");
    }

    #[test]
    fn more_often_while_a_cutter_burns() {
        let burns = |n: u64| (400..2200).contains(&n).then(|| Place::start_of(RecordIndex::new(400)));
        let periods = (1..=3500).map(|n| PeriodRecord { cut_from: burns(n), ..period(n) });
        assert_eq!(kept(periods), [1, 501, 1001, 1501, 2001, 3001, 3500]);
    }

    #[test]
    fn a_tenth_after_coming_to_rest_and_not_at_every_stop() {
        let stands = |n: u64| (300..320).contains(&n) || n >= 500;
        let periods = (1..=900).map(|n| PeriodRecord { at_rest: stands(n), ..period(n) });
        assert_eq!(kept(periods), [1, 600, 900]);
    }

    #[test]
    fn with_every_change_of_what_is_going_on() {
        let periods = (1..=60).map(|n| PeriodRecord {
            mode: if n >= 10 { retrace_core::mode::Mode::Reverse } else { retrace_core::mode::Mode::Run },
            hold_reason: if n >= 20 { HoldReason::Hold } else { HoldReason::None },
            executed: u32::from(n >= 30),
            ..period(n)
        });
        assert_eq!(kept(periods), [1, 10, 20, 30, 60]);
    }

    #[test]
    fn what_was_cut_is_saved_once_and_again_where_it_goes_on() {
        let at = |eighths: u32| Place { record: RecordIndex::new(eighths / 8), fraction: (eighths % 8) << 29 };
        let mut cuts = UnsavedCuts::default();
        let taken = |cuts: &mut UnsavedCuts| -> Vec<_> {
            cuts.take().into_iter().map(|range| range.map(RecordIndex::number)).collect()
        };
        cuts.record(at(20), at(36));
        assert_eq!(taken(&mut cuts), [[3, 4]], "whole records");
        assert!(taken(&mut cuts).is_empty());
        cuts.record(at(20), at(80));
        cuts.record(at(20), at(60));
        cuts.record(at(100), at(103));
        cuts.record(at(160), at(240));
        assert_eq!(taken(&mut cuts), [[3, 10], [20, 30]]);
        cuts.record(at(240), at(241));
        assert!(taken(&mut cuts).is_empty(), "no whole record, and the rest was saved");
    }

    #[test]
    fn what_is_off_the_path_is_no_position_on_it() {
        let periods = (1..=3000).map(|n| PeriodRecord { off_path: n >= 10, ..period(n) });
        assert_eq!(kept(periods), [1, 9]);
    }
}
