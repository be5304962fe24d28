//! One jerk-limited profile: the fastest motion between two states over a given distance (SMO-1).
//!
//! [`fastest`] is what planning along a path uses: it never runs backward. [`fastest_any_way`] solves the general case of one
//! axis, in which speeds and the distance have any sign. They share one closed form up to the root of a quartic.
//!
//! Invariant: a profile is seven phases of constant jerk, [+J, 0, −J, 0, −J, 0, +J], any of which may be empty; speed and
//! acceleration are continuous in it, and it never leaves the limits it was asked for. All units are mm and s along the path.
//!
//! ```
//! use retrace_motion::profile::{PathLimits, State, fastest, fastest_any_way};
//! let limits = PathLimits { v: 100.0, a: 1_000.0, j: 20_000.0 };
//! let rest = State::default();
//! let there = fastest(rest, rest, 10.0, limits).expect("a stop can always be left and reached");
//! let back = fastest_any_way(rest, rest, -10.0, limits).expect("so can it backward");
//! assert!((there.duration() - back.duration()).abs() < 1e-12);
//! assert!((back.end().s + 10.0).abs() < 1e-12);
//! ```

mod family;
mod solve;

pub use solve::{fastest, fastest_any_way};

/// Signs of the jerk in the seven phases.
pub(crate) const SIGNS: [f64; 7] = [1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0];

/// Place, speed and acceleration along the path, in mm, mm/s and mm/s².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State {
    /// Place, in mm.
    pub s: f64,
    /// Speed, in mm/s.
    pub v: f64,
    /// Acceleration, in mm/s².
    pub a: f64,
}

impl State {
    /// A state at place 0.
    pub const fn moving(v: f64, a: f64) -> Self {
        Self { s: 0.0, v, a }
    }

    /// The state `t` seconds later under constant jerk.
    #[inline]
    pub fn after(self, jerk: f64, t: f64) -> Self {
        Self {
            s: self.s + t * (self.v + t * (0.5 * self.a + t * jerk / 6.0)),
            v: self.v + t * (self.a + 0.5 * t * jerk),
            a: self.a + t * jerk,
        }
    }
}

/// Limits along the path, each above 0 and the same in both directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathLimits {
    /// Speed, in mm/s.
    pub v: f64,
    /// Acceleration, in mm/s².
    pub a: f64,
    /// Jerk, in mm/s³.
    pub j: f64,
}

impl PathLimits {
    /// The tighter of both, limit by limit.
    #[inline]
    pub(crate) fn tighter(self, other: Self) -> Self {
        Self { v: self.v.min(other.v), a: self.a.min(other.a), j: self.j.min(other.j) }
    }
}

/// Why two states cannot be connected over a distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Misfit {
    /// The target cannot be reached: it asks for more speed than the distance gives.
    TargetTooHigh,
    /// The start cannot be left: it has more speed than the distance can take away.
    StartTooHigh,
}

/// Seven phases from a start state at place 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Profile {
    /// Speed at the start, in mm/s.
    pub v0: f64,
    /// Acceleration at the start, in mm/s².
    pub a0: f64,
    /// Jerk of the first phase, in mm/s³; negative where the profile dips in place of rising.
    pub jerk: f64,
    /// Durations of the phases, in s, none negative.
    pub times: [f64; 7],
}

impl Profile {
    /// Duration in s.
    pub fn duration(&self) -> f64 {
        self.times.iter().sum()
    }

    /// The state at the start of phase `k`, which `state` comes to: while the speed is held there is no acceleration at all, and
    /// a rounding of it would grow with the square of the time.
    #[inline]
    fn entering(&self, k: usize, state: State) -> State {
        if k == 3 && self.times[3] > 0.0 { State { a: 0.0, ..state } } else { state }
    }

    /// The state at the start.
    pub const fn start(&self) -> State {
        State::moving(self.v0, self.a0)
    }

    /// The state `t` seconds after the start, held within the profile.
    pub fn at(&self, t: f64) -> State {
        let mut state = self.start();
        let mut left = t.max(0.0);
        for (k, (sign, &phase)) in SIGNS.iter().zip(&self.times).enumerate() {
            state = self.entering(k, state).after(sign * self.jerk, phase.min(left));
            left -= phase;
            if left <= 0.0 {
                break;
            }
        }
        state
    }

    /// The state at the end.
    pub fn end(&self) -> State {
        self.ends().last().unwrap_or(self.start())
    }

    /// The states at the ends of the phases.
    #[inline]
    pub(crate) fn ends(&self) -> impl Iterator<Item = State> + '_ {
        let mut state = self.start();
        (0..7).map(move |k| {
            state = self.entering(k, state).after(SIGNS[k] * self.jerk, self.times[k]);
            state
        })
    }

    /// The time at which place `s` is passed, by bisection: the place never falls in a profile.
    pub(crate) fn time_at(&self, s: f64) -> f64 {
        let (mut low, mut high) = (0.0, self.duration());
        for _ in 0..52 {
            let middle = 0.5 * (low + high);
            if self.at(middle).s < s { low = middle } else { high = middle }
        }
        low
    }

    /// Cuts at time `t`: what lies before, and what lies after it.
    pub(crate) fn cut(&self, t: f64) -> (Self, Self) {
        let (mut before, mut after) = (*self, *self);
        let mut left = t;
        for k in 0..7 {
            before.times[k] = self.times[k].min(left.max(0.0));
            after.times[k] = self.times[k] - before.times[k];
            left -= self.times[k];
        }
        let State { v, a, .. } = self.at(t);
        (after.v0, after.a0) = (v, a);
        (before, after)
    }

    /// The highest speed, and the places between which it is held.
    pub(crate) fn crest(&self) -> (f64, f64, f64) {
        let mut state = self.start();
        for (sign, &phase) in SIGNS.iter().zip(&self.times).take(3) {
            state = state.after(sign * self.jerk, phase);
        }
        (state.v, state.s, state.s + state.v * self.times[3])
    }
}
