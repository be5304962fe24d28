//! The peer: rsruckig, a port of Ruckig's community version (Berscheid and Kröger 2021).
//!
//! Invariant: it gets the same numbers as the solver under test, and its own tolerance is distinguished from ours.

use super::cases::Case;
use retrace_motion::profile::KinematicState;
use rsruckig::block::Block;
use rsruckig::position_third_step1::PositionThirdOrderStep1;
use rsruckig::prelude::*;

/// The peer with its memory, so that its timing includes no allocation.
pub(crate) struct Peer {
    solver: Ruckig<1, ThrowErrorHandler>,
    input: InputParameter<1>,
    path: Trajectory<1>,
    bare: PositionThirdOrderStep1,
    block: Block,
}

impl Peer {
    pub(crate) fn new() -> Self {
        let (mut input, path) = (InputParameter::new(None), Trajectory::new(None));
        input.synchronization = Synchronization::None;
        Self {
            solver: Ruckig::new(None, 0.001),
            input,
            path,
            bare: PositionThirdOrderStep1::default(),
            block: Block::default(),
        }
    }

    /// Sets the numbers of a case.
    pub(crate) fn set(&mut self, case: &Case) {
        let Self { input, .. } = self;
        input.current_velocity[0] = case.from.v;
        input.current_acceleration[0] = case.from.a;
        input.target_position[0] = case.length;
        input.target_velocity[0] = case.to.v;
        input.target_acceleration[0] = case.to.a;
        input.max_velocity[0] = case.limits.v;
        input.max_acceleration[0] = case.limits.a;
        input.max_jerk[0] = case.limits.j;
    }

    /// Solves the case: the duration in s, or the error of the peer.
    pub(crate) fn solve(&mut self) -> Result<f64, String> {
        match self.solver.calculate(&self.input, &mut self.path) {
            Ok(_) => Ok(self.path.get_duration()),
            Err(error) => Err(error.to_string()),
        }
    }

    /// State in which the phases of the last solution end.
    pub(crate) fn end(&self, case: &Case) -> KinematicState {
        let profile = &self.path.get_profiles()[0][0];
        let mut state = KinematicState { s: 0.0, ..case.from };
        for (jerk, t) in profile.j.iter().zip(profile.t) {
            state = KinematicState {
                s: state.s + t * (state.v + t * (0.5 * state.a + t * jerk / 6.0)),
                v: state.v + t * (state.a + 0.5 * t * jerk),
                a: state.a + t * jerk,
            };
        }
        state
    }

    /// Solves the case by the peer's solver alone, without checking the input or filling a trajectory; its duration in
    /// s.
    pub(crate) fn solve_bare(&mut self, case: &Case) -> Option<f64> {
        let Case { from, to, length, limits } = *case;
        let mut ends = Profile::default();
        ends.set_boundary(0.0, from.v, from.a, length, to.v, to.a);
        self.bare.reset(0.0, from.v, from.a, length, to.v, to.a, limits.v, -limits.v, limits.a, -limits.a, limits.j);
        self.bare.get_profile(&ends, &mut self.block).then_some(self.block.t_min)
    }
}
