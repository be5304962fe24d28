//! Lifting the tool off the sheet where a cut was interrupted, so that it is away from the kerf while the machine
//! stands and while the path is retraced (CUT-31, CUT-36).
//!
//! Invariant: the tool is lifted only with the path at rest, with its cutter off and no contact closed; the path is not
//! left, and no count of it changes.

use retrace_core::Rate;
use retrace_link::{CardStatus, HostCommand, LayerMove, MotionCard, OutputChange, RepeatedInstruction};

use super::Session;
use super::restart::LeavingRun;
use crate::event::EventKind;

/// Height of the tool of the cutter that senses the sheet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ToolLift {
    /// Whether the cutter was on since the tool was lifted last.
    is_low: bool,
    /// The card's number of the instruction that lifts the tool, while it is executed.
    number: Option<u32>,
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Whether the tool is being lifted, or tests where the sheet is.
    pub(super) const fn is_lifting(&self) -> bool {
        self.tool_lift.number.is_some() || self.sense_test.is_some()
    }

    /// The move that lifts the tool, if it is to be lifted now.
    pub(super) fn due_lift(&self) -> Option<LayerMove> {
        let (status, machine) = (self.card.status(), self.recovery.machine());
        let layer = machine.tool_layer()?;
        let is_on = |channel: u8| status.outputs.get(usize::from(channel)).is_some_and(|&value| value != 0);
        let is_wanted = |channel: u8| self.streamer.expected().get(usize::from(channel)).is_some_and(|&v| v != 0);
        let was_interrupted = is_wanted(layer.fire) || self.recovery.is_interrupted(layer.fire);
        let is_busy = self.executing.is_some() || self.restart.is_active() || self.dnc.is_paused();
        let stands = status.at_rest && status.rate == Rate::ZERO && self.leaving_run == LeavingRun::No;
        let touches = layer.contacts().any(|input| status.inputs >> (input & 15) & 1 == 1);
        let collides = status.inputs & self.config.collision_inputs != 0 || status.alarm.is_some();
        let is_due = self.tool_lift.is_low && was_interrupted && stands && !is_on(layer.fire);
        if !is_due || is_busy || self.is_lifting() || touches || collides || self.phase.is_stopping() {
            return None;
        }
        layer.retract(machine.axes[layer.index].mm_of(status.counts[layer.index]))
    }

    /// Begins to lift the tool where that is due, and notes when it is done. Called before every control period.
    pub(super) fn advance_tool_lift(&mut self) {
        let repeated = self.card.status().repeated;
        if let Some(number) = self.tool_lift.number {
            if repeated.wrapping_sub(number) as i32 >= 0 {
                self.tool_lift = ToolLift::default();
                self.emit(EventKind::ToolLifted);
            }
            return;
        }
        let Some(lift) = self.due_lift() else { return };
        let number = repeated.wrapping_add(1);
        let instruction = RepeatedInstruction { number, layer: Some(lift), ..RepeatedInstruction::default() };
        // Where the card cannot accept it, it is sent again in the next period.
        if self.card.send(HostCommand::Repeat(instruction)).is_ok() {
            self.tool_lift.number = Some(number);
        }
    }

    /// Notes whether the tool is at the height of a cut.
    pub(super) fn watch_tool_height(&mut self, status: &CardStatus<A>) {
        if let Some(layer) = self.recovery.machine().tool_layer() {
            self.tool_lift.is_low |= status.outputs.get(usize::from(layer.fire)).is_some_and(|&value| value != 0);
        }
        if status.alarm.is_some() {
            // The card has cancelled it.
            self.tool_lift.number = None;
        }
    }

    /// An instruction of the program is complete that moved the tool: behind the end of a cut it is high.
    pub(super) fn record_layer_move(&mut self, layer: Option<LayerMove>, changes: &[OutputChange]) {
        let ends =
            changes.iter().any(|change| change.value == 0 && self.config.fire_channels.contains(&change.channel));
        self.tool_lift.is_low &= !(layer.is_some() && ends || matches!(layer, Some(LayerMove::To { .. })));
    }
}
