//! The session's part of the cut map: what each control period cut, and where the program begins and ends a contour
//! (CUT-26 … CUT-28).
//!
//! Invariant: only what is executed for the first time, or again by a recovery, is mapped: no retracing, no lead-in, no
//! dry run.

use std::sync::Arc;
use std::sync::atomic::AtomicU32;

use retrace_core::{Distance, Place, Record, RecordIndex};
use retrace_link::{CardStatus, MotionCard, OutputChange, Outputs};

use super::Session;
use super::cut_map::{Burning, Contour, CutMap, CutMotion};
use super::cutter_watch::is_unwatched;
use super::session_config::SessionConfig;
use crate::event::EventKind;
use crate::kerf_map::KerfReplay;
use crate::operator::CommandError;
use crate::record_streamer::RecordStreamer;
use crate::resume::{PlanReplay, ResumeError, ResumePlan, ResumePoint};

const CUT_ALREADY: CommandError = CommandError::NotNow(
    "the contour is cut from here to its end, and over a kerf no arc strikes: `recover` goes on behind it; `cut` once \
     more cuts it all the same",
);
const BEYOND_THE_CUT: CommandError = CommandError::NotNow(
    "the cut ends before this place, and what is between would not be cut: `recover` goes back; `cut` once more leaves \
     it",
);

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Maps what was cut in a control period. Where the input of a cutter that burns is inactive for less than it
    /// takes to be lost, the motion is cut as well, once it is active again (CUT-31).
    pub(super) fn map_period(&mut self, status: &CardStatus<A>) {
        // Also on the way to rest before reverse run, while the cutter is still on.
        let is_forward = status.rate.signum() > 0;
        let before = self.cut_map.take_burning();
        self.recorded_layers.record(status.place.record, None, status.layer);
        self.watch_kerfs(status);
        if !is_forward || self.config.inhibits_outputs || self.is_on_lead_in() {
            return;
        }
        let is_lit = |&channel: &u8| {
            let is_on = |outputs: &Outputs| outputs.get(usize::from(channel)).is_some_and(|&value| value != 0);
            is_on(&self.outputs) && is_on(&status.outputs)
        };
        let burns = |&channel: &u8| self.is_proven(channel, status);
        let axes = status.increments.iter().zip(&self.config.mm_per_pulse);
        let length_mm = axes.map(|(&pulses, mm)| (f64::from(pulses) * mm).powi(2)).sum::<f64>().sqrt();
        let moved = CutMotion { from: status.place.moved(-status.rate.over(1)), length_mm };
        let fires = &self.config.fire_channels;
        if fires.iter().any(|channel| is_lit(channel) && burns(channel)) {
            let cut = if let Burning::Flickers(since) = before { since.followed_by(moved) } else { moved };
            let is_new = self.cut_map.record_cut(cut.from, status.place, cut.length_mm);
            self.recorded_layers.record(status.place.record, Some(cut.from.record), status.layer);
            if is_new && is_unwatched(status) {
                self.stats.not_watched_nm += (length_mm * 1e6).round() as u64;
            }
        } else if fires.iter().any(|channel| is_lit(channel) && !self.recovery.is_latched(*channel)) {
            self.cut_map.record_flicker(before, moved);
        }
    }

    /// Sets where the number of contours is found that the program has before the first one of the job.
    pub(crate) fn with_skipped_contours(mut self, skipped: Arc<AtomicU32>) -> Self {
        self.cut_map.number_from(skipped);
        self
    }

    /// Begins or ends a contour where the program has switched a cutter at this place.
    pub(super) fn map_switching(&mut self, place: RecordIndex, line: u32, changes: &[OutputChange]) {
        let ended = map_contour(&mut self.cut_map, &self.config, &self.streamer, (place, line), changes);
        if let Some(contour) = ended {
            let [cut_mm, not_cut_mm] = [contour.cut_um(), contour.not_cut_um].map(|um| um as f64 / 1000.0);
            self.emit_at(contour.line, EventKind::Contour { number: contour.number, cut_mm, not_cut_mm });
        }
        let fires = |change: &&OutputChange| self.config.fire_channels.contains(&change.channel);
        if let Some(change) = changes.iter().find(fires) {
            // A contour that is skipped at its beginning is passed from there to its end.
            self.contour_pass.is_dark &= change.value != 0;
            self.recovery.passes_kerf = false;
        }
    }

    /// Replays the plan to the place where the job was left, with the contours up to there and what was cut of them.
    pub(super) fn replay(&mut self, at: &ResumePoint, counts: [i64; A]) -> Result<ResumePlan<A>, ResumeError> {
        let config = &self.config;
        self.cut_map.begin_restoring(&at.cut);
        let mut kerf_map = self.cut_map.take_kerfs();
        let axes = self.recovery.plane_axes().map(|axes| axes.map(|axis| (axis, config.mm_per_pulse[axis])));
        let kerfs = KerfReplay { map: &mut kerf_map, axes, cut: &at.cut };
        let map = &mut self.cut_map;
        let mut switched = |streamer: &RecordStreamer<'_, A>, place, line, changes: &[OutputChange]| {
            if let Some(contour) = map_contour(map, config, streamer, (place, line), changes) {
                let length_um = |first, records| measure_um(streamer, &config.mm_per_pulse, first, records);
                map.restore_contour(contour.pierce, place, length_um);
            }
        };
        let replay = PlanReplay::new(&mut self.streamer, at, counts, self.recovery.machine(), (&mut switched, kerfs));
        let prepared = replay.run(self.card.status())?;
        let length_um = |first, records| measure_um(&self.streamer, &config.mm_per_pulse, first, records);
        map.kerfs = kerf_map;
        map.end_restoring(&at.cut, at.start.reached, length_um);
        Ok(prepared)
    }

    /// Reports the contours that were begun before the job was left.
    pub(super) fn report_restored_contours(&mut self) {
        let contours = self.cut_map.take_restored();
        if !contours.is_empty() {
            self.emit(EventKind::ContoursRestored(contours.into()));
        }
    }

    /// What speaks against executing the program again from here: the cut ended before, so that a gap would remain, or
    /// a torch would find no metal up to the end of the contour. It is said once at a place: the operator may have laid
    /// a new sheet, or leave the gap.
    pub(super) fn refuse_once(&mut self) -> Option<CommandError> {
        let place = self.card.status().place;
        if self.recovery.refused_at.take() == Some(place) {
            return None;
        }
        let strikes_over_metal = |&channel: &u8| self.recovery.usually_starts_in_motion(channel);
        let refused = if self.is_beyond_cut_end(place) {
            BEYOND_THE_CUT
        } else if self.config.fire_channels.iter().any(strikes_over_metal) && self.cut_map.is_cut_to_its_end(place) {
            CUT_ALREADY
        } else {
            return None;
        };
        self.recovery.refused_at = Some(place);
        Some(refused)
    }

    /// *Recover*: decides whether the rest of the contour is passed with the torch off (CUT-41).
    pub(super) fn decide_on_kerf(&mut self) {
        let place = self.furthest_place();
        let is_whole = self.recovery.cut_end().is_none() && self.cut_map.is_cut_to_its_end(place);
        self.recovery.passes_kerf = is_whole && self.lit_torches().next().is_some();
    }

    /// Torches that the program expects to be on at the furthest place, and that strike no arc over a kerf.
    fn lit_torches(&self) -> impl Iterator<Item = u8> {
        self.expected_cutters().filter(|&channel| self.recovery.usually_starts_in_motion(channel))
    }

    /// Cutters that the program expects to be on at the furthest place.
    fn expected_cutters(&self) -> impl Iterator<Item = u8> {
        let is_lit = |channel: &u8| self.streamer.expected()[usize::from(*channel)] != 0;
        self.config.fire_channels.iter().copied().filter(is_lit)
    }

    /// Outputs that are to be on at the furthest place: what the program expects there, without a torch over a kerf,
    /// without the cutter of a contour that is skipped, and without one that is off where its cut ends.
    pub(super) fn wanted_outputs(&self) -> Outputs {
        let mut wants = *self.streamer.expected();
        if self.contour_pass.is_dark {
            self.expected_cutters().for_each(|channel| wants[usize::from(channel)] = 0);
        } else if self.recovery.passes_kerf {
            self.lit_torches().for_each(|channel| wants[usize::from(channel)] = 0);
        }
        let (are, place) = (&self.card.status().outputs, self.furthest_place());
        // Not where the cut was interrupted before its end: something is left to be cut.
        let is_whole = self.recovery.cut_end().is_none();
        let stays_off = |&channel: &u8| is_whole && are[usize::from(channel)] == 0 && self.ends_cut_at(channel, place);
        self.expected_cutters().filter(stays_off).for_each(|channel| wants[usize::from(channel)] = 0);
        wants
    }

    /// Whether the program switches this cutter off at this place, and nothing is cut before.
    pub(super) fn ends_cut_at(&self, channel: u8, place: Place) -> bool {
        self.streamer.end_of_cut(channel).is_some_and(|end| place == Place::start_of(end))
    }

    /// Whether this place is behind the end of the interrupted cut, in the same contour.
    fn is_beyond_cut_end(&self, place: Place) -> bool {
        let Some(end) = self.recovery.latest_cut_end() else { return false };
        end.distance_to(place) > Distance::ZERO
            && self.streamer.pierce_before(place) == self.streamer.pierce_before(end)
    }

    /// Counts the contours, and what is not cut of them, at the end of the job.
    pub(super) fn count_contours(&mut self) {
        let reached = self.furthest_place().record;
        let length_um = |first, records| measure_um(&self.streamer, &self.config.mm_per_pulse, first, records);
        self.cut_map.measure_current(reached, length_um);
        let (contours, not_cut) = self.cut_map.totals();
        self.stats.contours = contours;
        (self.stats.not_cut_um, self.stats.contours_not_cut) = (not_cut.um, not_cut.contours);
    }
}

/// Begins or ends a contour where the program switches a cutter. Returns the contour that ends.
fn map_contour<const A: usize>(
    map: &mut CutMap,
    config: &SessionConfig<A>,
    streamer: &RecordStreamer<'_, A>,
    (place, line): (RecordIndex, u32),
    changes: &[OutputChange],
) -> Option<Contour> {
    let change = changes.iter().find(|change| config.fire_channels.contains(&change.channel))?;
    if config.inhibits_outputs {
        return None;
    }
    if change.value != 0 {
        map.begin_contour(place, line, change.channel);
        return None;
    }
    map.end_contour(place, |first, records| measure_um(streamer, &config.mm_per_pulse, first, records))
}

/// Length in µm of some records, as far as they are retained.
pub(super) fn measure_um<const A: usize>(
    streamer: &RecordStreamer<'_, A>,
    mm_per_pulse: &[f64; A],
    first: RecordIndex,
    records: u32,
) -> u64 {
    let length_mm = |record: Record<A>| {
        let axes = record.increments.iter().zip(mm_per_pulse);
        axes.map(|(&pulses, mm)| (f64::from(pulses) * mm).powi(2)).sum::<f64>().sqrt()
    };
    let mm: f64 = (0..records).filter_map(|n| streamer.record(first + n)).map(length_mm).sum();
    (mm * 1000.0).round() as u64
}
