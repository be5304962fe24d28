//! Changes of the tool table by a program: G10 L0, L1, L10 and L11.
//!
//! Invariant: only the words of the block are changed. The tool offset in force stays until the next G43.

use super::interpreter_core::{Core, Emitter};
use crate::angle::rotate;
use crate::block::Words;
use crate::canon::Canon;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;
use crate::eval::to_whole_number;
use crate::params::system_origin;
use crate::pose::{Axis, Pose};
use crate::tool::Tool;

/// Coordinate system of the tool setting fixture: G59.3.
const FIXTURE: u8 = 9;

/// Checks that a G10 with L1, L10 or L11 has the words that it needs.
pub(super) fn check(words: &Words, at: Span) -> BlockResult<()> {
    let Some(number) = words.get(b'p') else {
        return fault(ErrorCode::WordMissing, at, "G10 needs a P word: the tool");
    };
    if to_whole_number(number, words.span(b'p'), "P")? < 1 {
        return fault(ErrorCode::BadP, words.span(b'p'), "tool numbers of the table begin at 1");
    }
    if words.has(b'k') {
        return fault(ErrorCode::WordUnused, words.span(b'k'), "G10 does not accept a K word");
    }
    if !words.has_any(b"xyzabcuvwrijq") {
        return fault(
            ErrorCode::WordMissing,
            at,
            "G10 L1, L10 and L11 need something to set: axis words, R, I, J or Q",
        );
    }
    Ok(())
}

impl Core {
    /// Executes G10 L0.
    pub(super) fn reload_tools(&mut self, at: Span, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let loaded = self.state.current_tool;
        if loaded != 0 {
            let message = format!("tool {loaded} is in the spindle, and G10 L0 needs an empty spindle");
            return fault(ErrorCode::ToolLoaded, at, message);
        }
        emit.call(Canon::ReloadToolData);
        Ok(())
    }

    /// Executes G10 L1, which sets the given offset; L10, which sets the offset that makes the current position the
    /// given one; and L11, which does the same in the fixture's system, without the offset of G52 and G92.
    pub(super) fn set_tool_data(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let mut tool = self.tool(words.get(b'p').unwrap_or_default(), words, b'p')?;
        if let Some(orientation) = words.get(b'q') {
            let place = words.span(b'q');
            if !(0..=9).contains(&to_whole_number(orientation, place, "Q")?) {
                return fault(ErrorCode::BadToolOrientation, place, format!("there is no orientation {orientation}"));
            }
        }
        let offset = match words.get(b'l') {
            Some(1.0) => super::modes::given_axes(words, &self.lengths_to_program(&tool.offset), |_, given| given),
            l => self.offset_for(words, &tool, l == Some(11.0)),
        };
        for axis in Axis::ALL {
            let turns_too = words.get(b'l') != Some(1.0) && (axis as u8) < 2 && words.has_any(b"xy");
            if turns_too || words.has(axis.letter().to_ascii_lowercase()) {
                tool.offset[axis] = self.to_machine_unit(axis, offset[axis]);
            }
        }
        if let Some(radius) = words.get(b'r') {
            tool.diameter = self.to_machine_unit(Axis::X, 2.0 * radius);
        }
        tool.front_angle = words.get(b'i').unwrap_or(tool.front_angle);
        tool.back_angle = words.get(b'j').unwrap_or(tool.back_angle);
        tool.orientation = words.get(b'q').map_or(tool.orientation, f64::round);
        self.tools.insert(tool);
        let index = self.tools.index_of(tool.number);
        emit.call(Canon::SetToolTableEntry { index, tool });
        if self.state.current_tool == tool.number {
            emit.call(Canon::SetToolTableEntry { index: 0, tool });
        }
        Ok(())
    }

    fn offset_for(&self, words: &Words, tool: &Tool, in_fixture: bool) -> Pose {
        let state = &self.state;
        let (origin, g92, degrees) = if in_fixture {
            let first = system_origin(FIXTURE);
            (self.pose_parameter(first), Pose::ZERO, self.parameters.get(first + 9))
        } else {
            (state.origin, state.g92_offset, state.rotation_degrees)
        };
        let turned = |mut pose: Pose| {
            (pose[Axis::X], pose[Axis::Y]) = rotate(pose[Axis::X], pose[Axis::Y], -degrees);
            pose
        };
        let here = turned(state.machine_position().minus(&origin)).minus(&g92);
        let mut offset = turned(self.lengths_to_program(&tool.offset));
        for axis in Axis::ALL {
            if let Some(given) = words.get(axis.letter().to_ascii_lowercase()) {
                offset[axis] = here[axis] - given;
            }
        }
        (offset[Axis::X], offset[Axis::Y]) = rotate(offset[Axis::X], offset[Axis::Y], degrees);
        offset
    }
}
