//! Contours that are passed with the cutter off: on the operator's word (CUT-48), where a cut was lost so close to its
//! end that the contour counts as done (CUT-32), and those that are cut already, where the program is executed again
//! (CUT-41). Of one that is cut in part the rest is cut then, gap by gap, each from the end of its kerf.
//!
//! Invariant: what is passed so keeps its marks in the map, and the next contour is lit by its own instruction.

use retrace_config::CutterConfig;
use retrace_core::mode::{Mode, ModeCommand};
use retrace_core::{Distance, Place, RecordIndex};
use retrace_link::{MotionCard, OutputChange};

use super::back_target::BackTargetKind;
use super::cut_map::ContourProgress;
use super::cut_mapping::measure_um;
use super::{ProgramStop, Session};
use crate::cutter_off_reason::CutterOffReason;
use crate::event::EventKind;
use crate::operator::{CommandError, CutStart};

const NO_CONTOUR: CommandError = CommandError::NotNow("no contour of this number has been begun");
const CONTOUR_AHEAD: CommandError =
    CommandError::NotNow("the contour, or what is not cut of it, lies ahead: go forward beyond it first");

const BEGUN: CommandError = CommandError::NotNow("the contour has been begun; `skip contour` skips the one being cut");
const TOO_MANY: CommandError = CommandError::NotNow("too many contours are skipped");

/// Most contours that are skipped.
const MAX_SKIPPED: usize = 1000;

/// Records before a kerf in which an arc that is lost has come to it: the map has whole records.
const UNNOTICED_RECORDS: u32 = 3;

/// How contours are passed that were executed before, or are skipped.
#[derive(Debug, Default)]
pub(super) struct ContourPass {
    /// Whether the rest of the contour is passed with its cutter off.
    pub(super) is_dark: bool,
    /// Whether that is to be done once the machine is at rest: the cut was lost close to its end.
    pub(super) skips_at_rest: bool,
    /// Number of the contour that is passed so, and whose rest is cut then.
    rest_of: Option<u32>,
    /// Place from which the program was executed again last: a contour that begins there is cut, whatever is cut of it.
    begins_at: Option<Place>,
    /// Whether every contour is cut again.
    pub(super) cuts_all: bool,
    /// Numbers of the contours ahead that are skipped (CUT-61).
    skipped: Vec<u32>,
    /// Where the contour is cut already, behind the gap that is being cut.
    kerf: Option<RecordIndex>,
}

impl ContourPass {
    /// The program is executed again from this place.
    pub(super) const fn begin_at(&mut self, place: Place) {
        (self.is_dark, self.rest_of, self.begins_at, self.kerf) = (false, None, Some(place), None);
    }

    /// Passes the contour with its cutter off; then the rest of the one of this number is cut.
    const fn pass_dark(&mut self, rest_of: Option<u32>) {
        (self.is_dark, self.skips_at_rest, self.rest_of) = (true, false, rest_of);
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// *Skip contour*: the interrupted contour is passed with the cutter off, and the program continues.
    pub(super) fn skip_contour(&mut self) -> Result<(), CommandError> {
        let refuse = |why| Err(CommandError::NotNow(why));
        if !self.card.status().at_rest || self.restart.is_active() {
            return refuse("`skip contour` needs the machine at rest: hold it first");
        }
        if self.is_on_lead_in() || self.dnc.is_on() {
            return refuse("the machine is off the path: return to it first");
        }
        if self.program_stop != ProgramStop::No || self.single_stop {
            return refuse("this is a stop of the program: continue first");
        }
        let lights_here = self.lights_cutter_here();
        if !lights_here && !self.cut_map.is_in_contour() {
            return refuse("no contour is being cut");
        }
        if let Some(why) = self.config.skip_refusal {
            return refuse(why);
        }
        let is_behind =
            matches!(self.mode_controller.mode(), Mode::Rejoin | Mode::Reverse | Mode::Forward | Mode::Wheel);
        self.mode_controller.apply(if is_behind { ModeCommand::Leave { ask: false } } else { ModeCommand::Recover })?;
        self.contour_pass.pass_dark(None);
        if self.recovery.forget_cut_end() {
            self.emit(EventKind::CutContinued);
        }
        Ok(())
    }

    /// *Skip contour N*: the contour is passed with the cutter off once it is reached; `on` false takes that back.
    pub(super) fn skip_contour_ahead(&mut self, number: u32, on: bool) -> Result<(), CommandError> {
        if let Some(why) = self.config.skip_refusal.filter(|_| on) {
            return Err(CommandError::NotNow(why));
        }
        // A start that is being executed belongs to the next one.
        let is_starting = self.is_starting_cutter() && self.cut_map.next_number() == number;
        if on && (is_starting || self.cut_map.contour(number).is_some()) {
            return Err(BEGUN);
        }
        let skipped = &mut self.contour_pass.skipped;
        if on && skipped.len() == MAX_SKIPPED {
            return Err(TOO_MANY);
        }
        skipped.retain(|&other| other != number);
        if on {
            skipped.push(number);
        }
        self.emit(EventKind::ContourSkip { number, on });
        Ok(())
    }

    /// A gap of a contour is cut from here: its cutter goes off again where the contour is cut behind it (CUT-41).
    pub(super) fn begin_gap(&mut self) {
        let Some(gap) = self.recovery.latest_cut_end() else { return };
        let is_interrupted = |&at: &u8| self.recovery.is_interrupted(at);
        let Some(channel) = self.config.fire_channels.iter().copied().find(is_interrupted) else { return };
        if !self.contour_pass.cuts_all && self.config.skip_refusal.is_none() {
            self.contour_pass.kerf = self.kerf_behind(gap, channel);
        }
    }

    /// Where the contour is cut behind a gap; a jet and a beam stay on over a short stretch.
    fn kerf_behind(&mut self, gap: Place, channel: u8) -> Option<RecordIndex> {
        let contour_end = self.cut_map.current_end()?;
        let passes_lit = |first: RecordIndex, records: u32| {
            let bridge_mm = self.recovery.cutter(channel).map_or(0.0, CutterConfig::bridge_mm);
            measure_um(&self.streamer, &self.config.mm_per_pulse, first, records) as f64 <= bridge_mm * 1000.0
        };
        let stretches = self.cut_map.stretches_behind(gap.boundary_ahead());
        let mut inside = stretches.take_while(|[from, _]| from.is_before(contour_end));
        let is_long = |[from, to]: &[RecordIndex; 2]| !passes_lit(*from, to.since(*from));
        inside.find(is_long).map(|[from, _]| from)
    }

    /// Switches the cutter off where it has come to a kerf, over which an arc would be lost. What is not cut behind it
    /// is cut once the contour is passed.
    pub(super) fn pass_kerf(&mut self) {
        let (Some(kerf), status) = (self.contour_pass.kerf, *self.card.status()) else { return };
        let is_there = Place::start_of(kerf).distance_to(status.place) >= Distance::ZERO;
        let is_lit = |&channel: &u8| {
            status.outputs.get(usize::from(channel)).is_some_and(|&value| value != 0)
                && !self.recovery.is_latched(channel)
        };
        let runs = self.mode_controller.mode() == Mode::Run && !self.restart.is_active() && !self.is_on_lead_in();
        if !is_there || !runs || !self.config.fire_channels.iter().any(is_lit) {
            return;
        }
        self.contour_pass.kerf = None;
        self.contour_pass.pass_dark(Some(self.cut_map.current_number()));
        self.switch_cutters_off(CutterOffReason::Kerf);
    }

    /// Whether an arc that was lost here has come to a kerf: a link may bring the command to switch it off too late.
    pub(super) fn is_lost_over_kerf(&self, place: Place) -> bool {
        let reaches =
            |kerf: RecordIndex| Place::start_of(kerf - UNNOTICED_RECORDS).distance_to(place) >= Distance::ZERO;
        self.contour_pass.kerf.is_some_and(reaches)
    }

    /// Whether a cut that was lost here counts as done: the length to go is at most `lost_at_end_mm`.
    pub(super) fn is_lost_at_end(&self, channel: u8, place: Place) -> bool {
        let most_mm = self.recovery.cutter(channel).map_or(0.0, |cutter| cutter.restart.lost_at_end_mm);
        let Some(end) = self.streamer.end_of_cut(channel) else { return false };
        let to_go = place.distance_to(Place::start_of(end));
        let records = to_go.max(Distance::ZERO).units() >> 32;
        records < 1 << 20
            && measure_um(&self.streamer, &self.config.mm_per_pulse, place.record, records as u32) as f64
                <= most_mm * 1000.0
    }

    /// Passes the end of a contour that counts as done, once the machine is at rest.
    pub(super) fn pass_lost_end(&mut self) {
        if !self.contour_pass.skips_at_rest || !self.card.status().at_rest {
            return;
        }
        self.contour_pass.skips_at_rest = false;
        if self.mode_controller.mode() == Mode::Run && self.mode_controller.is_held() {
            // A refusal leaves the cut interrupted, as any other loss does.
            let rest = self.contour_pass.kerf.take().map(|_| self.cut_map.current_number());
            if self.skip_contour().is_ok() {
                self.contour_pass.rest_of = rest;
            }
        }
    }

    /// Whether an instruction that lights a cutter is executed without doing so; its changes are those of the dark pass
    /// then.
    pub(super) fn lights_dark(&mut self, place: RecordIndex, changes: &mut [OutputChange]) -> bool {
        let fires = &self.config.fire_channels;
        if !changes.iter().any(|change| change.value != 0 && fires.contains(&change.channel)) {
            return false;
        }
        if !self.contour_pass.is_dark {
            self.pass_what_is_cut(place);
        }
        let fires = &self.config.fire_channels;
        if self.contour_pass.is_dark {
            changes.iter_mut().filter(|change| fires.contains(&change.channel)).for_each(|change| change.value = 0);
        }
        self.contour_pass.is_dark
    }

    /// Decides whether the contour that begins here is passed with its cutter off: the operator skips it (CUT-61), or
    /// it is cut, at least at its beginning, where a torch would strike no arc (CUT-41).
    fn pass_what_is_cut(&mut self, pierce: RecordIndex) {
        let begins_at = self.contour_pass.begins_at;
        let is_chosen = begins_at == Some(Place::start_of(pierce));
        if !is_chosen && self.contour_pass.skipped.contains(&self.cut_map.number_at(pierce)) {
            return self.contour_pass.pass_dark(None);
        }
        if is_chosen || begins_at.is_none() || self.contour_pass.cuts_all || self.config.skip_refusal.is_some() {
            return;
        }
        match self.cut_map.progress_at(pierce) {
            Some((_, ContourProgress::Whole)) => self.contour_pass.pass_dark(None),
            Some((contour, ContourProgress::CutUpTo(_))) => self.contour_pass.pass_dark(Some(contour.number)),
            Some((_, ContourProgress::NotBegun)) | None => {}
        }
    }

    /// Before the instruction that ends a contour: whether the machine goes back to cut the rest of the contour, which
    /// was passed with its cutter off.
    pub(super) fn cuts_rest_before(&mut self, place: RecordIndex, changes: &[OutputChange]) -> bool {
        let fires = &self.config.fire_channels;
        let ends = changes.iter().any(|change| change.value == 0 && fires.contains(&change.channel));
        let Some(number) = self.contour_pass.rest_of.filter(|_| ends) else { return false };
        let status = self.card.status();
        if status.at_rest && status.place == Place::start_of(place) {
            self.contour_pass.rest_of = None;
            let contour = self.cut_map.contour(number);
            let progress = contour.map(|contour| self.cut_map.progress_of(&contour));
            if !matches!(progress, Some(ContourProgress::CutUpTo(_))) {
                return false;
            }
            if self.back_to_contour(number).is_ok() {
                self.return_and_start(CutStart::Usual);
            }
        }
        true
    }

    /// Goes back to a contour: to where its kerf ends, if it is cut in part, otherwise to its pierce.
    pub(super) fn back_to_contour(&mut self, number: u32) -> Result<(), CommandError> {
        let contour = self.cut_map.contour(number).ok_or(NO_CONTOUR)?;
        let progress = self.cut_map.progress_of(&contour);
        let target = if let ContourProgress::CutUpTo(end) = progress { end } else { contour.pierce };
        if self.card.status().place.distance_to(Place::start_of(target)) > Distance::ZERO {
            return Err(CONTOUR_AHEAD);
        }
        if let ContourProgress::CutUpTo(end) = progress {
            self.begin_rest_of_cut(Place::start_of(end), contour.channel);
            return self.back_to_cut_end();
        }
        self.recovery.cancel_return();
        self.go_back(BackTargetKind::Contour(contour.pierce))
    }
}
