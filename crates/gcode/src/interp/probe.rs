//! Probing: G38.2 to G38.5.
//!
//! Invariant: a probing move whose probe must trip has a length above zero; G38.3 and G38.5 without one ask for the
//! probe's state. Without a machine, the result is unknown, or assumed to be that of
//! LinuxCNC's stand-alone interpreter: the end was reached without contact, and the tool retracted by a hundredth of an
//! inch.

use super::interpreter_core::{Core, Emitter};
use crate::block::Words;
use crate::canon::Canon;
use crate::canon_modes::{LengthUnit, Probing};
use crate::diag::{BlockResult, fault};
use crate::error_codes::ErrorCode;
use crate::modal_groups::MotionMode;
use crate::params::{PROBE_POSITION, PROBE_TRIPPED};
use crate::pose::{Axis, Pose};

impl Core {
    pub(super) fn probe(&mut self, probing: Probing, words: &Words, emit: &mut Emitter<'_>) -> BlockResult<()> {
        let at = words.first_of(super::block_motion::AXES).map_or_else(Default::default, |letter| words.span(letter));
        if self.state.feed_rate == 0.0 {
            return fault(ErrorCode::ZeroFeed, at, "probing needs a feed rate, and none is set");
        }
        let (start, end) = (self.state.position, self.end_of(words));
        let has_no_way = start == end && probing.must_trip;
        if has_no_way && self.state.has_probed {
            // The tool position is an assumed result; with the machine's own result, the move has a length.
            return Ok(());
        }
        if has_no_way {
            return fault(ErrorCode::ProbeNowhere, at, ErrorCode::ProbeNowhere.title());
        }
        emit.call(Canon::TurnProbeOn);
        emit.call(Canon::StraightProbe(end, probing));
        emit.call(Canon::TurnProbeOff);
        self.state.motion = Some(MotionMode::Probe(probing));
        if self.follows_unknown {
            self.forget_probed(&start, &end);
            return Ok(());
        }
        for axis in Axis::ALL {
            self.parameters.set(PROBE_POSITION + axis as usize, end[axis]);
        }
        self.parameters.set(PROBE_TRIPPED, 0.0);
        self.state.has_probed = true;
        self.state.position = self.retreated(&start, &end);
        Ok(())
    }

    /// Replaces the assumed result of the last probing move by the machine's: positions in program coordinates and
    /// units (PRB-8).
    pub(super) fn resolve_probe(&mut self, touch: &Pose, rest: &Pose, touched: bool) {
        for axis in Axis::ALL {
            self.parameters.set(PROBE_POSITION + axis as usize, touch[axis]);
        }
        self.parameters.set(PROBE_TRIPPED, f64::from(u8::from(touched)));
        self.state.position = *rest;
        self.state.has_probed = false;
    }

    /// Returns the tool position after a probing move that has reached its end.
    fn retreated(&self, start: &Pose, end: &Pose) -> Pose {
        let retreat = match self.state.units {
            LengthUnit::Inch => 0.01,
            LengthUnit::Millimetre => 0.254,
        };
        let [x, y, z] = [Axis::X, Axis::Y, Axis::Z].map(|axis| start[axis] - end[axis]);
        let length = (x * x + y * y + z * z).sqrt();
        let mut position = *end;
        if length != 0.0 {
            for (axis, distance) in [(Axis::X, x), (Axis::Y, y), (Axis::Z, z)] {
                position[axis] += retreat * (distance / length);
            }
        }
        position
    }
}
