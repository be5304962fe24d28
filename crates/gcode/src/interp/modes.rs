//! G codes that set a mode.
//!
//! Invariant: they are executed in a fixed order (dwell, plane, units, tool offset, coordinate system, path control,
//! distance, retract), and before any code that uses coordinates.

use super::interpreter_core::{Core, Emitter};
use super::unsupported;
use crate::block::Words;
use crate::canon::Canon;
use crate::canon_modes::{FeedMode, LengthUnit, PathControl, Plane};
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::groups::GroupG;
use crate::modal_groups::{ArcCentres, DistanceMode};
use crate::params::{COORDINATE_SYSTEM, system_origin};
use crate::pose::{Axis, Pose};
use crate::unknown::{UNKNOWN, UnknownModes};

impl Core {
    /// Executes G93, G94, G95.
    pub(super) fn set_feed_mode(&mut self, code: u16, emit: &mut Emitter<'_>) {
        if code == 930 {
            emit.call(Canon::Note("interpreter: feed mode set to inverse time"));
            self.state.feed_mode = FeedMode::InverseTime;
            emit.call(Canon::SetFeedMode(FeedMode::InverseTime));
        } else {
            let (mode, note) = match code {
                940 => (FeedMode::UnitsPerMinute, "interpreter: feed mode set to units per minute"),
                _ => (FeedMode::UnitsPerRevolution, "interpreter: feed mode set to units per revolution"),
            };
            emit.call(Canon::Note(note));
            self.state.feed_mode = mode;
            emit.call(Canon::SetFeedMode(mode));
            self.state.feed_rate = 0.0;
            emit.call(Canon::SetFeedRate(0.0));
        }
    }

    /// Executes all G codes except the motions.
    pub(super) fn g_codes(&mut self, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        if words.g(GroupG::NonModal) == Some(40) {
            emit.call(Canon::Dwell(words.get(b'p').unwrap_or_default()));
        }
        if let Some(code) = words.g(GroupG::Plane) {
            self.state.plane = match code {
                170 => Plane::Xy,
                180 => Plane::Zx,
                190 => Plane::Yz,
                171 => Plane::Uv,
                181 => Plane::Wu,
                _ => Plane::Vw,
            };
            emit.call(Canon::SelectPlane(self.state.plane));
        }
        if let Some(code) = words.g(GroupG::Units) {
            self.set_units(if code == 200 { LengthUnit::Inch } else { LengthUnit::Millimetre }, emit);
        }
        if let Some(code) = words.g(GroupG::LatheDiameter) {
            self.set_lathe_diameter(code == 70, emit);
        }
        if let Some(code) = words.g(GroupG::CutterCompensation) {
            self.set_compensation(code, words, emit)?;
        }
        if self.state.compensation.is_some() {
            unsupported::settings(words, &self.state)?;
        }
        if let Some(code) = words.g(GroupG::ToolOffset) {
            self.set_tool_offset(code, words, emit)?;
        }
        if let Some(code) = words.g(GroupG::CoordinateSystem) {
            self.select_coordinate_system(code, emit);
        }
        if let Some(code) = words.g(GroupG::PathControl) {
            self.set_path_control(code, words, emit);
        }
        self.set_distances(words, emit);
        match words.g(GroupG::NonModal) {
            Some(code) => self.non_modal(code, words, emit),
            None => Ok(()),
        }
    }

    /// Executes G20 and G21: converts all lengths of the state.
    pub(super) fn set_units(&mut self, units: LengthUnit, emit: &mut Emitter<'_>) {
        emit.call(Canon::UseLengthUnits(units));
        let state = &mut self.state;
        if units == state.units {
            return;
        }
        // One multiplication by this factor, as in LinuxCNC: an inverse factor would round differently.
        let factor = if units == LengthUnit::Inch { 1.0 / 25.4 } else { 25.4 };
        state.units = units;
        state.position = state.position.scaled_lengths(factor);
        state.origin = state.origin.scaled_lengths(factor);
        state.g92_offset = state.g92_offset.scaled_lengths(factor);
        state.tool_offset = state.tool_offset.scaled_lengths(factor);
        state.tool_shift = state.tool_shift.map(|shift| shift.scaled_lengths(factor));
        if let Some(compensation) = &mut state.compensation {
            compensation.scale(factor);
            emit.waiting.scale(factor);
        }
        state.feed_rate *= factor;
        state.naivecam_tolerance *= factor;
        if let Some(series) = &mut state.series {
            series.scale_lengths(factor);
        }
        state.spline_direction.0 *= factor;
        state.spline_direction.1 *= factor;
        for point in &mut state.control_points {
            (point.x, point.y) = (point.x * factor, point.y * factor);
        }
        if let PathControl::Continuous { tolerance } = &mut state.path_control {
            *tolerance *= factor;
        }
    }

    /// Whether the X word of a block is a diameter.
    pub(super) fn uses_diameters(&self, words: &Words) -> bool {
        words.g(GroupG::LatheDiameter).map_or(self.state.lathe_diameter, |code| code == 70)
    }

    /// Executes G7 and G8.
    fn set_lathe_diameter(&mut self, diameter: bool, emit: &mut Emitter<'_>) {
        if self.state.lathe_diameter == diameter {
            return;
        }
        self.state.lathe_diameter = diameter;
        emit.call(Canon::Note(if diameter {
            "interpreter: Lathe diameter mode changed to diameter"
        } else {
            "interpreter: Lathe diameter mode changed to radius"
        }));
    }

    /// Executes G43, G43.1, G43.2 and G49. The machine does not move, so the position changes by the change of the
    /// offset.
    fn set_tool_offset(&mut self, code: u16, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let old = self.state.tool_offset;
        let new = match code {
            430 if self.state.unknown.has(UnknownModes::CURRENT_TOOL) && !words.has(b'h') => Pose([UNKNOWN; 9]),
            430 => {
                let number = words.get(b'h').unwrap_or(self.state.current_tool.into());
                self.lengths_to_program(&self.tool(number, words, b'h')?.offset)
            }
            431 => given_axes(words, &old, |_, given| given),
            432 => self.added_offset(words, &old)?,
            _ => Pose::ZERO,
        };
        emit.call(Canon::UseToolLengthOffset(new));
        let change = old.minus(&new);
        let (x, y) = crate::angle::rotate(change[Axis::X], change[Axis::Y], -self.state.rotation_degrees);
        let mut turned = change;
        (turned[Axis::X], turned[Axis::Y]) = (x, y);
        self.state.position = self.state.position.plus(&turned);
        self.state.tool_offset = new;
        Ok(())
    }

    /// Returns the offset of G43.2: that of a tool, or given lengths, added to the offset in force.
    fn added_offset(&self, words: &Words, old: &Pose) -> BlockResult<Pose> {
        let at = words.g_span(GroupG::ToolOffset);
        match (words.get(b'h'), words.first_of(super::block_motion::AXES)) {
            (Some(_), Some(_)) => fault(ErrorCode::TwoUseAxes, at, "G43.2 accepts an H word or axis words, not both"),
            (Some(number), None) => Ok(old.plus(&self.lengths_to_program(&self.tool(number, words, b'h')?.offset))),
            (None, Some(_)) => Ok(given_axes(words, old, |old, given| old + given)),
            (None, None) => fault(ErrorCode::WordMissing, at, "G43.2 needs an H word or axis words"),
        }
    }

    /// Executes G54 … G59.3.
    fn select_coordinate_system(&mut self, code: u16, emit: &mut Emitter<'_>) {
        let system = match code {
            591..=593 => code - 584,
            _ => code / 10 - 53,
        } as u8;
        if system == self.state.coordinate_system {
            emit.call(Canon::Note("interpreter: continuing to use same coordinate system"));
            return;
        }
        self.state.position = self.position_in_system(system);
        self.state.coordinate_system = system;
        self.parameters.set(COORDINATE_SYSTEM, system.into());
        let first = system_origin(system);
        self.state.origin = self.pose_parameter(first);
        self.state.rotation_degrees = self.parameters.get(first + 9);
        emit.call(Canon::SetG5xOffset { system, offset: self.state.origin });
        emit.call(Canon::SetG92Offset(self.state.g92_offset));
        emit.call(Canon::SetXyRotation(self.state.rotation_degrees));
    }

    /// Executes G61, G61.1 and G64. A tolerance below 0 counts as none, and Q defaults to P.
    fn set_path_control(&mut self, code: u16, words: &Words, emit: &mut Emitter<'_>) {
        let given = |letter| words.get(letter).filter(|tolerance| *tolerance >= 0.0);
        let tolerance = given(b'p').unwrap_or_default();
        self.state.path_control = match code {
            610 => PathControl::ExactPath,
            611 => PathControl::ExactStop,
            _ => PathControl::Continuous { tolerance },
        };
        emit.call(Canon::SetMotionControlMode(self.state.path_control));
        if code == 640 {
            self.state.naivecam_tolerance = given(b'q').unwrap_or(tolerance);
            emit.call(Canon::SetNaivecamTolerance(self.state.naivecam_tolerance));
        }
    }

    /// Executes G90, G91, G90.1, G91.1, G98 and G99.
    fn set_distances(&mut self, words: &Words, emit: &mut Emitter<'_>) {
        let state = &mut self.state;
        if let Some(code) = words.g(GroupG::Distance) {
            let (distance, note) = match code {
                900 => (DistanceMode::Absolute, "interpreter: distance mode changed to absolute"),
                _ => (DistanceMode::Incremental, "interpreter: distance mode changed to incremental"),
            };
            if distance != state.distance {
                emit.call(Canon::Note(note));
                state.distance = distance;
            }
        }
        if let Some(code) = words.g(GroupG::ArcCentres) {
            let (centres, note) = match code {
                901 => (ArcCentres::Absolute, "interpreter: IJK distance mode changed to absolute"),
                _ => (ArcCentres::Incremental, "interpreter: IJK distance mode changed to incremental"),
            };
            if centres != state.arc_centres {
                emit.call(Canon::Note(note));
                state.arc_centres = centres;
            }
        }
        if let Some(code) = words.g(GroupG::Retract) {
            state.retract_to_r = code == 990;
            emit.call(Canon::Note(match code {
                990 => "interpreter: retract mode set to r_plane",
                _ => "interpreter: retract mode set to old_z",
            }));
        }
    }
}

/// Returns a pose in which the axes of the block are changed.
pub(super) fn given_axes(words: &Words, old: &Pose, change: impl Fn(f64, f64) -> f64) -> Pose {
    let mut new = *old;
    for axis in Axis::ALL {
        if let Some(given) = words.get(axis.letter().to_ascii_lowercase()) {
            new[axis] = change(old[axis], given);
        }
    }
    new
}
