//! Follows the state of each cutter, and reports its changes (CUT-2, CUT-12).
//!
//! Invariant: a state is what the card reports in that control period; a change is reported once.

use retrace_core::Rate;
use retrace_link::{CardStatus, LayerMove, MotionCard, channel};

use super::Session;
use crate::cutter_state::CutterState;
use crate::event::EventKind;
use crate::plan_item::ExclusiveKind;

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Reports the cutters whose state has changed.
    pub(super) fn watch_cutter_states(&mut self, status: &CardStatus<A>) {
        for at in 0..self.config.fire_channels.len() {
            let channel = self.config.fire_channels[at];
            let state = self.cutter_state((channel, self.cutter_states[at]), status);
            self.count_flickers(at, state, status);
            if std::mem::replace(&mut self.cutter_states[at], state) != state {
                let contour = self.cut_map.current_number();
                self.emit(EventKind::CutterState { channel, state, contour });
            }
        }
    }

    /// Counts the flickers of a cutter that cuts: its input was inactive, and is active again before it counts as lost
    /// (CUT-31).
    fn count_flickers(&mut self, at: usize, state: CutterState, status: &CardStatus<A>) {
        let channel = self.config.fire_channels[at];
        self.stats.lit += u64::from(status.outputs[usize::from(channel)] != 0);
        let Some(proof) = self.recovery.cutter(channel).and_then(|cutter| cutter.proof) else { return };
        let cuts = matches!(state, CutterState::Cutting | CutterState::Ending) && !is_unwatched(status);
        let is_active = status.inputs >> (proof.input & 15) & 1 == 1;
        let was_inactive = std::mem::replace(&mut self.cutter_inactive[at], cuts && !is_active);
        self.stats.cutter_flickers += u64::from(was_inactive && cuts && is_active);
    }

    /// Whether the input of this cutter counts as active: it is, there is none, or the program ignores it (CUT-33).
    pub(super) fn is_proven(&self, channel: u8, status: &CardStatus<A>) -> bool {
        let proof = self.recovery.cutter(channel).and_then(|cutter| cutter.proof);
        is_unwatched(status) || proof.is_none_or(|proof| status.inputs >> (proof.input & 15) & 1 == 1)
    }

    fn cutter_state(&self, (channel, before): (u8, CutterState), status: &CardStatus<A>) -> CutterState {
        if self.config.inhibits_outputs {
            return CutterState::Dry;
        }
        let is_on = status.outputs[usize::from(channel)] != 0;
        let is_unproven = !self.is_proven(channel, status);
        let is_starting = self.is_starting(channel);
        match is_on {
            true if self.is_test_pulse(channel) => CutterState::Test,
            true if is_starting && !is_unproven => CutterState::Piercing,
            // not between two attempts
            false if is_starting && self.senses_sheet() && before != CutterState::Igniting => CutterState::Sensing,
            _ if is_starting => CutterState::Igniting,
            true if self.recovery.is_latched(channel) => CutterState::Igniting,
            true if self.ends_contour(channel) => CutterState::Ending,
            // between the pause at the end and the code that switches it off
            true if before == CutterState::Ending && status.rate == Rate::ZERO => CutterState::Ending,
            true => CutterState::Cutting,
            false if self.recovery.is_interrupted(channel) => CutterState::Lost,
            false => CutterState::Off,
        }
    }

    /// Whether the start that is being executed begins with sensing the sheet.
    fn senses_sheet(&self) -> bool {
        let executing = self.executing.and_then(|_| self.streamer.sent_instruction()).and_then(|of| of.layer);
        matches!(executing.or_else(|| self.restart.layer()), Some(LayerMove::Start { .. }))
    }

    /// Whether an instruction is executed that ends a contour: the pause at its end, or switching the cutter off.
    fn ends_contour(&self, channel: u8) -> bool {
        let executing = self.executing.and_then(|_| self.streamer.sent_instruction());
        executing.is_some_and(|instruction| {
            let changes = &instruction.changes[..usize::from(instruction.count)];
            let is_pause = instruction.kind == ExclusiveKind::Dwell && instruction.code != "G4";
            is_pause || changes.iter().any(|change| change.channel == channel && change.value == 0)
        })
    }
}

/// Whether the program ignores the input that proves a cutter, in this control period (CUT-33).
pub(super) fn is_unwatched<const A: usize>(status: &CardStatus<A>) -> bool {
    status.outputs[usize::from(channel::UNWATCHED)] != 0
}
