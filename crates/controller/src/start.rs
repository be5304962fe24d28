//! Beginning in the middle of a program, at a line (`--start-line`).
//!
//! Invariant: what the skipped blocks switched holds before the first move, and that move begins where the skipped ones ended: the axes come
//! there in the order of DNC-6, tool axis up to the retract plane or higher, other axes, tool axis down.

use retrace_link::{Change, Outputs, channel};
use retrace_motion::{Arc, Feed, PathMode};

use crate::feed::{Cancelled, Feeder, Refused, Switch};
use crate::machine::Machine;
use crate::sink::Sink;

/// Takes what is skipped: switching is remembered, motion is not made.
#[derive(Debug)]
pub struct Skipped {
    outputs: Outputs,
}

impl Skipped {
    /// Nothing skipped yet; the outputs are as given.
    #[must_use]
    pub fn new(outputs: Outputs) -> Self {
        Self { outputs }
    }

    /// Brings a machine at rest to the state behind what was skipped: outputs first, then to `target_mm`, where the skipped
    /// motion ended, in the order of DNC-6 for this machine.
    ///
    /// # Errors
    /// What the planner refuses.
    pub fn restore<const A: usize>(
        &self,
        feeder: &mut Feeder<'_, A>,
        target_mm: [f64; A],
        machine: &Machine,
        line: u32,
    ) -> Result<(), Refused> {
        let first = [channel::TOOL, channel::SPEED, channel::SPINDLE, channel::MIST, channel::FLOOD];
        for channel in first.into_iter().chain(0..channel::DIGITAL as u8) {
            let value = self.outputs[usize::from(channel)];
            if value != feeder.outputs()[usize::from(channel)] {
                let (code, changes) = (code_of(channel, value), [Change { channel, value }]);
                feeder.exclusive(Switch { line, code, changes: &changes, ..Switch::default() })?;
            }
        }
        let at = feeder.commanded_mm();
        for end in ends_mm(machine, at, target_mm) {
            feeder.straight(end, Feed::Rapid, PathMode::ExactStop, line)?;
        }
        Ok(feeder.rest()?)
    }
}

/// The ends of the moves from one place to another, mm, as [`crate::approach`] orders them.
fn ends_mm<const A: usize>(machine: &Machine, at: [f64; A], target: [f64; A]) -> Vec<[f64; A]> {
    let tool = machine.tool_axis().filter(|&tool| tool < A);
    let others_move = (0..A).any(|axis| Some(axis) != tool && at[axis] != target[axis]);
    let (Some(tool), true) = (tool, others_move) else { return vec![target] };
    let height = at[tool].max(target[tool]).max(machine.setting_up.retract_mm.unwrap_or(f64::NEG_INFINITY));
    let (mut up, mut across) = (at, target);
    (up[tool], across[tool]) = (height, height);
    vec![up, across, target]
}

/// The code that brings a channel to a value.
fn code_of(channel: u8, value: i32) -> &'static str {
    match (channel, value) {
        (channel::TOOL, _) => "M6",
        (channel::SPEED, _) => "S",
        (channel::SPINDLE, 1) => "M3",
        (channel::SPINDLE, -1) => "M4",
        (channel::SPINDLE, _) => "M5",
        (channel::MIST, 1) => "M7",
        (channel::FLOOD, 1) => "M8",
        (channel::MIST | channel::FLOOD, _) => "M9",
        (_, 0) => "M65",
        _ => "M64",
    }
}

impl<const A: usize> Sink<A> for Skipped {
    fn straight(&mut self, _: [f64; A], _: Feed, _: PathMode, _: u32) -> Result<(), Refused> {
        Ok(())
    }

    fn arc(&mut self, _: &Arc<A>, _: Feed, _: PathMode, _: u32) -> Result<(), Refused> {
        Ok(())
    }

    fn action(&mut self, change: Change, _: u32) {
        self.outputs[usize::from(change.channel)] = change.value;
    }

    fn exclusive(&mut self, switch: Switch<'_>) -> Result<(), Cancelled> {
        for change in switch.changes {
            self.outputs[usize::from(change.channel)] = change.value;
        }
        Ok(())
    }

    fn message(&mut self, _: String, _: u32) -> Result<(), Cancelled> {
        Ok(())
    }
}
