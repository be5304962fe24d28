//! State that blocks leave for the blocks after them: from one MDI block to the next, and from all of them to a
//! program.
//!
//! Invariant: the receiver is between two blocks and outside of all calls: no compensated path, no collected points and
//! no cycle of MCALL is passed on. A program receives only the parameters that a parameter file stores, the tool table,
//! and the tool in the spindle, so that its meaning never depends on modes that are not visible in it.

use crate::canon::Canon;
use crate::canon_modes::{FeedMode, PathControl, Plane};
use crate::compensation_queue::CompensationQueue;
use crate::modal::ModalState;
use crate::params::{Names, Parameters};
use crate::pose::Pose;
use crate::tool::ToolTable;

/// Modal state, parameters and tools between two blocks.
#[derive(Clone, Debug)]
pub struct ModalSnapshot {
    pub(crate) state: ModalState,
    pub(crate) parameters: Parameters,
    pub(crate) tools: ToolTable,
    pub(crate) names: Names,
}

impl ModalSnapshot {
    pub(crate) fn new(
        mut state: ModalState,
        parameters: &Parameters,
        tools: &ToolTable,
        names: &Names,
    ) -> ModalSnapshot {
        (state.compensation, state.has_left_compensation, state.waiting) = (None, false, CompensationQueue::default());
        state.tool_shift = None;
        (state.call_level, state.returned_value) = (0, None);
        state.saved_states.clear();
        state.control_points.clear();
        ModalSnapshot { state, parameters: parameters.clone(), tools: tools.clone(), names: names.clone() }
    }

    /// Returns the modal state.
    #[must_use]
    pub fn state(&self) -> &ModalState {
        &self.state
    }

    /// Returns the parameters.
    #[must_use]
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Returns the tools.
    #[must_use]
    pub fn tools(&self) -> &ToolTable {
        &self.tools
    }

    /// Replaces parameters and tools. The offsets in force are derived from them when the next block is read.
    #[must_use]
    pub fn with_tables(mut self, parameters: Parameters, tools: ToolTable) -> Self {
        (self.parameters, self.tools) = (parameters, tools);
        self.state.g92_offset = Pose::ZERO;
        self
    }

    /// Emits the canonical functions that lead from the state at program start to this state. Units, coordinate systems
    /// and the offset of G92 have been emitted already.
    pub(crate) fn announce(state: &ModalState, initial: &ModalState, mut tell: impl FnMut(Canon)) {
        if state.plane != Plane::Xy {
            tell(Canon::SelectPlane(state.plane));
        }
        if state.tool_offset != Pose::ZERO {
            tell(Canon::UseToolLengthOffset(state.tool_offset));
        }
        if state.path_control != initial.path_control || state.naivecam_tolerance != initial.naivecam_tolerance {
            tell(Canon::SetMotionControlMode(state.path_control));
            if matches!(state.path_control, PathControl::Continuous { .. }) {
                tell(Canon::SetNaivecamTolerance(state.naivecam_tolerance));
            }
        }
        if state.feed_mode != FeedMode::UnitsPerMinute {
            tell(Canon::SetFeedMode(state.feed_mode));
        }
        if state.feed_rate != 0.0 {
            tell(Canon::SetFeedRate(state.feed_rate));
        }
        if state.constant_surface_speed {
            tell(Canon::SetSpindleMode(state.max_spindle_speed));
            tell(Canon::SetSpindleSpeed(state.spindle_speed));
        }
    }
}

/// Initial data of a program that are not in its text: parameters, tools, and the tool in the spindle.
#[derive(Clone, Debug, PartialEq)]
pub struct StartTables {
    /// Parameters, offsets among them.
    pub parameters: Parameters,
    /// Tool table.
    pub tools: ToolTable,
    /// Tool in the spindle; 0 is none.
    pub current_tool: u32,
    /// Tool of the last T word; 0 is none.
    pub selected_tool: u32,
}
