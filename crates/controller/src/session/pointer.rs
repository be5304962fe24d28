//! *Pointer*: pauses the program and moves a cross laser or a camera over the place of the tool, or over where a
//! shifted start would pierce, so that the operator sees it before anything is lit (CUT-37, CUT-46).
//!
//! Invariant: it is a step of the pause, as *park* is; the pointer's output is on only while the axes stand there.

use retrace_link::{MotionCard, OutputChange};

use super::Session;
use super::pause_state::ManualMovePurpose;
use crate::dnc_events::DncStep;
use crate::jog_planner::JogRequest;
use crate::operator::CommandError;

const NO_POINTER: CommandError =
    CommandError::NotNow("the machine file has no pointer: [manual] pointer_mm = { x = 80, y = 0 }");

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Whether *pointer* may be requested.
    ///
    /// # Errors
    /// The machine file has no pointer.
    pub(super) fn require_pointer(&self) -> Result<(), CommandError> {
        if self.recovery.machine().setting_up.pointer_mm.is_empty() { Err(NO_POINTER) } else { Ok(()) }
    }

    /// Moves the pointer over the breakpoint, or where a shifted start would pierce. The program is paused, and nothing
    /// moves.
    pub(super) fn move_pointer(&mut self) -> Result<(), CommandError> {
        self.require_pointer()?;
        self.dnc.require_jog()?;
        let breakpoint = self.dnc.interruption.breakpoint().map(|latch| latch.counts);
        let machine = self.recovery.machine();
        let from = self.card.status().counts;
        let mut to = breakpoint.unwrap_or(from);
        if let Some(axes) = self.recovery.plane_axes() {
            for (axis, mm) in axes.into_iter().zip(self.recovery.lead.shift_mm) {
                to[axis] += self.counts_of_length(axis, mm);
            }
        }
        for &(axis, mm) in &machine.setting_up.pointer_mm {
            to[axis] -= self.counts_of_length(axis, mm);
        }
        if let Some(tool) = machine.setting_up.tool_axis {
            let plane = machine.setting_up.retract_mm.map_or(from[tool], |mm| machine.counts_of(tool, mm));
            to[tool] = plane.max(from[tool]);
        }
        for (axis, (from, to)) in self.dnc.axes.iter().zip(from.iter().zip(&to)) {
            let [low, high] = axis.soft_limits;
            if from != to && !(low..=high).contains(to) {
                return Err(CommandError::BeyondLimit(axis.letter));
            }
        }
        if from == to {
            self.pointer_arrives(false);
            return Ok(());
        }
        self.begin_manual_move(JogRequest::Approach { from, to }, ManualMovePurpose::Pointer)
    }

    fn counts_of_length(&self, axis: usize, mm: f64) -> i64 {
        (mm * self.dnc.axes[axis].pulses_per_mm).round() as i64
    }

    /// The axes are at rest where the pointer shows the place, or were stopped on the way.
    pub(super) fn pointer_arrives(&mut self, stopped: bool) {
        if !stopped {
            self.switch_pointer(true);
        }
        self.emit_dnc_step(DncStep::PointerThere { stopped });
    }

    /// Switches the output of the pointer, if it has one.
    pub(super) fn switch_pointer(&mut self, on: bool) {
        let Some(channel) = self.recovery.machine().setting_up.pointer_output else { return };
        let is_on = self.card.status().outputs.get(usize::from(channel)).is_some_and(|&value| value != 0);
        if on || is_on {
            // A card that has no such output switches nothing.
            let _ = self.send_manual_output(OutputChange { channel, value: i32::from(on) });
        }
    }
}
