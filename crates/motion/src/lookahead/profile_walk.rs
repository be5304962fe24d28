//! The state of a profile at places that increase.
//!
//! Invariant: places are found to a part in 10¹² of a millimetre.

use crate::profile::{KinematicState, Profile, SIGNS};

/// Iterator over a profile by place, forward only.
pub(super) struct ProfileWalk<'a> {
    profile: &'a Profile,
    phase: usize,
    state: KinematicState,
    phase_end: f64,
}

impl<'a> ProfileWalk<'a> {
    pub(super) fn new(profile: &'a Profile) -> Self {
        let mut walk = Self { profile, phase: 0, state: profile.start(), phase_end: 0.0 };
        walk.phase_end = walk.end_of_phase().s;
        walk
    }

    fn jerk(&self) -> f64 {
        SIGNS[self.phase] * self.profile.jerk
    }

    fn end_of_phase(&self) -> KinematicState {
        self.state.after(self.jerk(), self.profile.times[self.phase])
    }

    /// The state at place `s`, which must not decrease from call to call.
    pub(super) fn at(&mut self, s: f64) -> KinematicState {
        while self.phase < 6 && s > self.phase_end {
            self.state = self.end_of_phase();
            self.phase += 1;
            self.phase_end = self.end_of_phase().s;
        }
        let (jerk, longest) = (self.jerk(), self.profile.times[self.phase]);
        let distance = s - self.state.s;
        let mut t = if self.state.v > 0.0 { (distance / self.state.v).min(longest) } else { 0.5 * longest };
        for _ in 0..12 {
            let next_state = self.state.after(jerk, t);
            let error = next_state.s - s;
            if error.abs() < 1e-12 || next_state.v <= 0.0 {
                break;
            }
            t = (t - error / next_state.v).clamp(0.0, longest);
        }
        self.state.after(jerk, t)
    }
}
