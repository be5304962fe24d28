//! Passing the rest of a contour with the cutter off: on the operator's word (CUT-48), and where a cut was lost so
//! close to its end that the contour counts as done (CUT-32).
//!
//! Invariant: what is passed so stays *not cut* in the map, and the next contour is lit by its own instruction.

use retrace_core::mode::{Mode, ModeCommand};
use retrace_core::{Distance, Place};
use retrace_link::MotionCard;

use super::cut_mapping::measure_um;
use super::{ProgramStop, Session};
use crate::event::EventKind;
use crate::operator::CommandError;

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
        self.recovery.skips_contour = true;
        self.recovery.skips_at_rest = false;
        if self.recovery.forget_cut_end() {
            self.emit(EventKind::CutContinued);
        }
        let is_behind =
            matches!(self.mode_controller.mode(), Mode::Rejoin | Mode::Reverse | Mode::Forward | Mode::Wheel);
        self.mode_controller.apply(if is_behind { ModeCommand::Leave { ask: false } } else { ModeCommand::Recover })?;
        Ok(())
    }

    /// Whether a cut that was lost here counts as done: the length to go is at most `lost_at_end_mm`.
    pub(super) fn is_lost_at_end(&self, channel: u8, place: Place) -> bool {
        let most_mm = self.recovery.cutter(channel).map_or(0.0, |cutter| cutter.restart.lost_at_end_mm);
        let Some(end) = self.streamer.end_of_cut(channel).filter(|_| most_mm > 0.0) else { return false };
        let to_go = place.distance_to(Place::start_of(end));
        let records = to_go.max(Distance::ZERO).units() >> 32;
        records < 1 << 20
            && measure_um(&self.streamer, &self.config.mm_per_pulse, place.record, records as u32) as f64
                <= most_mm * 1000.0
    }

    /// Passes the end of a contour that counts as done, once the machine is at rest.
    pub(super) fn pass_lost_end(&mut self) {
        if !self.recovery.skips_at_rest || !self.card.status().at_rest {
            return;
        }
        self.recovery.skips_at_rest = false;
        if self.mode_controller.mode() == Mode::Run && self.mode_controller.is_held() {
            // A refusal leaves the cut interrupted, as any other loss does.
            let _ = self.skip_contour();
        }
    }
}
