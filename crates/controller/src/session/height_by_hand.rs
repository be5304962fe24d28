//! Height control by hand: its target higher and lower, and switched off (CUT-56).
//!
//! Invariant: what the operator has set is kept for the job and ends with it; it moves nothing by itself, since the
//! card controls the height only while a cutter cuts.

mod kerf_hold;

use retrace_config::HeightControlOfCutter;
use retrace_core::RecordIndex;
use retrace_link::{CardStatus, MotionCard, OutputChange, Outputs, channel};

use super::Session;
use crate::operator::{CommandError, HeightCommand};

const NO_CONTROL: CommandError = CommandError::NotNow("the machine file has no `height` in a `[[cutter]]`");
const NO_VOLTS: CommandError = CommandError::NotNow(
    "the height is controlled by a separate controller, which alone has a target: set it there; `height control off` \
     holds the height",
);
const TOO_FAR: CommandError = CommandError::NotNow("the target would be more than 50 V from that of the material");

/// Greatest change of the target, in V.
const MAX_VOLTS: f64 = 50.0;

/// What the operator has set.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HeightByHand {
    /// Steps by which the target is higher than that of the material.
    steps: i32,
    /// Whether the height stays.
    is_off: bool,
    /// Whether it stays because the torch comes to a kerf.
    is_over_kerf: bool,
    /// Place ahead at which the card will hold it, for a kerf there.
    hold_ahead: Option<RecordIndex>,
}

impl HeightByHand {
    /// Value of the channel, with this offset.
    const fn output(&self, offset: i32) -> i32 {
        if self.is_off || self.is_over_kerf { channel::HEIGHT_STAYS } else { offset }
    }
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Executes a command for height control.
    pub(super) fn change_height(&mut self, command: HeightCommand) -> Result<(), CommandError> {
        let control = self.recovery.machine().height_control().ok_or(NO_CONTROL)?;
        let (step_volts, has_volts) = (control.config().step_volts, control.volts_input().is_some());
        let mut height = self.height;
        match command {
            HeightCommand::Control(on) => height.is_off = !on,
            _ if !has_volts => return Err(NO_VOLTS),
            HeightCommand::Up => height.steps += 1,
            HeightCommand::Down => height.steps -= 1,
            HeightCommand::Reset => height.steps = 0,
        }
        let volts = f64::from(height.steps) * step_volts;
        if volts.abs() > MAX_VOLTS && command != HeightCommand::Reset {
            return Err(TOO_FAR);
        }
        let value = height.output(control.readings(volts).round() as i32);
        if !self.send_manual_output(OutputChange { channel: channel::HEIGHT_OFFSET, value }) {
            return Err(CommandError::NoOutput(channel::HEIGHT_OFFSET));
        }
        self.height = height;
        Ok(())
    }

    /// Holds the height over a kerf, or does not any more, as where the card held it at a place that was ordered before
    /// the path changed. What cannot be sent yet is sent in a later period.
    fn hold_over_kerf(&mut self, holds: bool, status: &CardStatus<A>) {
        let height = HeightByHand { is_over_kerf: holds, ..self.height };
        let stays = status.outputs[usize::from(channel::HEIGHT_OFFSET)] == channel::HEIGHT_STAYS;
        let is_left_over = stays && !holds && !self.height.is_off && !self.manual_outputs.has_unreported();
        if holds == self.height.is_over_kerf && !is_left_over {
            return;
        }
        let value = height.output(self.height_offset());
        if self.send_manual_output(OutputChange { channel: channel::HEIGHT_OFFSET, value }) {
            self.height = height;
        }
    }

    /// What the operator adds to the target, in readings.
    fn height_offset(&self) -> i32 {
        let control = self.recovery.machine().height_control();
        let volts = |control: HeightControlOfCutter<'_>| f64::from(self.height.steps) * control.config().step_volts;
        control.map_or(0, |control| control.readings(volts(control)).round() as i32)
    }

    /// The outputs as the operator has set them: a kerf that is crossed does not switch height control off.
    pub(super) fn outputs_as_set(&self, outputs: &Outputs) -> Outputs {
        let mut outputs = *outputs;
        let offset = &mut outputs[usize::from(channel::HEIGHT_OFFSET)];
        if !self.height.is_off && *offset == channel::HEIGHT_STAYS {
            *offset = self.height_offset();
        }
        outputs
    }

    /// At the beginning of a job: the card has no offset of another job.
    pub(super) fn reset_height(&mut self) {
        let outputs = &self.card.status().outputs;
        if outputs.get(usize::from(channel::HEIGHT_OFFSET)).is_some_and(|&value| value != 0) {
            // A card without such a channel controls no height.
            self.send_manual_output(OutputChange { channel: channel::HEIGHT_OFFSET, value: 0 });
        }
    }
}

/// The outputs, but what the operator has set for height control, and what the card switches for it: no program expects
/// a value of them.
pub(super) fn without_height_control(
    mut outputs: Outputs,
    wants: &Outputs,
    control: Option<HeightControlOfCutter<'_>>,
) -> Outputs {
    let enable = control.and_then(|control| control.config().enable);
    for at in [Some(channel::HEIGHT_OFFSET), enable].into_iter().flatten().map(usize::from) {
        if let (Some(output), Some(&wanted)) = (outputs.get_mut(at), wants.get(at)) {
            *output = wanted;
        }
    }
    outputs
}
