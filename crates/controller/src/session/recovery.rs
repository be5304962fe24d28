//! Recovery of an interrupted cut: back to where the cut ended, and from there the program again (CUT-30, CUT-34 …
//! CUT-38).
//!
//! The program is executed again by a path of its own that begins at the place: the card forgets what it executed
//! beyond, so records, actions and instructions pass again in their order, and the cutter is lit by the instructions
//! that switched it.
//!
//! Invariant: the program is executed again only from a place where the machine is at rest with its cutters off; the
//! counts of every place beyond are those of the first time.

use retrace_config::{CutterConfig, MachineConfig};
use retrace_core::mode::{Mode, ModeCommand, ModeController, ModeState};
use retrace_core::{Distance, Place};
use retrace_link::{HostCommand, MotionCard, PathStart};

use super::arc_latch::Latch;
use super::back_target::{BackTarget, BackTargetKind};
use super::cut_end::CutEnd;
use super::kerf_search::KerfSearch;
use super::lead_in::{Lead, NOT_IN_CUT};
use super::restart::LeavingRun;
use super::{JobPhase, ProgramStop, Session};
use crate::event::{CardError, EventKind};
use crate::operator::{CommandError, CutStart};
use crate::record_streamer::LeadIn;

/// State of the recovery of an interrupted cut.
#[derive(Debug)]
pub(super) struct CutRecovery {
    machine: MachineConfig,
    pub(super) cut_end: Option<CutEnd>,
    /// The machine goes back, and starts there in this way.
    returning: Option<CutStart>,
    /// How the next restart of the outputs starts the cutter, where that was chosen.
    chosen_start: Option<CutStart>,
    /// Whether the operator is asked before the outputs are switched to what the program expects at that place.
    pub(super) asks: bool,
    pub(super) latch: Option<Latch>,
    /// The interrupted cut is to be continued once the machine is at the furthest place.
    continues_when_rejoined: bool,
    /// Whether the rest of the contour is passed with the torch off: it is cut, and over a kerf no arc strikes.
    pub(super) passes_kerf: bool,
    /// Whether the next start pierces: the sheet may not be pierced where the cut begins. Over a kerf no arc strikes,
    /// and the start after it is one in motion.
    pub(super) pierces_first: bool,
    /// Where *cut* was refused because everything is cut already.
    pub(super) refused_at: Option<Place>,
    /// Where the next start of the cutter lies, and how it leads in.
    pub(super) lead: Lead,
    /// Search for a kerf where the cutter is to pierce.
    pub(super) kerf_search: Option<KerfSearch>,
}

impl CutRecovery {
    pub(super) fn new(machine: &MachineConfig) -> Self {
        Self {
            machine: machine.clone(),
            cut_end: None,
            returning: None,
            chosen_start: None,
            asks: false,
            latch: None,
            continues_when_rejoined: false,
            passes_kerf: false,
            pierces_first: false,
            refused_at: None,
            lead: Lead::default(),
            kerf_search: None,
        }
    }

    pub(super) fn machine(&self) -> &MachineConfig {
        &self.machine
    }

    /// Indices of the axes X and Y.
    pub(super) fn plane_axes(&self) -> Option<[usize; 2]> {
        let axis = |name: char| self.machine.axes.iter().position(|axis| axis.name == name);
        Some([axis('x')?, axis('y')?])
    }

    /// Width of the kerf of the usual material, mm.
    pub(super) fn kerf_mm(&self) -> Option<f64> {
        let materials = &self.machine.materials.as_ref()?.table;
        materials.get(materials.default_number()).map(|material| material.kerf_mm).filter(|&mm| mm > 0.0)
    }

    /// Longest shift in mm.
    pub(super) fn shift_max_mm(&self) -> f64 {
        let channel = self.cut_end.map(|end| end.channel);
        let cutter = channel.map_or(self.machine.cutters.first(), |channel| self.cutter(channel));
        cutter.map(|cutter| cutter.restart).unwrap_or_default().shift_max_mm
    }

    /// Place where the cut was interrupted, if it was.
    pub(super) fn cut_end(&self) -> Option<Place> {
        self.cut_end.map(|end| end.place)
    }

    /// What is not cut stays so. Returns whether a cut was interrupted.
    pub(super) const fn forget_cut_end(&mut self) -> bool {
        let was_interrupted = self.cut_end.is_some();
        (self.cut_end, self.latch, self.returning) = (None, None, None);
        was_interrupted
    }

    /// Whether the cut of this cutter is interrupted.
    pub(super) fn is_interrupted(&self, channel: u8) -> bool {
        self.cut_end.is_some_and(|end| end.channel == channel)
    }

    /// Whether this cutter started in motion and is not proven yet.
    pub(super) fn is_latched(&self, channel: u8) -> bool {
        self.latch.is_some_and(|latch| latch.cut_end.channel == channel)
    }

    /// The furthest place to which the interrupted cut may have been cut.
    pub(super) fn latest_cut_end(&self) -> Option<Place> {
        self.cut_end.map(|end| end.latest)
    }

    /// Ends a return to the end of the cut: the operator has taken over.
    pub(super) fn cancel_return(&mut self) {
        (self.returning, self.chosen_start) = (None, None);
        (self.asks, self.continues_when_rejoined) = (false, false);
    }

    pub(super) fn cutter(&self, channel: u8) -> Option<&CutterConfig> {
        self.machine.cutters.iter().find(|cutter| cutter.fire == channel)
    }

    /// Whether this cutter starts in motion inside a cut.
    pub(super) fn usually_starts_in_motion(&self, channel: u8) -> bool {
        self.cutter(channel).is_some_and(CutterConfig::starts_in_motion)
    }

    /// Length in mm before the end of the cut from which it is continued.
    fn run_in_mm(&self, channel: u8) -> f64 {
        let cutter = self.cutter(channel);
        // A shifted cutter pierces.
        cutter.map_or(0.0, |cutter| if self.lead.is_shifted() { cutter.restart.overlap_mm } else { cutter.run_in_mm() })
    }
}

const NOT_AT_REST: CommandError = CommandError::NotNow("the machine has to be at rest");
const NOT_RETRACING: CommandError =
    CommandError::NotNow("go back first: `reverse`, `back to cut end`, `back to pierce`");
const NOT_RETAINED: CommandError = CommandError::NotNow(
    "the instructions of the program are not retained back to this place: end the job, and begin at a contour with \
     `run --contour N`, or Enter in the list of contours (C)",
);

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Goes forward to the furthest place, also from a hold, and continues the interrupted cut from there. Returns
    /// false where no cut was interrupted.
    fn continue_when_rejoined(&mut self) -> Result<bool, CommandError> {
        if self.recovery.cut_end.is_none() {
            return Ok(false);
        }
        self.retrace(ModeCommand::Leave { ask: false })?;
        self.recovery.continues_when_rejoined = true;
        Ok(true)
    }

    /// Continues an interrupted cut once the machine is at the furthest place.
    pub(super) fn recover_when_rejoined(&mut self) {
        let status = self.card.status();
        let is_there = status.at_rest && status.place == Place::start_of(status.reached);
        let is_held = self.mode_controller.is_held();
        if !self.recovery.continues_when_rejoined || !is_there || is_held || self.restart.is_active() {
            return;
        }
        self.recovery.continues_when_rejoined = false;
        if self.mode_controller.mode() == Mode::Rejoin && !self.begin_recovery().is_ok_and(|begun| begun) {
            // The cutter is started at the furthest place then.
            let _ = self.mode_controller.apply(ModeCommand::Leave { ask: false });
        }
    }

    /// Goes back to the place from which the interrupted cut is continued.
    pub(super) fn back_to_cut_end(&mut self) -> Result<(), CommandError> {
        let end = self.recovery.cut_end.ok_or(CommandError::NoCutEnd)?;
        let run_in_mm = self.recovery.run_in_mm(end.channel);
        self.recovery.cancel_return();
        let mode = self.mode_controller.mode();
        self.go_back(BackTargetKind::CutEnd(run_in_mm))?;
        if mode == Mode::Run {
            self.leaving_run = LeavingRun::Braking;
        }
        Ok(())
    }

    /// *Recover* after an interrupted cut: goes back, and cuts on from there. Returns false where no cut was
    /// interrupted.
    pub(super) fn begin_recovery(&mut self) -> Result<bool, CommandError> {
        let is_there = self.card.status().place == self.furthest_place() && !self.restart.is_active();
        if self.mode_controller.mode() == Mode::Rejoin && !is_there {
            return self.continue_when_rejoined();
        }
        if self.is_on_lead_in() {
            // Nothing was cut where the machine stands at its start; else it leads in anew.
            let start = self.streamer.lead_in().map(LeadIn::start).map(Place::start_of);
            if start == Some(self.card.status().place) && self.recovery.lead.is_as_planned() {
                return Ok(false);
            }
            return self.cut_from_here(CutStart::Pierce, false).map(|()| true);
        }
        // At a stop of the program the cutter is started where it is.
        let stands = self.program_stop != ProgramStop::No || self.single_stop;
        let Some(end) = self.recovery.cut_end() else {
            return if self.recovery.lead.is_shifted() && self.starts_cutter_here() {
                Err(NOT_IN_CUT)
            } else {
                Ok(false)
            };
        };
        if stands || self.dnc.is_on() || self.restart.is_active() {
            return Ok(false);
        }
        let place = self.card.status().place;
        if end.distance_to(place) < Distance::ZERO {
            // The operator has gone back already: from here, then, if it is inside the cut.
            let pierce = self.streamer.pierce_before(end).map(Place::start_of);
            return match self.mode_controller.mode() {
                Mode::Run => Ok(false),
                _ if pierce.is_some_and(|pierce| pierce.distance_to(place) >= Distance::ZERO) => {
                    self.cut_from_here(CutStart::Usual, false).map(|()| true)
                }
                // From before its pierce it goes forward first.
                _ => self.continue_when_rejoined(),
            };
        }
        match self.back_to_cut_end() {
            Ok(()) => self.recovery.returning = Some(CutStart::Usual),
            // at the start of the history already: from here, then
            Err(CommandError::NothingBehind) => return Ok(false),
            Err(refused) => return Err(refused),
        }
        Ok(true)
    }

    /// Whether the program goes on here with a cutter that is on, or is to be lit.
    fn starts_cutter_here(&self) -> bool {
        let expected = self.streamer.expected();
        self.lights_cutter_here() || self.config.fire_channels.iter().any(|&at| expected[usize::from(at)] != 0)
    }

    /// Whether the next instruction of the program is here, and lights a cutter.
    pub(super) fn lights_cutter_here(&self) -> bool {
        let place = self.card.status().place;
        let next = self.streamer.sent_instruction().filter(|next| Place::start_of(next.place) == place);
        next.is_some_and(|next| self.config.fire_channels.iter().any(|&channel| next.switches_on(channel)))
    }

    /// *Cut*: the program is executed again from here; `cuts_all`: contours that are cut already, too.
    pub(super) fn cut_from_here(&mut self, start: CutStart, cuts_all: bool) -> Result<(), CommandError> {
        let is_on_lead_in = self.is_on_lead_in();
        if self.mode_controller.mode() == Mode::Run && !is_on_lead_in {
            return Err(NOT_RETRACING);
        }
        if !self.card.status().at_rest {
            return Err(NOT_AT_REST);
        }
        let place = self.streamer.lead_in().filter(|_| is_on_lead_in).map(LeadIn::join);
        if place.unwrap_or(self.card.status().place.record).is_before(self.streamer.oldest_return()) {
            return Err(NOT_RETAINED);
        }
        if place.is_none()
            && !cuts_all
            && let Some(refused) = self.refuse_once()
        {
            return Err(refused);
        }
        self.recovery.cancel_return();
        self.back_target = None;
        self.contour_pass.cuts_all = cuts_all;
        self.return_and_start(start);
        Ok(())
    }

    /// Executes the program again from where the machine is, once it is back there.
    pub(super) fn return_and_start(&mut self, start: CutStart) {
        self.recovery.returning = Some(start);
    }

    /// Whether the program is executed again from where the machine stands: until then the mode does not change.
    pub(super) fn is_due_here(&self) -> bool {
        self.recovery.returning.is_some() && self.back_target.is_none() && self.leaving_run == LeavingRun::No
    }

    /// Begins to execute the program again, once the machine is back. Called before every control period.
    pub(super) fn advance_recovery(&mut self) -> Result<(), CardError> {
        self.pass_lost_end();
        self.advance_kerf_search();
        self.pass_kerf();
        let Some(start) = self.recovery.returning else { return Ok(()) };
        let status = *self.card.status();
        let is_there = match &self.back_target {
            None => true,
            Some(target) => status.place.fraction == 0 && BackTarget::is_reached_at(target, status.place.record),
        };
        let is_held = self.back_target.is_some() && self.mode_controller.is_held();
        if !is_there
            || !status.at_rest
            || self.is_lifting()
            || is_held
            || self.leaving_run != LeavingRun::No
            || self.dnc.is_on()
        {
            return Ok(());
        }
        self.recovery.returning = None;
        let pierces = self.recovery.pierces_first && start == CutStart::Usual;
        self.execute_again(if pierces { CutStart::Pierce } else { start })
    }

    fn execute_again(&mut self, start: CutStart) -> Result<(), CardError> {
        let (path_start, join) = (self.path_start(), self.join());
        let lead_in = match self.plan_lead_in() {
            Ok(lead_in) => lead_in,
            Err(why) => {
                self.emit(EventKind::CommandRejected(why));
                let _ = self.mode_controller.apply(ModeCommand::Hold);
                return Ok(());
            }
        };
        let place = lead_in.as_ref().map_or(path_start.place, |lead_in| Place::start_of(lead_in.join()));
        // A cut that begins beyond this place is cut anew.
        let pierce = self.recovery.cut_end().and_then(|end| self.streamer.pierce_before(end));
        if pierce.is_none_or(|pierce| place.distance_to(Place::start_of(pierce)) > Distance::ZERO)
            && self.recovery.cut_end.take().is_some()
        {
            self.emit(EventKind::CutContinued);
        }
        let executed = self.streamer.return_to(place);
        self.cut_map.reopen_contour(place);
        self.recovery.passes_kerf = false;
        self.contour_pass.begin_at(place);
        self.begin_gap();
        let begin = match lead_in {
            None => PathStart { reached: place.boundary_ahead(), executed, ..path_start },
            Some(lead_in) => {
                let begin = lead_in.begin();
                self.streamer.begin_lead_in(lead_in);
                PathStart { place: Place::start_of(begin), rests: false, reached: begin, executed, keeps_state: true }
            }
        };
        self.begin_program_path(begin)?;
        let _ = self.card.send(HostCommand::Replay { on: self.config.replays_outputs });
        if self.single_block {
            // The block ends beyond this place, wherever its end was looked for before.
            self.streamer.trim_at_block_end(&mut self.card, place.boundary_ahead());
        }
        (self.target, self.executing, self.back_target) = (None, None, None);
        (self.program_stop, self.single_stop) = (ProgramStop::No, false);
        if self.phase == JobPhase::ProgramEnded {
            self.phase = JobPhase::Running;
        }
        let lit = self.config.fire_channels.iter().find(|&&at| self.streamer.expected()[usize::from(at)] != 0);
        let moving = lit.is_some_and(|&channel| self.starts_in_motion(channel, place, Some(start)));
        if let Some(&channel) = lit.filter(|_| !moving) {
            self.begin_kerf_search(channel, join);
        }
        self.recovery.chosen_start = Some(start);
        self.recovery.pierces_first = false;
        let state = self.mode_controller.state();
        self.mode_controller = ModeController::with_state(ModeState {
            mode: Mode::AwaitOutputs,
            held: false,
            rested_since_run: true,
            confirmed: !std::mem::take(&mut self.recovery.asks),
            notified: false,
            ..state
        });
        self.emit(EventKind::CutFromHere { moving });
        Ok(())
    }

    /// Whether a restart at this place starts the cutter in motion. Where the operator has not chosen to cut from here,
    /// it does so in the kerf of a cut that was interrupted further on.
    fn starts_in_motion(&self, channel: u8, place: Place, chosen: Option<CutStart>) -> bool {
        let is_in_kerf =
            chosen.is_some() || self.recovery.cut_end().is_some_and(|end| place.distance_to(end) > Distance::ZERO);
        match chosen.unwrap_or(CutStart::Usual) {
            _ if self.is_on_lead_in() => false,
            CutStart::Usual => {
                is_in_kerf && self.recovery.usually_starts_in_motion(channel) && !self.is_at_pierce(place)
            }
            CutStart::Pierce => false,
            CutStart::Moving => true,
        }
    }

    /// Prepares the steps of a restart for the way in which the cutter starts.
    pub(super) fn prepare_cutter_start(&mut self) {
        let chosen = self.recovery.chosen_start.take();
        let place = self.card.status().place;
        let fires = self.config.fire_channels.iter().find(|&&channel| self.restart.switches_on(channel));
        if fires.is_some_and(|&channel| self.starts_in_motion(channel, place, chosen)) {
            self.start_in_motion(place);
        }
    }

    /// Whether the cutter was lit at this very place and has cut nothing beyond.
    fn is_at_pierce(&self, place: Place) -> bool {
        let pierce = self.streamer.pierce_before(place).map(Place::start_of);
        pierce == Some(place) && self.recovery.cut_end().is_none_or(|end| end == place)
    }

    pub(super) fn furthest_place(&self) -> Place {
        Place::start_of(self.card.status().reached)
    }
}
