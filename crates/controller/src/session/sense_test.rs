//! The sense test (CUT-57): the sheet is sensed at rest with the cutter off, to check its contacts and its place, and
//! the tool returns to where it was.
//!
//! Invariant: no output is switched on, and no program is continued before the tool is back.

use retrace_config::ToolLayer;
use retrace_link::{
    CardStatus, CutterOff, HEIGHT_CONTROLS, HeightControlSettings, HostCommand, LayerMove, MotionCard, OutputChange,
    RepeatedInstruction,
};

use super::Session;
use crate::event::EventKind;
use crate::operator::{CommandError, OperatorCommand};
use crate::sense_outcome::SenseOutcome;

/// Height in mm over the sheet that was found, where the test ends.
const HEIGHT_MM: f64 = 1.0;

const NO_SENSING: CommandError = CommandError::NotNow("the machine file has no `sense` in a `[[cutter]]`");

/// A sense test in progress.
#[derive(Clone, Copy, Debug)]
pub(super) struct SenseTest {
    /// The card's number of the instruction that is executed.
    number: u32,
    /// Layer to which the tool returns.
    layer: i32,
    stage: Stage,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The sheet is sensed.
    Sensing,
    /// The tool is to return once it is at rest.
    Stopping,
    /// It returns.
    Returning,
}

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// *Sense test*: senses the sheet here.
    pub(super) fn sense_test(&mut self) -> Result<(), CommandError> {
        let machine = self.recovery.machine();
        let layer = machine.tool_layer().ok_or(NO_SENSING)?;
        self.require_rest_for_test("a sense test needs the machine at rest, with the program held")?;
        let status = self.card.status();
        let contacts = layer.contacts().fold(0, |bits, input| bits | 1_u16 << input);
        if status.inputs & self.config.collision_inputs & !contacts != 0 {
            return Err(CommandError::NotNow("a collision input of the cutter is active"));
        }
        if layer.contacts().any(|input| status.inputs >> (input & 15) & 1 == 1) {
            return Err(CommandError::NotNow("a contact of the sheet is closed: lift the tool, check the input"));
        }
        let number = status.repeated.wrapping_add(1);
        let (back, path_mm) = (status.layer, machine.axes[layer.index].mm_of(status.counts[layer.index]));
        if self.card.send(sense_command(number, layer, path_mm)).is_err() {
            return Err(CommandError::NotNow("the card does not sense the sheet now: try again"));
        }
        self.sense_test = Some(SenseTest { number, layer: back, stage: Stage::Sensing });
        Ok(())
    }

    /// Ends the test before a command that stops; refuses every other one until the tool is back.
    pub(super) fn end_sense_test_by(&mut self, command: OperatorCommand) -> Result<(), CommandError> {
        let Some(test) = self.sense_test else { return Ok(()) };
        match command {
            OperatorCommand::CutterOff | OperatorCommand::Hold | OperatorCommand::Stop => {
                if let Some(layer) = self.recovery.machine().tool_layer().filter(|_| test.stage == Stage::Sensing) {
                    // never refused
                    let _ = self.card.send(cancel_command(layer));
                }
                Ok(())
            }
            OperatorCommand::Contours => Ok(()),
            _ => Err(CommandError::NotNow("a sense test is in progress: wait for its end")),
        }
    }

    /// The card has ended the test without a sheet. Returns false where no test was in progress.
    pub(super) fn sense_test_went_off(&mut self, off: CutterOff) -> bool {
        let Some(test) = self.sense_test.filter(|test| test.stage == Stage::Sensing) else { return false };
        self.sense_test = Some(SenseTest { stage: Stage::Stopping, ..test });
        self.emit_sense_test(SenseOutcome::without_sheet(off.cause));
        true
    }

    /// Reports the sheet that was found, and returns the tool. Called before every control period.
    pub(super) fn advance_sense_test(&mut self) {
        let (Some(test), status) = (self.sense_test, *self.card.status()) else { return };
        let is_complete = status.repeated.wrapping_sub(test.number) as i32 >= 0;
        match test.stage {
            Stage::Sensing if is_complete => {
                self.sense_test = Some(SenseTest { stage: Stage::Stopping, ..test });
                if let Some(layer) = self.recovery.machine().tool_layer() {
                    let axis = &self.recovery.machine().axes[layer.index];
                    let mm = sensed_mm(layer, |pulses| axis.mm_of(pulses), &status);
                    self.emit_sense_test(SenseOutcome::Found { mm });
                }
            }
            Stage::Stopping if status.at_rest => {
                let number = status.repeated.wrapping_add(1);
                // Where the card cannot accept it, it is sent again in the next period.
                if self.card.send(return_command(number, test.layer)).is_ok() {
                    self.sense_test = Some(SenseTest { number, stage: Stage::Returning, ..test });
                }
            }
            Stage::Returning if is_complete => {
                self.sense_test = None;
                self.release_block();
            }
            Stage::Sensing | Stage::Stopping | Stage::Returning => {}
        }
    }

    /// An alarm ends the test where the tool is: the card has cancelled it.
    pub(super) fn watch_sense_test(&mut self, status: &CardStatus<A>) {
        self.sense_test = self.sense_test.filter(|_| status.alarm.is_none());
    }

    fn emit_sense_test(&mut self, outcome: SenseOutcome) {
        let machine = self.recovery.machine();
        let axis = machine.tool_layer().map_or('z', |layer| machine.axes[layer.index].name);
        self.emit(EventKind::SenseTest { axis, outcome });
    }
}

/// The command that senses the sheet; the path of the tool axis is at `path_mm`.
pub(crate) fn sense_command<const A: usize>(number: u32, layer: ToolLayer<'_>, path_mm: f64) -> HostCommand<A> {
    // What is found counts for no start: the move back forgets it.
    let moves = layer.start(path_mm, [HEIGHT_MM; 2], false, [HeightControlSettings::NONE; HEIGHT_CONTROLS]);
    HostCommand::Repeat(RepeatedInstruction { number, layer: Some(moves), ..RepeatedInstruction::default() })
}

/// The command that ends sensing: the tool comes to rest.
pub(crate) const fn cancel_command<const A: usize>(layer: ToolLayer<'_>) -> HostCommand<A> {
    HostCommand::ManualOutput(OutputChange { channel: layer.fire, value: 0 })
}

/// The command that returns the tool to this layer.
pub(crate) fn return_command<const A: usize>(number: u32, layer: i32) -> HostCommand<A> {
    let moves = LayerMove::To { layer };
    HostCommand::Repeat(RepeatedInstruction { number, layer: Some(moves), ..RepeatedInstruction::default() })
}

/// Position of the sheet in mm where the test has ended over it.
pub(crate) fn sensed_mm<const A: usize>(
    layer: ToolLayer<'_>,
    mm_of: impl Fn(i64) -> f64,
    status: &CardStatus<A>,
) -> f64 {
    mm_of(status.counts[layer.index] + i64::from(status.layer)) - HEIGHT_MM
}
