//! Paths of a check that depend on the answers of the machine (PRB-17, PRB-18).
//!
//! Invariant: an unknown coordinate is a NaN here too. Only sinks of a check receive one, because only a check executes
//! a program whose answers are unknown.

use retrace_gcode::{Axis, BranchStart, FeedMode, Pose};

use super::CanonExecutor;
use super::tool_height::LayerState;
use crate::canon_error::CanonError;
use crate::cutter_track::CutterTrack;
use crate::motion_sink::MotionSink;

/// Maximum distance in mm between two positions that counts as none: the offsets are added in another order.
const SAME_MM: f64 = 1e-9;

impl CanonExecutor<'_> {
    /// A motion whose way is not known.
    pub(super) fn unknown_motion<const A: usize>(
        &mut self,
        end: &Pose,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let position = self.machine_position(end);
        sink.unknown_motion(self.machine_coordinates(&position)?, line);
        self.record_move_end(position, &position);
        Ok(())
    }

    /// The end of a probing move that no machine has answered. The position is unknown on the axes that have moved.
    pub(super) fn forget_probed<const A: usize>(&mut self, end: &Pose, sink: &mut impl MotionSink<A>) {
        let mut rest = *end;
        for axis in Axis::ALL {
            if (end[axis] - self.at[axis]).abs() > SAME_MM {
                rest[axis] = f64::NAN;
            }
        }
        self.record_move_end(rest, &rest);
        sink.set_position(self.position());
    }

    /// The path of a check continues elsewhere, or behind a branch. Which cutters are on there is not followed.
    pub(super) fn follow_branch<const A: usize>(&mut self, branch: &BranchStart, sink: &mut impl MotionSink<A>) {
        sink.set_certain(branch.is_certain);
        let Some(state) = &branch.state else { return };
        (self.unit, self.system, self.to_machine_coordinates) = (state.units, state.system, false);
        self.g5x = self.in_mm(&state.origin);
        self.g92 = self.in_mm(&state.g92_offset);
        self.tool = self.in_mm(&state.tool_offset);
        self.rotation_deg = state.rotation_degrees;
        self.rotation = state.rotation_degrees.to_radians().sin_cos();
        let feed_mm = state.feed_rate * state.units.millimetres();
        self.follow_surface_speed(state.max_spindle_speed, state.spindle_speed);
        self.spindle_turns = state.spindle_turns;
        self.feed_mm_per_turn = (state.feed_mode == Some(FeedMode::UnitsPerRevolution)).then_some(feed_mm);
        self.set_feed(if state.feed_mode.is_none() { f64::NAN } else { feed_mm });
        let position = self.machine_position(&state.position);
        self.record_move_end(position, &position);
        self.cutters = CutterTrack::new(self.machine);
        (self.layer, self.sensed_at) = (LayerState::Zero, None);
        sink.set_position(self.position());
    }
}
