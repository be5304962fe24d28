//! The end of an interrupted cut: where a cutter went out, up to where it had cut, and from where it cuts again.
//!
//! Invariant: the end of a cut is never beyond what was cut; what lies between it and the continuation is reported.

use retrace_core::mode::Mode;
use retrace_core::{Distance, Place, RecordIndex};
use retrace_link::{CutterOff, MotionCard};

use super::Session;
use super::cut_mapping::measure_um;
use super::restart::LeavingRun;
use crate::event::EventKind;
use crate::resume::ResumedCutEnd;

/// Where a cut was interrupted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CutEnd {
    /// Place up to which it was cut.
    pub(super) place: Place,
    /// The furthest place to which it may have been cut: where the cutter was switched off because its input was
    /// inactive, and where a job is resumed whose journal ends before.
    pub(super) latest: Place,
    pub(super) channel: u8,
    /// Whether the kerf may be longer still: the place comes from a journal, which may lack the last second.
    pub(super) may_be_longer: bool,
}

/// Records between the end of a cut and its continuation that count as none: the places are those of whole control
/// periods, and the input of an arc that strikes is debounced.
pub(super) const UNNOTICED_RECORDS: i64 = 3;
/// Maximum number of records that are measured in one control period.
const MAX_MEASURED_RECORDS: i64 = 20_000;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Records where a cut ended, if a cutter went out in it.
    pub(super) fn record_cut_end(&mut self, off: CutterOff) {
        let lost = off.cause.ends_cut();
        // On a lead-in nothing of the path is cut.
        if !self.is_executing() || self.is_on_lead_in() {
            return;
        }
        let channel = self.cutters_of(off.channels).next();
        // Nothing is cut yet where its own instruction is still being executed.
        let Some(channel) = channel.filter(|&channel| self.streamer.expected()[usize::from(channel)] != 0) else {
            return;
        };
        let is_interrupted = lost || self.recovery.usually_starts_in_motion(channel);
        // A cutter that did not start again, or was not proven yet, has cut nothing since.
        let has_cut = self.recovery.latch.take().is_none() && (lost || !off.cause.cancels_start());
        if !is_interrupted || !has_cut {
            return;
        }
        // A cutter whose input was inactive for too long may have burnt until it was switched off.
        let status = self.card.status();
        self.set_cut_end([off.place, status.place.moved(-status.rate.over(1))], channel);
        let is_done = self.is_lost_at_end(channel, off.place) || self.is_lost_over_kerf(off.place);
        self.contour_pass.skips_at_rest = lost && is_done;
    }

    /// Whether the program is executed: also on the way to rest before reverse run.
    fn is_executing(&self) -> bool {
        self.mode_controller.mode() == Mode::Run || self.leaving_run != LeavingRun::No
    }

    /// The cut of this cutter is interrupted: it ends at the first place, and at the other at the latest.
    pub(super) fn set_cut_end(&mut self, [place, latest]: [Place; 2], channel: u8) {
        self.stats.cut_interruptions += 1;
        self.recovery.cut_end = Some(CutEnd { place, latest, channel, may_be_longer: false });
        self.emit_cut_end();
    }

    /// The cut of this cutter ends at `place`, and is to be continued there.
    pub(super) fn begin_rest_of_cut(&mut self, place: Place, channel: u8) {
        self.recovery.cut_end = Some(CutEnd { place, latest: place, channel, may_be_longer: false });
        self.emit_cut_end();
    }

    /// Records where a cut ended because the operator switches this cutter off.
    pub(super) fn record_cut_end_by_hand(&mut self, channel: u8) {
        let status = self.card.status();
        let is_on = status.outputs.get(usize::from(channel)).is_some_and(|&value| value != 0);
        // Started in motion and not proven: it has cut nothing since.
        if self.recovery.latch.take().is_some() {
            return;
        }
        if self.is_on_lead_in() {
            return;
        }
        // A cutter that pierces at rest continues where it was put out at rest.
        let goes_back = !status.at_rest || self.recovery.usually_starts_in_motion(channel);
        if is_on && self.is_executing() && goes_back {
            // The card switches it off later, so that this place is cut.
            self.set_cut_end([status.place; 2], channel);
        }
    }

    /// Whether a cut was interrupted where the machine stands in normal run, or behind. It is continued by *recover*:
    /// here no arc strikes over its own kerf.
    pub(super) fn is_cut_to_be_recovered(&self) -> bool {
        let end = self.recovery.cut_end();
        self.mode_controller.mode() == Mode::Run
            && end.is_some_and(|end| end.distance_to(self.card.status().place) >= Distance::ZERO)
    }

    /// A job is resumed inside a cut, or behind one that was interrupted: it is continued from where it certainly
    /// ended. The pierce is complete at the furthest place, so that the cut is not shorter than its beginning.
    pub(super) fn restore_cut_end(&mut self, ends: &[ResumedCutEnd], reached: RecordIndex) {
        let expected = self.streamer.expected();
        let is_lit = |end: &&ResumedCutEnd| expected.get(usize::from(end.channel)).is_some_and(|&value| value != 0);
        let lit = ends.iter().find(is_lit);
        let cut = lit.or_else(|| ends.iter().find(|end| end.is_interruption));
        let Some(&ResumedCutEnd { channel, place, latest: passed, is_interruption, is_exact }) = cut else { return };
        let reached = Place::start_of(reached);
        let pierce = self.streamer.pierce_before(if is_interruption { place } else { reached });
        let later = |a: Place, b: Place| if a.distance_to(b) > Distance::ZERO { b } else { a };
        let place = pierce.map_or(place, |pierce| later(place, Place::start_of(pierce + 1)));
        // Where the machine had gone back to continue it, it ends beyond the furthest place.
        let latest = if is_exact || lit.is_none() { place } else { later(place, reached) };
        let latest = later(latest, Place::start_of(passed));
        self.recovery.cut_end = Some(CutEnd { place, latest, channel, may_be_longer: true });
        if let Some(pierce) = pierce {
            let line = self.streamer.record(pierce).map_or(0, |record| record.line);
            self.cut_map.begin_contour(pierce, line, channel);
        }
        self.emit_cut_end();
    }

    /// Reports the end of the interrupted cut, which the journal keeps.
    pub(super) fn emit_cut_end(&mut self) {
        let Some(CutEnd { place, latest, channel, may_be_longer }) = self.recovery.cut_end else { return };
        let line = self.streamer.record(place.record).map_or(self.card.status().line, |record| record.line);
        self.emit(EventKind::CutEnd { channel, place, line, may_be_longer, latest: latest.record });
    }

    /// The cut that ended at `end` is continued at `at`: counts what lies in between, as far as that is known. An input
    /// that is inactive for `late_periods` tells nothing.
    ///
    /// An arc strikes as soon as it meets metal. So where it strikes up to the place at which the lost one was switched
    /// off, that one has burnt to there.
    pub(super) fn end_interruption(&mut self, end: CutEnd, at: Place, late_periods: u16) {
        self.recovery.cut_end = None;
        self.emit(EventKind::CutContinued);
        let unnoticed = UNNOTICED_RECORDS + i64::from(late_periods);
        let is_cut_to_here = end.latest.distance_to(at).units() >> 32 < unnoticed;
        if is_cut_to_here {
            if !end.may_be_longer && end.place.distance_to(at) > Distance::ZERO {
                let length_um = self.length_um_between(end.place, at);
                self.cut_map.record_burnt(end.place, at, length_um);
            }
            return;
        }
        let from = if end.may_be_longer { end.latest } else { end.place };
        self.emit(EventKind::NotCut(self.length_um_between(from, at) as f64 / 1000.0));
    }

    /// Length in µm of the records from this place to that, as far as they are retained.
    fn length_um_between(&self, from: Place, to: Place) -> u64 {
        let records = (from.distance_to(to).units() >> 32).clamp(0, MAX_MEASURED_RECORDS) as u32;
        measure_um(&self.streamer, &self.config.mm_per_pulse, from.record, records)
    }
}
