//! Coordinate systems, offsets and reference points: G10 L2 and L20, G28, G30, G52, G92 and their variants.
//!
//! Invariant: only G28 and G30 move the machine; the other codes change the position in program coordinates.

use super::interpreter_core::{Core, Emitter};
use super::modes::given_axes;
use crate::angle::rotate;
use crate::block::Words;
use crate::canon::Canon;
use crate::diag::BlockResult;
use crate::params::{G28_HOME, G30_HOME, G92_ACTIVE, G92_OFFSET, system_origin};
use crate::pose::{Axis, Pose};

impl Core {
    /// Executes the codes of group 0 except G4 and G53, which are executed elsewhere.
    pub(super) fn non_modal(&mut self, code: u16, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        match code {
            100 => match words.get(b'l') {
                Some(0.0) => return self.reload_tools(words.span(b'l'), emit),
                Some(1.0 | 10.0 | 11.0) => return self.set_tool_data(words, emit),
                _ => self.set_coordinate_system(words, emit),
            },
            280 => self.go_home(G28_HOME, words, emit),
            300 => self.go_home(G30_HOME, words, emit),
            281 => self.store_home(G28_HOME),
            301 => self.store_home(G30_HOME),
            520 | 920 => self.set_g92(code == 520, words, emit),
            921 | 922 => self.clear_g92(code == 921, emit),
            923 => self.restore_g92(emit),
            _ => {}
        }
        Ok(())
    }

    /// Returns the current position in another coordinate system.
    pub(super) fn position_in_system(&self, system: u8) -> Pose {
        let state = &self.state;
        let mut point = state.position.plus(&state.g92_offset);
        (point[Axis::X], point[Axis::Y]) = rotate(point[Axis::X], point[Axis::Y], state.rotation_degrees);
        let first = system_origin(system);
        point = point.plus(&state.origin).minus(&self.pose_parameter(first));
        (point[Axis::X], point[Axis::Y]) = rotate(point[Axis::X], point[Axis::Y], -self.parameters.get(first + 9));
        if self.parameters.get(G92_ACTIVE) != 0.0 { point.minus(&self.pose_parameter(G92_OFFSET)) } else { point }
    }

    /// Converts machine coordinates to program coordinates. The tool offset does not apply to rotary axes here, as in
    /// LinuxCNC.
    pub(super) fn relative(&self, machine: &Pose) -> Pose {
        let state = &self.state;
        let mut point = *machine;
        for axis in Axis::ALL {
            point[axis] -= state.origin[axis];
            if !matches!(axis, Axis::X | Axis::Y) {
                point[axis] -= state.g92_offset[axis];
            }
            if !axis.is_rotary() {
                point[axis] -= state.tool_offset[axis];
            }
        }
        (point[Axis::X], point[Axis::Y]) = rotate(point[Axis::X], point[Axis::Y], -state.rotation_degrees);
        point[Axis::X] -= state.g92_offset[Axis::X];
        point[Axis::Y] -= state.g92_offset[Axis::Y];
        point
    }

    /// Executes G10 L2, which sets the origin of a coordinate system, and G10 L20, which sets the origin that makes the
    /// current position the given one.
    fn set_coordinate_system(&mut self, words: &Words, emit: &mut Emitter<'_>) {
        let system = match words.get(b'p').unwrap_or_default().round() as u8 {
            0 => self.state.coordinate_system,
            system => system,
        };
        let active = system == self.state.coordinate_system;
        let first = system_origin(system);
        let here = self.position_in_system(system);
        if let Some(rotation) = words.get(b'r') {
            self.parameters.set(first + 9, rotation);
        }
        let rotation = self.parameters.get(first + 9);
        let old = self.pose_parameter(first);
        let origin = if words.get(b'l') == Some(20.0) {
            self.origin_for(words, &here, &old, rotation)
        } else {
            given_axes(words, &old, |_, given| given)
        };
        for axis in Axis::ALL {
            if words.has(axis.letter().to_ascii_lowercase()) || (words.get(b'l') == Some(20.0) && (axis as u8) < 2) {
                self.parameters.set(first + axis as usize, self.to_machine_unit(axis, origin[axis]));
            }
        }
        if !active {
            emit.call(Canon::Note("interpreter: setting coordinate system origin"));
            return;
        }
        let state = &mut self.state;
        // The offset of G92 rotates with the system. LinuxCNC omits this and then has a wrong machine position.
        let turning = if rotation == state.rotation_degrees { Pose::ZERO } else { state.g92_offset };
        let mut point = state.position.plus(&turning);
        (point[Axis::X], point[Axis::Y]) = rotate(point[Axis::X], point[Axis::Y], state.rotation_degrees);
        point = point.plus(&state.origin).minus(&origin);
        state.origin = origin;
        emit.call(Canon::SetG5xOffset { system, offset: origin });
        (point[Axis::X], point[Axis::Y]) = rotate(point[Axis::X], point[Axis::Y], -rotation);
        state.position = point.minus(&turning);
        state.rotation_degrees = rotation;
        emit.call(Canon::SetXyRotation(rotation));
    }

    /// Returns the origin for which the position `here` of a system becomes the given one.
    fn origin_for(&self, words: &Words, here: &Pose, old: &Pose, rotation: f64) -> Pose {
        let wanted = given_axes(words, here, |_, given| given);
        let mut origin = *old;
        let (here_x, here_y) = rotate(here[Axis::X], here[Axis::Y], rotation);
        let (wanted_x, wanted_y) = rotate(wanted[Axis::X], wanted[Axis::Y], rotation);
        origin[Axis::X] = here_x + old[Axis::X] - wanted_x;
        origin[Axis::Y] = here_y + old[Axis::Y] - wanted_y;
        for axis in &Axis::ALL[2..] {
            if words.has(axis.letter().to_ascii_lowercase()) {
                origin[*axis] = here[*axis] + old[*axis] - wanted[*axis];
            }
        }
        origin
    }

    /// Executes G28 and G30: through the given point to the reference point, on the given axes or, without any, on all.
    fn go_home(&mut self, first: usize, words: &Words, emit: &mut Emitter<'_>) {
        self.state.tool_shift = None;
        let way = self.end_of(words);
        emit.call(Canon::StraightTraverse(way));
        self.state.position = way;
        let home = self.relative(&self.pose_parameter(first));
        let end = if words.has_any(super::block_motion::AXES) {
            let mut end = way;
            for axis in Axis::ALL {
                if words.has(axis.letter().to_ascii_lowercase()) {
                    end[axis] = home[axis];
                }
            }
            end
        } else {
            home
        };
        emit.call(Canon::MachineCoordinates);
        emit.call(Canon::StraightTraverse(end));
        self.state.position = end;
    }

    /// Executes G28.1 and G30.1: stores the machine's position as the reference point.
    fn store_home(&mut self, first: usize) {
        let state = &self.state;
        let sum = state.position.plus(&state.tool_offset).plus(&state.origin).plus(&state.g92_offset);
        let point = if state.rotation_degrees == 0.0 { sum } else { state.machine_position() };
        self.set_pose_parameter(first, &point);
    }

    /// Executes G52, which sets the given offset, and G92, which sets the offset that makes the current position the
    /// given one.
    fn set_g92(&mut self, is_g52: bool, words: &Words, emit: &mut Emitter<'_>) {
        self.parameters.set(G92_ACTIVE, 1.0);
        let state = &mut self.state;
        for axis in Axis::ALL {
            let Some(given) = words.get(axis.letter().to_ascii_lowercase()) else { continue };
            if is_g52 {
                state.position[axis] += state.g92_offset[axis] - given;
                state.g92_offset[axis] = given;
            } else {
                state.g92_offset[axis] = state.position[axis] + state.g92_offset[axis] - given;
                state.position[axis] = given;
            }
        }
        let offset = state.g92_offset;
        emit.call(Canon::SetG92Offset(offset));
        self.set_pose_parameter(G92_OFFSET, &offset);
    }

    /// Executes G92.1 and G92.2: removes the offset; the first also clears its parameters.
    fn clear_g92(&mut self, forget: bool, emit: &mut Emitter<'_>) {
        self.parameters.set(G92_ACTIVE, 0.0);
        self.state.position = self.state.position.plus(&self.state.g92_offset);
        self.state.g92_offset = Pose::ZERO;
        emit.call(Canon::SetG92Offset(Pose::ZERO));
        if forget {
            self.set_pose_parameter(G92_OFFSET, &Pose::ZERO);
        }
    }

    /// Executes G92.3: restores the offset from the parameters.
    fn restore_g92(&mut self, emit: &mut Emitter<'_>) {
        self.parameters.set(G92_ACTIVE, 1.0);
        let stored = self.pose_parameter(G92_OFFSET);
        self.state.position = self.state.position.plus(&self.state.g92_offset).minus(&stored);
        self.state.g92_offset = stored;
        emit.call(Canon::SetG92Offset(stored));
    }
}
