//! Parking for a change of consumables: *park* pauses the program and moves the axes to the park position, *change
//! done* brings them back (CUT-34, DNC-3 … DNC-7).
//!
//! Invariant: both are steps of the pause; the axes move up, across and down, and the way back ends at the breakpoint.

use retrace_core::interruption::InterruptionError;
use retrace_link::MotionCard;

use super::Session;
use super::pause_state::ManualMovePurpose;
use crate::dnc_events::DncStep;
use crate::jog_planner::JogRequest;
use crate::operator::{CommandError, OperatorCommand};

const NO_PARK_POSITION: CommandError =
    CommandError::NotNow("the machine file has no park position: [manual] park_mm = { x = 0, y = 0 }");

impl<const A: usize, C: MotionCard<A>> Session<'_, A, C> {
    /// Counts of the park position; an axis that it does not name stays, the tool axis at its retract plane or higher.
    fn park_counts(&self) -> Option<[i64; A]> {
        let machine = self.recovery.machine();
        let setup = &machine.setting_up;
        let mut to = self.card.status().counts;
        for (axis, count) in to.iter_mut().enumerate().take(machine.axes.len()) {
            match setup.park_mm.get(axis).copied().flatten() {
                Some(mm) => *count = machine.counts_of(axis, mm),
                None if setup.tool_axis == Some(axis) => {
                    let plane = setup.retract_mm.map_or(*count, |mm| machine.counts_of(axis, mm));
                    *count = plane.max(*count);
                }
                None => {}
            }
        }
        setup.park_mm.iter().any(Option::is_some).then_some(to)
    }

    /// Whether *park* may be requested.
    ///
    /// # Errors
    /// The machine file has no park position.
    pub(super) fn require_park_position(&self) -> Result<(), CommandError> {
        self.park_counts().map(|_| ()).ok_or(NO_PARK_POSITION)
    }

    /// Moves the axes to the park position. The program is paused, and nothing moves.
    pub(super) fn move_to_park(&mut self) -> Result<(), CommandError> {
        let to = self.park_counts().ok_or(NO_PARK_POSITION)?;
        self.dnc.require_jog()?;
        let from = self.card.status().counts;
        if from == to {
            self.emit_dnc_step(DncStep::Parked { stopped: false });
            return Ok(());
        }
        self.begin_manual_move(JogRequest::Approach { from, to }, ManualMovePurpose::Park)
    }

    /// Performs the steps of the spindle that are left where the spindle is a cutter: it is off in a pause anyway, so
    /// that nobody has to stop and start it.
    pub(super) fn arm_cutter(&mut self) {
        use OperatorCommand::{Online, SpindleStart, SpindleStop};
        let left: [&[OperatorCommand]; 2] = [&[SpindleStart, Online], &[SpindleStop, SpindleStart, Online]];
        let missing = left.into_iter().find(|steps| self.dnc.are_in_order(steps));
        for &step in missing.iter().flat_map(|steps| steps.iter()).filter(|&&step| step != Online) {
            // The order was checked; a step that is refused all the same leaves `online` to be refused.
            let _ = self.perform_step(step);
        }
    }

    /// Requests the steps that are left of the return to the breakpoint. A spindle that is stopped is started; a cutter
    /// is only armed.
    pub(super) fn finish_change(&mut self) -> Result<(), CommandError> {
        use OperatorCommand::{CycleStart, Online, SpindleStart, SpindleStop};
        let returns: [&[OperatorCommand]; 4] = [
            &[CycleStart],
            &[Online, CycleStart],
            &[SpindleStart, Online, CycleStart],
            &[SpindleStop, SpindleStart, Online, CycleStart],
        ];
        let missing = returns.into_iter().find(|steps| self.dnc.are_in_order(steps));
        let steps = missing.ok_or(InterruptionError::NotPaused)?;
        if steps.first() == Some(&SpindleStop) && !self.spindle_is_a_cutter() {
            return Err(InterruptionError::SpindleRunning.into());
        }
        self.dnc.queue_steps(steps);
        Ok(())
    }
}
