//! Stops and the end of a program: M0, M1, M2, M30, M60.
//!
//! Invariant: after the end the modes are those of a new program, except for the units, the path control and the
//! offsets of G92.

use super::ProgramFlow;
use super::interpreter_core::{Core, Emitter};
use crate::canon::Canon;
use crate::canon_modes::{FeedMode, Plane};
use crate::diag::{BlockResult, Span};
use crate::modal_groups::{DistanceMode, MotionMode, SpindleRotation};
use crate::params::{COORDINATE_SYSTEM, system_origin};

impl Core {
    pub(super) fn stop(&mut self, code: u8, at: Span, emit: &mut Emitter<'_>) -> BlockResult<ProgramFlow> {
        self.finish_path(at, emit)?;
        match code {
            0 => emit.call(Canon::ProgramStop),
            1 => emit.call(Canon::OptionalProgramStop),
            60 => {
                emit.call(Canon::PalletShuttle);
                emit.call(Canon::ProgramStop);
            }
            _ => {
                self.end_program(code == 30, emit);
                return Ok(ProgramFlow::ProgramEnd);
            }
        }
        Ok(ProgramFlow::Continue)
    }

    fn end_program(&mut self, shuttle: bool, emit: &mut Emitter<'_>) {
        self.state.position = self.position_in_system(1);
        let first = system_origin(1);
        let (origin, rotation) = (self.pose_parameter(first), self.parameters.get(first + 9));
        self.parameters.set(COORDINATE_SYSTEM, 1.0);
        let state = &mut self.state;
        (state.coordinate_system, state.origin, state.rotation_degrees) = (1, origin, rotation);
        emit.call(Canon::SetG5xOffset { system: 1, offset: origin });
        emit.call(Canon::SetXyRotation(rotation));
        if state.plane != Plane::Xy {
            state.plane = Plane::Xy;
            emit.call(Canon::SelectPlane(Plane::Xy));
        }
        (state.compensation, state.has_left_compensation, state.tool_shift) = (None, false, None);
        state.distance = DistanceMode::Absolute;
        state.feed_mode = FeedMode::UnitsPerMinute;
        state.feed_rate = 0.0;
        emit.call(Canon::SetFeedMode(FeedMode::UnitsPerMinute));
        emit.call(Canon::SetFeedRate(0.0));
        if !std::mem::replace(&mut state.feed_override, true) {
            emit.call(Canon::EnableFeedOverride);
        }
        if !std::mem::replace(&mut state.speed_override, true) {
            emit.call(Canon::EnableSpeedOverride);
        }
        state.spindle = SpindleRotation::Stopped;
        emit.call(Canon::StopSpindleTurning(0));
        self.end_cutting(emit);
        let state = &mut self.state;
        state.constant_surface_speed = false;
        state.max_spindle_speed = 0.0;
        emit.call(Canon::SetSpindleMode(0.0));
        (state.motion, state.series) = (Some(MotionMode::Feed), None);
        if std::mem::take(&mut state.mist) {
            emit.call(Canon::MistOff);
        }
        if std::mem::take(&mut state.flood) {
            emit.call(Canon::FloodOff);
        }
        if shuttle {
            emit.call(Canon::PalletShuttle);
        }
        emit.call(Canon::ProgramEnd);
    }
}
