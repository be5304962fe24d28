//! A cutter that starts in motion in its kerf, and is proven on the way (CUT-38).
//!
//! Invariant: without a proof it is on for at most `latch_mm` beyond the furthest place to which it may have cut.

use retrace_config::CutterRestart;
use retrace_core::mode::{Mode, ModeCommand};
use retrace_core::{Distance, Place};
use retrace_link::{CardStatus, LayerMove, MotionCard, ProofInput, SheetSource};

use super::Session;
use super::cut_end::{CutEnd, UNNOTICED_RECORDS};
use super::cut_mapping::measure_um;
use super::cutter_watch::is_unwatched;
use crate::cutter_off_reason::CutterOffReason;
use crate::event::EventKind;

/// A cutter that started in motion and is not proven yet (CUT-38).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Latch {
    input: u8,
    pub(super) cut_end: CutEnd,
    /// Length in mm beyond the end of the cut that is left to be proven in.
    remaining_mm: f64,
    struck: Option<StruckArc>,
    /// Control periods in a row after which the cutter is proven.
    proven_periods: u16,
    /// Control periods without the input that are a flicker, and no loss.
    lost_periods: u16,
}

/// An arc that was seen and is not proven yet. The card does not notice one that goes out again before it is.
#[derive(Clone, Copy, Debug, PartialEq)]
struct StruckArc {
    /// Where the input became active first.
    place: Place,
    /// Control periods with the input active in a row, and without it since it was active.
    active: u16,
    inactive: u16,
}

/// Time in µs for which an arc may burn before its input shows it, if it takes that long to be lost: at usual feeds it
/// cuts less than half the width of a kerf in it.
const MAX_LATE_US: u32 = 10_000;
/// Length in µm that counts as none, too: a contour ends with many short records, in which no arc is proven.
const UNNOTICED_UM: u64 = 50;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Makes the steps of the restart that light a cutter start it in motion: they take the time of the pilot arc, and
    /// do not wait for the input.
    pub(super) fn start_in_motion(&mut self, place: Place) {
        let (machine, interrupted) = (self.recovery.machine(), self.recovery.cut_end);
        let fires = &self.config.fire_channels;
        let recorded = self.recorded_layers.at(place.record);
        let mut latch = None;
        for step in &mut self.restart.steps {
            let lit = step.changes().iter().find(|change| change.value != 0 && fires.contains(&change.channel));
            let Some(channel) = lit.map(|change| change.channel) else { continue };
            let Some(cutter) = self.recovery.cutter(channel) else { continue };
            let Some(proof) = cutter.proof else { continue };
            let pilot_periods = (cutter.restart.pilot_ms * 1000.0 / f64::from(machine.period_us)).round() as u32;
            (step.periods, step.until) = (pilot_periods, None);
            if let Some(LayerMove::Start { pierce, cut, sheet, .. }) = &mut step.layer {
                // It meets the kerf at the height of the cut.
                *pierce = *cut;
                if let Some(layer) = recorded {
                    // Under the tool is its own kerf.
                    *sheet = SheetSource::Known(layer - *cut);
                }
            }
            let CutterRestart { run_in_mm, latch_mm, .. } = cutter.restart;
            // Where no end of a cut is known, the kerf is taken to end within the run-in.
            let (cut_end, remaining_mm) = match interrupted.filter(|end| end.channel == channel) {
                Some(cut_end) => (cut_end, latch_mm),
                None => (CutEnd { place, latest: place, channel, may_be_longer: false }, run_in_mm + latch_mm),
            };
            let ProofInput { proven_periods, lost_periods, .. } = proof.settings(machine.period_us);
            let input = proof.input;
            latch = Some(Latch { input, cut_end, remaining_mm, struck: None, proven_periods, lost_periods });
        }
        self.recovery.latch = latch.or(self.recovery.latch);
    }

    /// Checks that a cutter that started in motion is proven in time, and forgets the end of a cut that is passed.
    pub(super) fn watch_latch(&mut self, status: &CardStatus<A>) {
        // In a hold, the output may be on for the time of a report.
        let runs = self.mode_controller.mode() == Mode::Run && !self.mode_controller.is_held();
        let is_cutting = runs && status.rate.signum() > 0;
        if self.recovery.latch.is_some_and(|latch| self.streamer.expected()[usize::from(latch.cut_end.channel)] == 0) {
            self.end_latch_with_cut(status);
        }
        let Some(latch) = &mut self.recovery.latch else {
            let Some(end) = self.recovery.cut_end else { return };
            let is_lit = status.outputs.get(usize::from(end.channel)).is_some_and(|&value| value != 0);
            if is_cutting && is_lit && end.place.distance_to(status.place) > Distance::ZERO {
                self.end_interruption(end, status.place.moved(-status.rate.over(1)), 0);
            }
            return;
        };
        if status.inputs >> (latch.input & 15) & 1 == 1 {
            let place = latch.struck.map_or(status.place, |arc| arc.place);
            let active = latch.struck.map_or(0, |arc| arc.active) + 1;
            latch.struck = Some(StruckArc { place, active, inactive: 0 });
            if active >= latch.proven_periods {
                let (end, lost_periods) = (latch.cut_end, latch.lost_periods);
                let late_periods = lost_periods.min((MAX_LATE_US / self.recovery.machine().period_us) as u16);
                self.recovery.latch = None;
                self.end_interruption(end, place, late_periods);
            }
            return;
        }
        // A flicker is no loss, as in a cut that is proven.
        let inactive = latch.struck.map_or(0, |arc| arc.inactive) + 1;
        latch.struck = latch.struck.filter(|_| inactive < latch.lost_periods);
        latch.struck = latch.struck.map(|arc| StruckArc { active: 0, inactive, ..arc });
        if latch.cut_end.latest.distance_to(status.place) <= Distance::ZERO {
            return;
        }
        if is_unwatched(status) {
            let end = latch.cut_end;
            self.recovery.latch = None;
            self.end_interruption(end, end.latest, 0);
            return;
        }
        let axes = status.increments.iter().zip(&self.config.mm_per_pulse);
        latch.remaining_mm -= axes.map(|(&pulses, mm)| (f64::from(pulses) * mm).powi(2)).sum::<f64>().sqrt();
        if latch.remaining_mm < 0.0 {
            self.recovery.latch = None;
            self.look_further_next_time(status);
            self.switch_cutters_off(CutterOffReason::NotLatched);
            let _ = self.mode_controller.apply(ModeCommand::Hold);
        }
    }

    /// The program watches the cutter again. Where it is not proven the cut ends here, and it must be proven within the
    /// length of a start in motion (CUT-33).
    pub(super) fn latch_unproven(&mut self, status: &CardStatus<A>) {
        let is_lit = |channel: u8| status.outputs.get(usize::from(channel)).is_some_and(|&value| value != 0);
        let lit = self.config.fire_channels.iter().copied().find(|&channel| is_lit(channel));
        let cutter = lit.and_then(|channel| Some((channel, self.recovery.cutter(channel)?)));
        if let Some((channel, cutter)) = cutter
            && let Some(proof) = cutter.proof
            && self.recovery.latch.is_none()
            && self.mode_controller.mode() == Mode::Run
            && status.inputs >> (proof.input & 15) & 1 == 0
        {
            let cut_end = CutEnd { place: status.place, latest: status.place, channel, may_be_longer: false };
            let settings = proof.settings(self.recovery.machine().period_us);
            let ProofInput { proven_periods, lost_periods, .. } = settings;
            let (input, remaining_mm) = (proof.input, cutter.restart.latch_mm);
            self.set_cut_end([status.place; 2], channel);
            self.recovery.latch =
                Some(Latch { input, cut_end, remaining_mm, struck: None, proven_periods, lost_periods });
        }
    }

    /// The kerf may be longer than was thought: the next attempt looks for its end from here on.
    fn look_further_next_time(&mut self, status: &CardStatus<A>) {
        if let Some(end) = self.recovery.cut_end.as_mut().filter(|end| end.may_be_longer) {
            end.latest = status.place;
            self.emit_cut_end();
        }
    }

    /// The program has switched the cutter off, and it was not proven. Where it may have been cut to here before, that
    /// is the end of it; else the cut remains interrupted.
    fn end_latch_with_cut(&mut self, status: &CardStatus<A>) {
        let Some(Latch { cut_end, .. }) = self.recovery.latch.take() else { return };
        let (first, records) = (cut_end.latest.record, cut_end.latest.distance_to(status.place).units() >> 32);
        let left_um = || measure_um(&self.streamer, &self.config.mm_per_pulse, first, records.max(0) as u32);
        if records < UNNOTICED_RECORDS || left_um() < UNNOTICED_UM {
            self.recovery.cut_end = None;
            self.emit(EventKind::CutContinued);
            return;
        }
        self.look_further_next_time(status);
        self.emit(EventKind::CutterOff { channel: cut_end.channel, reason: CutterOffReason::NotLatched });
        // never rejected
        let _ = self.mode_controller.apply(ModeCommand::Hold);
    }
}
