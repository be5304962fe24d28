//! Where the program switches the operator's overrides off (M48 … M50): what that means for the rate.
//!
//! Invariant: in normal run, and on the way back to it, the requested rate is exactly 1 where the overrides are
//! switched off, and the operator's elsewhere. The rate changes at rest. A switch is no start: at an override of 0 the
//! instruction that switches it off is not executed.

mod speed_override;

use retrace_core::mode::{Mode, ModeController, ModeOutput, ModeState, MotionFacts};
use retrace_core::{Rate, RecordIndex};
use retrace_link::{CardStatus, MotionCard};

use super::Session;
use crate::event::EventKind;
use speed_override::SpeedOverride;

/// What was reported of the program's switch.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ProgramOverride {
    /// Whether the overrides are reported as switched off.
    is_reported_off: bool,
    /// Override of the speed of the spindle.
    speed: SpeedOverride,
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Whether the operator's overrides apply where the machine is on its path.
    pub(super) fn override_applies(&self) -> bool {
        self.streamer.override_applies(self.card.status())
    }

    /// Whether an override of 0 stops the machine.
    pub(super) fn is_stopped_by_override(&self) -> bool {
        let ModeState { override_rate, rapid_override, .. } = self.mode_controller.state();
        self.override_applies() && (override_rate == Rate::ZERO || rapid_override == Rate::ZERO)
    }

    /// Advances the mode by a period. Where overrides do not apply, it sees both of them at 100 %.
    pub(super) fn advance_mode(&mut self, facts: &MotionFacts) -> ModeOutput {
        if self.override_applies() {
            let output = self.mode_controller.advance_period(facts);
            return self.with_feed_per_turn(output);
        }
        let state = self.mode_controller.state();
        let (override_rate, rapid_override) = (state.override_rate, state.rapid_override);
        let as_planned = ModeState { override_rate: Rate::ONE, rapid_override: Rate::ONE, ..state };
        let mut controller = ModeController::with_state(as_planned);
        let output = controller.advance_period(facts);
        self.mode_controller =
            ModeController::with_state(ModeState { override_rate, rapid_override, ..controller.state() });
        self.with_feed_per_turn(output)
    }

    /// Where records ahead end while the path is retraced: the furthest place, or the end of the thread around it. On
    /// the way back to normal run it is the next place at which overrides are switched; the machine rests there.
    pub(super) fn end_of_retrace(&self) -> RecordIndex {
        let status: &CardStatus<A> = self.card.status();
        let end = self.end_of_retraced_thread();
        let switch = self.streamer.next_override_switch(status).filter(|switch| switch.is_before(end));
        switch.filter(|_| self.mode_controller.mode() == Mode::Rejoin).unwrap_or(end)
    }

    /// Reports where the program switches the overrides off and on, also while the path is retraced.
    pub(super) fn watch_program_override(&mut self) {
        let is_off = !self.override_applies();
        if std::mem::replace(&mut self.program_override.is_reported_off, is_off) != is_off {
            self.emit(EventKind::FeedOverrideSwitched(!is_off));
        }
    }
}
