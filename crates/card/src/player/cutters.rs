//! What the player does for the cutters besides the permit: starts that are refused, and starts that are cancelled.
//!
//! Invariant: no cutter is started while its input or a collision input is active.

use retrace_core::Rate;
use retrace_link::{Alarm, CutterOffCause, LayerMove, OutputChange, channel};

use super::{MotionBlock, Player};
use crate::beam_power::power_of;
use crate::permit::PermitConditions;
use crate::window::RecordStorage;

impl<const A: usize, const W: usize, const M: usize, S: RecordStorage<A>> Player<A, W, M, S> {
    /// Sets the active collision input.
    pub(crate) const fn set_collision(&mut self, input: Option<u8>) {
        self.collision = input;
    }

    /// Power of the beam after the last period, in the unit of S.
    pub(super) fn beam_power(&self) -> i32 {
        let Some(power) = self.permit.beam_power() else { return 0 };
        let value = |channel: u8| self.outputs.values().get(usize::from(channel)).copied().unwrap_or(0);
        let pierces = self.switching.is_busy() && self.switching.switches_on(power.channel);
        let feed_share = if pierces { None } else { Some(self.feed_share) };
        power_of(power, value(power.channel), value(channel::SPEED), feed_share)
    }

    /// Whether a cutting output is on.
    pub(crate) fn is_lit(&self) -> bool {
        self.permit.is_lit(self.outputs.values())
    }

    /// Switches the cutting outputs off.
    pub(crate) fn switch_cutters_off(&mut self, cause: CutterOffCause) {
        self.permit.switch_off(self.outputs.values_mut(), cause, self.status.place);
        self.update_status();
    }

    /// Switches off every cutting output whose permit is missing, at the end of a period. `denied` is the reason why
    /// none may be on, independent of the path. Returns the alarm of a cutter that stays on.
    pub(crate) fn apply_permit(&mut self, denied: Option<CutterOffCause>) -> Option<Alarm> {
        let conditions = PermitConditions { denied, ..self.conditions };
        let outcome = self.permit.apply_period(self.outputs.values_mut(), &conditions);
        self.status.cutter_off = outcome.off;
        if denied.is_some() || outcome.off.is_some() {
            self.layer.forget_kept_sheet();
        }
        if outcome.blocks {
            self.block = MotionBlock::CutterOff;
        }
        if outcome.is_lost {
            self.switching.cancel_running();
        }
        self.update_status();
        outcome.stays_on.map(|input| Alarm::CutterStaysOn { input })
    }

    /// Cancels the start of a cutter that is switched off manually: neither a further attempt nor the instruction that
    /// waits for its place lights it. A sense test ends as well: the tool comes to rest.
    pub(super) fn cancel_start(&mut self, change: OutputChange) {
        if self.permit.fires(change.channel) {
            self.layer.forget_kept_sheet();
        }
        let is_cancelled = self.switching.switches_on(change.channel) || self.switching.is_sense_test();
        if change.value == 0 && self.permit.fires(change.channel) && is_cancelled {
            if self.switching.is_pulse() {
                self.switching.end_pulse(&mut self.outputs);
                return;
            }
            self.switching.cancel();
            self.permit.report_cancelled_start(self.status.place);
            self.block = MotionBlock::CutterOff;
        }
    }

    /// Whether this change may be made manually. A cutting output is not switched on where it would be switched off at
    /// once.
    pub(crate) fn may_switch(&self, change: OutputChange, denied: Option<CutterOffCause>) -> bool {
        let status = &self.status;
        let now = PermitConditions {
            denied,
            backward: status.rate < Rate::ZERO || status.at_rest && self.unblocked_target() < Rate::ZERO,
            moving: !status.at_rest,
            awaits_motion: self.awaits_motion(),
            keeps_cutter: self.switching.keeps_cutter(),
            is_unwatched: false,
            inputs: status.inputs,
            place: status.place,
        };
        change.value == 0 || self.permit.may_switch_on(change.channel, &now)
    }

    /// Returns the reason why these changes, if they switch a cutter on, must not be made. A contact of the sheet that
    /// is closed is no reason where the sheet is sensed before: the start fails then.
    pub(super) fn alarm_of_start(&self, changes: &[OutputChange], moves: Option<LayerMove>) -> Option<Alarm> {
        let outputs = self.outputs.values();
        if let Some(input) = self.permit.proven_before_start(changes, outputs, self.status.inputs) {
            return Some(Alarm::ProvenBeforeStart { input });
        }
        let lights = changes.iter().any(|change| change.value != 0 && self.permit.fires(change.channel));
        let senses = matches!(moves, Some(LayerMove::Start { .. }));
        let collision = self.collision.filter(|&input| lights && !(senses && self.layer.is_contact(input)));
        collision.map(|input| Alarm::Collision { input })
    }
}
