//! The state of the interpreter on one path of a check, to be restored or joined with that of another path (PRB-18).
//!
//! Invariant: behind a join a value or mode is known only if it is the same on all joined paths. Joining makes values
//! unknown and never known again, so that repeated joins come to an end.

use crate::canon::BranchState;
use crate::compensation_queue::CompensationQueue;
use crate::loop_stack::LoopStack;
use crate::modal::ModalState;
use crate::modal_groups::SpindleRotation;
use crate::params::ParameterValues;
use crate::pose::Pose;
use crate::tool::Tool;
use crate::unknown::{UNKNOWN, UnknownModes, join};
use std::sync::Arc;

/// State of the interpreter, and of the loops around its line.
#[derive(Clone, Debug)]
pub(crate) struct PathState {
    pub(crate) modes: ModalState,
    pub(crate) parameters: ParameterValues,
    pub(crate) tools: Arc<Vec<Tool>>,
    pub(crate) loops: LoopStack,
}

impl PathState {
    /// Whether two states are the same, unknown values included. Saved states and materials are not compared.
    pub(crate) fn is_same(&self, other: &PathState) -> bool {
        let lengths = |state: &ModalState| {
            let poses = [state.origin, state.g92_offset, state.tool_offset, state.position];
            let values = [
                state.rotation_degrees,
                state.feed_rate,
                state.spindle_speed,
                state.max_spindle_speed,
                state.returned_value.unwrap_or_default(),
            ];
            (poses.map(|pose| pose.0.map(f64::to_bits)), values.map(f64::to_bits), state.unknown)
        };
        lengths(&self.modes) == lengths(&other.modes)
            && self.parameters.is_same(&other.parameters)
            && (Arc::ptr_eq(&self.tools, &other.tools) || format!("{:?}", self.tools) == format!("{:?}", other.tools))
    }
}

/// Joins poses coordinate by coordinate.
fn join_pose(pose: &mut Pose, other: &Pose) {
    pose.0.iter_mut().zip(other.0).for_each(|(value, other)| join(value, other));
}

impl ModalState {
    /// Joins this state with that of another branch.
    pub(crate) fn join(&mut self, other: &ModalState) {
        type M = UnknownModes;
        let mut unknown = self.unknown.union(other.unknown);
        if self.units != other.units {
            self.forget_lengths();
        }
        join_pose(&mut self.position, &other.position);
        join_pose(&mut self.origin, &other.origin);
        join_pose(&mut self.g92_offset, &other.g92_offset);
        join_pose(&mut self.tool_offset, &other.tool_offset);
        join(&mut self.rotation_degrees, other.rotation_degrees);
        join(&mut self.feed_rate, other.feed_rate);
        join(&mut self.spindle_speed, other.spindle_speed);
        join(&mut self.max_spindle_speed, other.max_spindle_speed);
        unknown.add(M::UNITS, self.units != other.units);
        unknown.add(M::MOTION, self.motion != other.motion);
        unknown.add(M::PLANE, self.plane != other.plane);
        unknown.add(M::DISTANCE, self.distance != other.distance);
        unknown.add(M::ARC_CENTRES, self.arc_centres != other.arc_centres);
        unknown.add(M::FEED_MODE, self.feed_mode != other.feed_mode);
        unknown.add(M::SYSTEM, self.coordinate_system != other.coordinate_system);
        unknown.add(M::RETRACT, self.retract_to_r != other.retract_to_r);
        let spindle = |state: &ModalState| (state.spindle, state.constant_surface_speed);
        unknown.add(M::SPINDLE, spindle(self) != spindle(other));
        let switches = |state: &ModalState| {
            [state.mist, state.flood, state.feed_override, state.speed_override, state.adaptive_feed, state.feed_hold]
        };
        unknown.add(M::SWITCHES, switches(self) != switches(other));
        unknown.add(M::SELECTED_TOOL, self.selected_tool != other.selected_tool);
        unknown.add(M::CURRENT_TOOL, self.current_tool != other.current_tool);
        unknown.add(M::LATHE_DIAMETER, self.lathe_diameter != other.lathe_diameter);
        unknown.add(M::SERIES, self.series != other.series);
        let spline = |state: &ModalState| (state.spline_direction, state.spline_order, state.control_points.len());
        unknown.add(M::SPLINE, spline(self) != spline(other) || self.control_points != other.control_points);
        unknown.add(M::SAVED, self.saved_states != other.saved_states);
        unknown.add(M::CUTTING, self.cutting != other.cutting || self.contour != other.contour);
        self.join_returned_value(other, &mut unknown);
        let compensation = |state: &ModalState| (state.compensation, state.has_left_compensation, state.tool_shift);
        let is_compensation_same = compensation(self) == compensation(other) && self.waiting == other.waiting;
        unknown.add(M::COMPENSATION, !is_compensation_same);
        self.unknown = unknown;
        if unknown.has(M::COMPENSATION) {
            self.forget_compensation();
        }
        self.has_probed |= other.has_probed;
    }

    fn join_returned_value(&mut self, other: &ModalState, unknown: &mut UnknownModes) {
        match (&mut self.returned_value, other.returned_value) {
            (Some(value), Some(other)) => join(value, other),
            (None, None) => {}
            (value, _) => {
                unknown.add(UnknownModes::RETURNED, true);
                *value = Some(UNKNOWN);
            }
        }
    }

    /// Makes all lengths unknown.
    fn forget_lengths(&mut self) {
        let all = Pose([UNKNOWN; 9]);
        (self.position, self.origin, self.g92_offset, self.tool_offset) = (all, all, all, all);
        (self.feed_rate, self.spindle_speed) = (UNKNOWN, UNKNOWN);
        self.tool_shift = None;
    }

    /// Makes cutter compensation unknown: moves are of unknown ends until G40.
    pub(crate) fn forget_compensation(&mut self) {
        self.unknown.add(UnknownModes::COMPENSATION, true);
        self.waiting = CompensationQueue::default();
        (self.compensation, self.has_left_compensation, self.tool_shift) = (None, false, None);
        self.position = Pose([UNKNOWN; 9]);
    }

    /// Makes everything unknown.
    pub(crate) fn forget_all(&mut self) {
        self.forget_lengths();
        self.forget_compensation();
        (self.rotation_degrees, self.max_spindle_speed) = (UNKNOWN, UNKNOWN);
        self.returned_value = Some(UNKNOWN);
        self.unknown = UnknownModes::ALL;
    }

    /// What the canonical functions before this state have set.
    pub(crate) fn branch_state(&self) -> BranchState {
        let is_unknown = self.unknown.has(UnknownModes::UNITS);
        BranchState {
            units: self.units,
            system: self.coordinate_system,
            origin: self.origin,
            rotation_degrees: self.rotation_degrees,
            g92_offset: self.g92_offset,
            tool_offset: self.tool_offset,
            position: if is_unknown { Pose([UNKNOWN; 9]) } else { self.position },
            feed_rate: self.feed_rate,
            feed_mode: (!self.unknown.has(UnknownModes::FEED_MODE)).then_some(self.feed_mode),
            spindle_speed: self.spindle_speed,
            max_spindle_speed: self.max_spindle_speed,
            spindle_turns: (!self.unknown.has(UnknownModes::SPINDLE))
                .then_some(self.spindle != SpindleRotation::Stopped),
        }
    }

    /// Whether a length in force, the feed or a mode is unknown.
    pub(crate) fn is_partly_unknown(&self) -> bool {
        let poses = [&self.position, &self.origin, &self.g92_offset, &self.tool_offset];
        !self.unknown.is_empty()
            || self.feed_rate.is_nan()
            || self.rotation_degrees.is_nan()
            || poses.iter().any(|pose| pose.0.iter().any(|value| value.is_nan()))
    }
}
