//! The sense test while no program runs (CUT-57).
//!
//! Invariant: no output is switched on; *hold*, *stop* and *cutter off* end it, and the tool returns to where it was.

use retrace_config::{NumberedError, ToolLayer};
use retrace_link::{CutterOff, HostCommand, MotionCard};

use super::perform::{ManualRunner, ManualTaskDone, ManualTaskError};
use crate::event::EventKind;
use crate::manual_move::REPORT_LATENCY_PERIODS;
use crate::sense_outcome::SenseOutcome;
use crate::session::{cancel_command, return_command, sense_command, sensed_mm};

fn refuse(what: impl Into<String>, remedy: &str) -> NumberedError {
    NumberedError::new("E2161", what.into(), remedy.to_owned())
}

impl<const A: usize, C: MotionCard<A>> ManualRunner<'_, '_, A, C> {
    /// Senses the sheet, and returns the tool.
    pub(super) fn sense_test(&mut self) -> Result<ManualTaskDone, ManualTaskError> {
        let machine = self.machine;
        let Some(layer) = machine.tool_layer() else {
            return Err(refuse("the machine file has no `sense` in a [[cutter]]", "give its contacts").into());
        };
        let is_closed = |input: u8| self.card.status().inputs >> (input & 15) & 1 == 1;
        let mut collisions = machine.cutters.iter().flat_map(|cutter| &cutter.collision).copied();
        if layer.contacts().any(is_closed) || collisions.any(is_closed) {
            let what = "a contact of the sheet, or a collision input of the cutter, is active";
            return Err(refuse(what, "lift the tool, check the input").into());
        }
        self.begin()?;
        let path_mm = machine.axes[layer.index].mm_of(self.card.status().counts[layer.index]);
        let refused = |_| refuse("the card does not sense the sheet", "try again with the machine at rest");
        self.card.send(sense_command(1, layer, path_mm)).map_err(refused)?;
        let outcome = self.sense(layer)?;
        self.emit(EventKind::SenseTest { axis: machine.axes[layer.index].name, outcome });
        self.return_tool(layer)?;
        match outcome {
            SenseOutcome::Found { .. } => Ok(ManualTaskDone::Completed { cut_short: false }),
            SenseOutcome::Cancelled => Ok(ManualTaskDone::Stopped),
            _ => Err(refuse(outcome.text(machine.axes[layer.index].name), "then test again").into()),
        }
    }

    /// Waits until the sheet is found, or is not.
    fn sense(&mut self, layer: ToolLayer<'_>) -> Result<SenseOutcome, ManualTaskError> {
        let axis = &self.machine.axes[layer.index];
        loop {
            self.run_period()?;
            let status = *self.card.status();
            if let Some(CutterOff { channels: 0, cause, .. }) = status.cutter_off {
                return Ok(SenseOutcome::without_sheet(cause));
            }
            if status.repeated == 1 {
                return Ok(SenseOutcome::Found { mm: sensed_mm(layer, |pulses| axis.mm_of(pulses), &status) });
            }
            if std::mem::take(&mut self.stopped) {
                // never refused
                let _ = self.card.send(cancel_command(layer));
            }
        }
    }

    /// Returns the tool to where it was, once it is at rest.
    fn return_tool(&mut self, layer: ToolLayer<'_>) -> Result<(), ManualTaskError> {
        let settled = if self.run_mode.wall_time { REPORT_LATENCY_PERIODS } else { 2 };
        let mut rested = 0;
        while rested < settled {
            self.run_period()?;
            rested = if self.card.status().at_rest { rested + 1 } else { 0 };
        }
        let number = self.card.status().repeated.wrapping_add(1);
        let refused = |_| refuse("the card does not return the tool", "jog it up");
        self.card.send(return_command(number, 0)).map_err(refused)?;
        while self.card.status().repeated != number {
            self.run_period()?;
        }
        // A sheet that was not found blocks motion.
        let _ = self.card.send(HostCommand::Restart { last: number });
        debug_assert_eq!(self.card.status().layer, 0, "axis {}", layer.index);
        self.begin()
    }
}
