//! Blocks with words, positions or modes that a check does not know (PRB-17).
//!
//! Invariant: what a block leaves known is what it leaves in every run. Errors are reported only for what is known. A
//! motion whose way cannot be calculated is emitted as [`Canon::UnknownMotion`].

use super::ProgramFlow;
use super::block_motion::{AXES, BlockMotion};
use super::check;
use super::interpreter_core::{Core, Emitter};
use crate::block::{Words, letters};
use crate::canon::{BranchStart, Canon, CanonStep};
use crate::canon_modes::FeedMode;
use crate::diag::{BlockError, BlockResult, Span};
use crate::error_codes::ErrorCode;
use crate::groups::{GroupG, GroupM};
use crate::loop_stack::LoopStack;
use crate::modal_groups::{DistanceMode, MotionMode};
use crate::params::G28_HOME;
use crate::path_state::PathState;
use crate::pose::{Axis, Pose};
use crate::unknown::{UNKNOWN, UnknownModes};

/// Modes that the way of a move depends on.
const MODES_OF_MOVES: UnknownModes = UnknownModes::PLANE
    .union(UnknownModes::UNITS)
    .union(UnknownModes::DISTANCE)
    .union(UnknownModes::ARC_CENTRES)
    .union(UnknownModes::FEED_MODE)
    .union(UnknownModes::RETRACT)
    .union(UnknownModes::SERIES)
    .union(UnknownModes::SPLINE)
    .union(UnknownModes::COMPENSATION);

/// Words that belong to a motion, besides the axis words.
const WORDS_OF_MOTIONS: &[u8] = b"ijkrdehlpq";

impl super::Interpreter {
    /// Returns a copy of the state of the current path.
    pub(crate) fn path_state(&self, loops: LoopStack) -> PathState {
        PathState {
            modes: self.core.state.clone(),
            parameters: self.core.parameters.values(),
            tools: self.core.tools.data(),
            loops,
        }
    }

    /// Replaces the state by that of another path, and returns its loops.
    pub(crate) fn restore_path(&mut self, state: PathState) -> LoopStack {
        self.core.state = state.modes;
        self.core.parameters.restore(state.parameters);
        self.core.tools.restore(state.tools);
        state.loops
    }

    /// Joins the state with that of another path.
    pub(crate) fn join_path(&mut self, state: &PathState) {
        self.core.state.join(&state.modes);
        self.core.parameters.join(&state.parameters);
        self.core.tools.join(&state.tools);
    }

    /// Returns two states joined; the current one stays.
    pub(crate) fn join_states(&mut self, state: PathState, other: &PathState) -> PathState {
        let current = self.path_state(LoopStack::default());
        let loops = self.restore_path(state);
        self.join_path(other);
        let joined = self.path_state(loops);
        self.restore_path(current);
        joined
    }

    /// Sets the return value of a subprogram before it is left.
    pub(crate) fn set_returned_value(&mut self, value: Option<f64>) {
        self.core.state.returned_value = value;
        self.core.state.unknown.remove(UnknownModes::RETURNED);
    }

    /// Makes everything unknown: modes, positions, parameters and tools.
    pub(crate) fn forget_all(&mut self) {
        self.core.state.forget_all();
        self.core.parameters.forget_all();
        self.core.tools.forget();
    }

    /// Reports that a code, a number or a target is unknown, and makes everything that it may change unknown.
    pub(crate) fn forget_effects(&mut self, what: &str, at: Span, steps: &mut Vec<CanonStep>) {
        let message = format!("{what} depends on an answer of the machine, so that its effect is unknown to a check");
        self.report(BlockError::new(ErrorCode::UnknownEffect, at, message));
        self.core.state.forget_all();
        self.core.parameters.forget_from(G28_HOME);
        self.core.tools.forget();
        let state = Some(self.core.state.branch_state());
        let branch = Canon::FollowBranch(Box::new(BranchStart { is_certain: self.is_path_certain, state }));
        steps.push(CanonStep { line: self.step_line, number: None, canon: branch });
    }

    /// Makes all numbered parameters unknown: one of them was assigned to, and it is unknown which.
    pub(super) fn forget_numbered(&mut self, at: Span) {
        let message = "the number of the parameter depends on an answer of the machine: all numbered parameters are \
                       unknown to a check from here on";
        self.report(BlockError::new(ErrorCode::UnknownEffect, at, message));
        self.core.parameters.forget_from(1);
    }

    /// Records for [`Self::forget_effects`] whether the program comes here whatever the machine answers.
    pub(crate) fn set_path_certain(&mut self, is_certain: bool) {
        self.is_path_certain = is_certain;
    }

    /// Whether the values of the block, or the state that it begins in, are partly unknown.
    pub(super) fn is_block_unknown(&self) -> bool {
        self.core.follows_unknown && (self.last_words().is_partly_unknown() || self.core.state.is_partly_unknown())
    }

    /// Executes the block that was read and calculated, with unknown values or in an unknown state.
    pub(super) fn execute_unknown_block(&mut self, steps: &mut Vec<CanonStep>) -> BlockResult<ProgramFlow> {
        let mut words = self.last_words().clone();
        if let Some((what, at)) = self.core.unknown_effect(&words) {
            self.forget_effects(what, at, steps);
            return Ok(ProgramFlow::Continue);
        }
        if words.has(b'x') && self.core.uses_diameters(&words) {
            words.halve_x();
        }
        const INCREMENTS: u32 = letters(b"uw");
        if words.has_any_of(INCREMENTS) {
            match self.draws_profile {
                true => self.core.add_increments(&mut words)?,
                false => self.reader.check_increments(&words)?,
            }
        }
        self.core.learn_modes(&words);
        self.core.forget_words(&mut words);
        let motion = self.core.motion_of_unknown(&words)?;
        let mut waiting = std::mem::take(&mut self.core.state.waiting);
        let (line, number) = (self.step_line, self.reader.block.number);
        let mut emit = Emitter { line, number, steps: &mut *steps, waiting: &mut waiting, warning: None };
        self.core.emit_comment(&self.reader, self.line, &mut emit)?;
        let flow = match motion {
            Ok(motion) => self.core.execute(&words, motion, &mut emit),
            Err(motion) => self.core.execute_unknown_motion(&words, motion, &mut emit),
        };
        self.core.forget_feed(&words, &mut emit);
        let warning = emit.warning;
        self.core.state.waiting = waiting;
        self.core.release_contour(steps);
        if self.core.state.unknown.has(UnknownModes::COMPENSATION) {
            self.core.state.forget_compensation();
        }
        if let Some(warning) = warning {
            self.report(*warning);
        }
        if words.has_any(AXES) && self.has_modal() {
            self.move_unknown(steps);
        }
        flow
    }

    /// Makes the way of the cycle in the block unknown.
    pub(crate) fn forget_series(&mut self) {
        self.core.state.unknown.add(UnknownModes::SERIES, true);
    }

    /// Emits a motion of unknown way to an unknown end.
    pub(crate) fn move_unknown(&mut self, steps: &mut Vec<CanonStep>) {
        self.core.state.position = Pose([UNKNOWN; 9]);
        let canon = Canon::UnknownMotion(self.core.state.position);
        steps.push(CanonStep { line: self.step_line, number: self.reader.block.number, canon });
    }

    /// Whether a cycle cannot be run: its arguments, or the state that it begins in, are partly unknown.
    pub(crate) fn is_cycle_unknown(&self, arguments: impl Iterator<Item = f64>) -> bool {
        self.core.follows_unknown && (self.core.state.is_partly_unknown() || arguments.into_iter().any(f64::is_nan))
    }

    /// Whether any state that a subprogram may read is unknown.
    pub(crate) fn is_state_unknown(&self) -> bool {
        self.core.follows_unknown && (self.core.state.is_partly_unknown() || self.core.parameters.has_unknown())
    }
}

impl Core {
    /// Returns the code or word of a block whose effect is unknown as a whole.
    fn unknown_effect(&self, words: &Words) -> Option<(&'static str, Span)> {
        if words.has_unknown_code {
            return Some(("the number of a code", Span::default()));
        }
        let is_dwell = words.g(GroupG::NonModal) == Some(40);
        let numbers: &[u8] = if is_dwell { b"dehlqt$" } else { b"dehlpqt$" };
        if let Some(&letter) = numbers.iter().find(|&&letter| words.has_unknown(&[letter])) {
            return Some(("the value of this word", words.span(letter)));
        }
        let unknown = self.state.unknown;
        if unknown.has(UnknownModes::SYSTEM) && words.g(GroupG::NonModal) == Some(100) {
            return Some(("the coordinate system in force", words.g_span(GroupG::NonModal)));
        }
        if unknown.has(UnknownModes::SAVED) && words.m(GroupM::Spindle) == Some(72) {
            return Some(("the saved state", words.m_span(GroupM::Spindle)));
        }
        None
    }

    /// Makes the feed unknown where a move may have set it: with G93 it follows from the length of the way.
    fn forget_feed(&mut self, words: &Words, emit: &mut Emitter<'_>) {
        let is_inverse =
            self.state.unknown.has(UnknownModes::FEED_MODE) || self.state.feed_mode == FeedMode::InverseTime;
        if is_inverse && (words.has_any(AXES) || words.has_any(b"ijkf")) {
            self.state.feed_rate = UNKNOWN;
            emit.call(Canon::SetFeedRate(UNKNOWN));
        }
    }

    /// Removes the modes that the block sets from those that are unknown.
    fn learn_modes(&mut self, words: &Words) {
        type M = UnknownModes;
        let unknown = &mut self.state.unknown;
        let saves = matches!(words.m(GroupM::Spindle), Some(70 | 73));
        unknown.add(M::SAVED, saves && !unknown.is_empty());
        let groups = [
            (GroupG::Plane, M::PLANE),
            (GroupG::Units, M::UNITS),
            (GroupG::Distance, M::DISTANCE),
            (GroupG::ArcCentres, M::ARC_CENTRES),
            (GroupG::FeedMode, M::FEED_MODE),
            (GroupG::CoordinateSystem, M::SYSTEM),
            (GroupG::Retract, M::RETRACT),
            (GroupG::LatheDiameter, M::LATHE_DIAMETER),
            (GroupG::Motion, M::MOTION),
        ];
        if unknown.has(M::SYSTEM) && words.g(GroupG::CoordinateSystem).is_some() {
            // It equals none, so that the new one is loaded.
            self.state.coordinate_system = 0;
        }
        for (group, modes) in groups {
            if words.g(group).is_some() {
                unknown.remove(modes);
            }
        }
        if words.g(GroupG::CutterCompensation) == Some(400) {
            unknown.remove(M::COMPENSATION);
        }
        if words.has(b't') {
            unknown.remove(M::SELECTED_TOOL);
        }
        match words.m(GroupM::Tool) {
            Some(6) if !unknown.has(M::SELECTED_TOOL) => unknown.remove(M::CURRENT_TOOL),
            Some(6) => unknown.add(M::CURRENT_TOOL, true),
            Some(_) => unknown.remove(M::CURRENT_TOOL),
            None => {}
        }
    }

    /// Makes the values of words unknown whose meaning depends on an unknown mode.
    fn forget_words(&self, words: &mut Words) {
        let unknown = self.state.unknown;
        if unknown.has(UnknownModes::UNITS) {
            words.forget(b"xyzabcuvwijkrf@");
        }
        if unknown.has(UnknownModes::DISTANCE) {
            words.forget(b"xyzabcuvw@^");
        }
        if unknown.has(UnknownModes::LATHE_DIAMETER) {
            words.forget(b"x");
        }
        if unknown.has(UnknownModes::FEED_MODE) {
            words.forget(b"f");
        }
    }

    /// Returns the motion of the block, or, as an error, the motion whose way cannot be calculated.
    fn motion_of_unknown(&self, words: &Words) -> BlockResult<Result<BlockMotion, Option<MotionMode>>> {
        let unknown = self.state.unknown;
        let owns_axes = matches!(words.g(GroupG::NonModal), Some(100 | 280 | 300 | 520 | 920))
            || matches!(words.g(GroupG::ToolOffset), Some(431 | 432));
        let is_modal = words.g(GroupG::Motion).is_none() && !owns_axes;
        if unknown.has(UnknownModes::MOTION) && is_modal && (words.has_any(AXES) || words.has_any(b"ijk")) {
            return Ok(Err(None));
        }
        let motion = check::determine_motion(words, &self.state)?;
        check::words_have_uses(words, motion)?;
        let is_straight = matches!(motion, BlockMotion::Move(MotionMode::Traverse | MotionMode::Feed));
        let is_free = self.state.compensation.is_none() && !unknown.has(UnknownModes::COMPENSATION);
        Ok(match motion {
            BlockMotion::None | BlockMotion::Cancel => Ok(motion),
            BlockMotion::Move(MotionMode::Probe(_)) => Ok(motion),
            _ if is_straight && is_free && !words.has_any(b"@^") => Ok(motion),
            _ if !self.is_way_unknown(words) => Ok(motion),
            BlockMotion::Move(motion) => Err(Some(motion)),
            BlockMotion::Turn(_) => Err(None),
        })
    }

    /// Whether the way of a motion with these words depends on anything unknown.
    fn is_way_unknown(&self, words: &Words) -> bool {
        let state = &self.state;
        let is_unknown = |pose: &Pose| pose.0.iter().any(|value| value.is_nan());
        state.unknown.has(MODES_OF_MOVES)
            || is_unknown(&state.position)
            || state.feed_rate.is_nan()
            || words.is_partly_unknown()
            || words.g(GroupG::NonModal) == Some(530) && is_unknown(&state.machine_position())
    }

    /// Executes the codes of the block, and a motion whose way is unknown.
    fn execute_unknown_motion(
        &mut self,
        words: &Words,
        motion: Option<MotionMode>,
        emit: &mut Emitter<'_>,
    ) -> BlockResult<ProgramFlow> {
        let mut codes = words.clone();
        for &letter in AXES {
            codes.remove(letter);
        }
        if words.g(GroupG::NonModal).is_none() && words.g(GroupG::CutterCompensation).is_none() {
            WORDS_OF_MOTIONS.iter().for_each(|&letter| codes.remove(letter));
        }
        let flow = self.execute(&codes, BlockMotion::None, emit)?;
        let end = self.end_of_unknown(words, motion);
        if let Some(MotionMode::SpindleFeed | MotionMode::ThreadingCycle | MotionMode::RigidTap) = motion {
            // A machine without an encoder refuses these, whatever their ends are.
            emit.call(Canon::StartSpeedFeedSynch { pitch: UNKNOWN, start_degrees: UNKNOWN });
        }
        emit.call(Canon::UnknownMotion(end));
        self.state.position = end;
        if self.state.compensation.is_some() {
            emit.waiting.clear();
            self.state.forget_compensation();
        }
        let unknown = &mut self.state.unknown;
        unknown.add(UnknownModes::SERIES, true);
        unknown.add(UnknownModes::SPLINE, true);
        match motion {
            Some(motion) => self.state.motion = Some(motion),
            None => unknown.add(UnknownModes::MOTION, true),
        }
        let is_spline = motion.is_none_or(|motion| {
            use MotionMode::{ControlPoint, CubicSpline, EndOfPoints, QuadraticSpline};
            matches!(motion, CubicSpline | QuadraticSpline | ControlPoint | EndOfPoints)
        });
        unknown.add(UnknownModes::MOTION, is_spline);
        Ok(flow)
    }

    /// Returns the end of a motion whose way is unknown.
    fn end_of_unknown(&self, words: &Words, motion: Option<MotionMode>) -> Pose {
        let mut end = self.end_of(words);
        match motion {
            Some(motion) if motion.is_arc() && !words.has_any(b"@^") => {}
            Some(MotionMode::Traverse | MotionMode::Feed) if !words.has_any(b"@^") => {}
            Some(MotionMode::Cycle(_)) if self.state.distance == DistanceMode::Absolute => {
                for axis in self.state.plane.axes() {
                    if axis == self.state.plane.axes()[2] || !words.has(axis.letter().to_ascii_lowercase()) {
                        end[axis] = UNKNOWN;
                    }
                }
            }
            _ => end = Pose([UNKNOWN; 9]),
        }
        let unknown = self.state.unknown;
        if unknown.has(UnknownModes::COMPENSATION.union(UnknownModes::PLANE)) {
            end = Pose([UNKNOWN; 9]);
        }
        end
    }

    /// Whether the cutter to be compensated, or the position where that begins, is unknown.
    pub(super) fn is_cutter_unknown(&self, words: &Words) -> bool {
        let state = &self.state;
        let modes = MODES_OF_MOVES.union(UnknownModes::CURRENT_TOOL);
        let has_unknown_tool = || {
            let tools = self.tools.tools();
            tools.into_iter().any(|tool| tool.diameter.is_nan() || tool.orientation.is_nan())
        };
        self.follows_unknown
            && (state.unknown.has(modes)
                || state.position.0.iter().any(|value| value.is_nan())
                || words.has_unknown(b"d")
                || has_unknown_tool())
    }

    /// Makes the answers of a probing move unknown, and the position on the axes that it moves.
    pub(super) fn forget_probed(&mut self, start: &Pose, end: &Pose) {
        let first = crate::params::PROBE_POSITION;
        (first..first + 9).for_each(|number| self.parameters.set(number, UNKNOWN));
        self.parameters.set(crate::params::PROBE_TRIPPED, UNKNOWN);
        let mut position = *end;
        for axis in Axis::ALL {
            if start[axis].to_bits() != end[axis].to_bits() {
                position[axis] = UNKNOWN;
            }
        }
        self.state.position = position;
    }
}
