//! A place on a profile that moves forward by time or by distance.
//!
//! Invariant: time and place never decrease; a time belongs to its place to the rounding of an f64, but near rest.

use super::{KinematicState, Profile, SIGNS};

/// Most steps in which the time of a place is found. Most places take four.
const ROUNDS: usize = 60;

/// Forward cursor over one profile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ProfileCursor {
    profile: Profile,
    phase: usize,
    /// Start of the phase, s, and the state there.
    since: f64,
    start: KinematicState,
}

impl ProfileCursor {
    /// Cursor at the start of `profile`.
    pub(crate) fn new(profile: &Profile) -> Self {
        Self { profile: *profile, phase: 0, since: 0.0, start: profile.start() }
    }

    fn within(&self, t: f64) -> KinematicState {
        if self.profile.growth != 0.0 {
            self.start.after_growth(self.profile.growth, t)
        } else {
            self.start.after(SIGNS[self.phase] * self.profile.jerk, t)
        }
    }

    fn next_phase(&mut self) {
        let duration = self.profile.times[self.phase];
        let end = self.within(duration);
        self.since += duration;
        self.phase += 1;
        self.start = self.profile.entering(self.phase, end);
    }

    /// Whether a phase with some duration follows.
    fn has_next(&self) -> bool {
        self.profile.times[self.phase + 1..].iter().any(|&t| t > 0.0)
    }

    /// Moves to time `t` and returns the state there.
    pub(crate) fn seek_time(&mut self, t: f64) -> KinematicState {
        while self.has_next() && t >= self.since + self.profile.times[self.phase] {
            self.next_phase();
        }
        self.within((t - self.since).clamp(0.0, self.profile.times[self.phase]))
    }

    /// Moves to place `s` and returns the time there.
    pub(crate) fn seek_place(&mut self, s: f64) -> f64 {
        while self.has_next() && s >= self.within(self.profile.times[self.phase]).s {
            self.next_phase();
        }
        let (mut low, mut high) = (0.0, self.profile.times[self.phase]);
        let mut t = if self.start.v > 0.0 { ((s - self.start.s) / self.start.v).min(high) } else { 0.5 * high };
        for _ in 0..ROUNDS {
            let state = self.within(t);
            if state.s < s {
                low = t;
            } else {
                high = t;
            }
            let next = t - (state.s - s) / state.v;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - t).abs() <= 1e-15 * (1.0 + t) {
                break;
            }
            t = next;
        }
        self.since + t.max(0.0)
    }
}
