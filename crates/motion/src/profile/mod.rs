//! One jerk-limited profile: the fastest motion between two states over a given distance (SMO-1).
//!
//! [`fastest`] plans along a path and never runs backward. [`fastest_any_way`] solves the general case of one axis, in
//! which speeds and the distance have any sign. They share one closed form up to the root of a quartic. [`SpeedSearch`]
//! is the speed search of the source (SMO-8). [`whole_periods`] slows a run between two stops down to whole periods
//! (SMO-9).
//!
//! Invariant: a profile is seven phases of constant jerk, [+J, 0, −J, 0, −J, 0, +J], any of which may be empty; speed
//! and acceleration are continuous in it, and it never leaves its limits. All units are mm and s along the path.
//!
//! # Examples
//!
//! ```
//! use retrace_motion::profile::{KinematicState, PathLimits, fastest, fastest_any_way};
//! let limits = PathLimits { v: 100.0, a: 1_000.0, j: 20_000.0 };
//! let rest = KinematicState::default();
//! let forward = fastest(rest, rest, 10.0, limits).expect("a profile from rest to rest always exists");
//! let back = fastest_any_way(rest, rest, -10.0, limits).expect("backward too");
//! assert!((forward.duration() - back.duration()).abs() < 1e-12);
//! assert!((back.end().s + 10.0).abs() < 1e-12);
//! ```

mod fit;
mod profile_cursor;
mod profile_shape;
mod search;
mod solve;

pub use fit::whole_periods;
pub(crate) use fit::{lengthened, slowed};
pub(crate) use profile_cursor::ProfileCursor;
pub use search::{SearchOutcome, SearchStep, SearchTrack, SearchVariant, SpeedSearch};
pub use solve::{fastest, fastest_any_way};
use std::fmt;

/// Signs of the jerk in the seven phases.
pub(crate) const SIGNS: [f64; 7] = [1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0];

/// Place, speed and acceleration along the path, in mm, mm/s and mm/s².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KinematicState {
    /// Place, mm.
    pub s: f64,
    /// Speed, mm/s; negative is backward.
    pub v: f64,
    /// Acceleration, mm/s².
    pub a: f64,
}

impl KinematicState {
    /// State at place 0 with speed `v` in mm/s and acceleration `a` in mm/s².
    pub const fn moving(v: f64, a: f64) -> Self {
        Self { s: 0.0, v, a }
    }

    /// State `t` seconds later under constant jerk in mm/s³.
    #[inline]
    pub fn after(self, jerk: f64, t: f64) -> Self {
        Self {
            s: self.s + t * (self.v + t * (0.5 * self.a + t * jerk / 6.0)),
            v: self.v + t * (self.a + 0.5 * t * jerk),
            a: self.a + t * jerk,
        }
    }
}

impl KinematicState {
    /// State `t` seconds later where the jerk is `growth` times the speed, 1/s². `t²·|growth|` is at most 1.
    #[inline]
    pub(crate) fn after_growth(self, growth: f64, t: f64) -> Self {
        // v″ = growth·v: series of the hyperbolic or circular functions, which end with the tenth power.
        let z = growth * t * t;
        let even = 1.0 + z / 2.0 * (1.0 + z / 12.0 * (1.0 + z / 30.0 * (1.0 + z / 56.0 * (1.0 + z / 90.0))));
        let odd = 1.0 + z / 6.0 * (1.0 + z / 20.0 * (1.0 + z / 42.0 * (1.0 + z / 72.0 * (1.0 + z / 110.0))));
        // The integral of `odd` over t, over t²: (even − 1) / z.
        let way = 0.5 * (1.0 + z / 12.0 * (1.0 + z / 30.0 * (1.0 + z / 56.0 * (1.0 + z / 90.0))));
        Self {
            s: self.s + t * (self.v * odd + self.a * t * way),
            v: self.v * even + self.a * t * odd,
            a: self.a * even + self.v * growth * t * odd,
        }
    }
}

/// Limits along the path, each above 0 and equal in both directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathLimits {
    /// Highest speed, mm/s.
    pub v: f64,
    /// Highest acceleration, mm/s².
    pub a: f64,
    /// Highest jerk, mm/s³.
    pub j: f64,
}

impl PathLimits {
    /// The tighter of both, limit by limit.
    #[inline]
    pub(crate) fn tighter(self, other: Self) -> Self {
        Self { v: self.v.min(other.v), a: self.a.min(other.a), j: self.j.min(other.j) }
    }
}

/// Shortest distance in mm in which `from` comes to rest. Its speed is at least what its acceleration removes.
pub(crate) fn stopping_distance(from: KinematicState, limits: PathLimits) -> f64 {
    let PathLimits { a: a_max, j, .. } = limits;
    let hardest = (j * from.v + 0.5 * from.a * from.a).max(0.0).sqrt().max(-from.a);
    let (hardest, held) = if hardest > a_max {
        (a_max, (from.v - (a_max * a_max - 0.5 * from.a * from.a) / j).max(0.0) / a_max)
    } else {
        (hardest, 0.0)
    };
    let start = KinematicState::moving(from.v, from.a);
    start.after(-j, (from.a + hardest) / j).after(0.0, held).after(j, hardest / j).s
}

/// Reason why two states cannot be connected over a distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileError {
    /// The target cannot be reached: its speed is higher than the distance allows.
    TargetTooHigh,
    /// The start cannot be left: its speed is too high to be reduced over the distance.
    StartTooHigh,
}

impl fmt::Display for ProfileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TargetTooHigh => "the target's speed is higher than the distance allows; lower it",
            Self::StartTooHigh => "the start's speed cannot be reduced over the distance; lower it",
        })
    }
}

impl std::error::Error for ProfileError {}

/// Seven phases of constant jerk from a start state at place 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Profile {
    /// Speed at the start, mm/s.
    pub v0: f64,
    /// Acceleration at the start, mm/s².
    pub a0: f64,
    /// Jerk of the first phase, mm/s³; negative where the profile dips instead of rising.
    pub jerk: f64,
    /// Durations of the phases, s, none negative.
    pub times: [f64; 7],
    /// Where this is not 0, the profile has only its first phase, with a jerk of this many 1/s² times its speed, and
    /// `jerk` is the largest: the square of the speed is a quadratic of the place.
    pub growth: f64,
}

impl Profile {
    /// Duration of the profile, s.
    pub fn duration(&self) -> f64 {
        self.times.iter().sum()
    }

    /// State at the start of phase `k`, with the rounding of `state` removed. At constant speed the acceleration is
    /// exactly 0, because a rounding of it would grow with the square of the time.
    #[inline]
    pub(crate) fn entering(&self, k: usize, state: KinematicState) -> KinematicState {
        if k == 3 && self.times[3] > 0.0 { KinematicState { a: 0.0, ..state } } else { state }
    }

    /// State at the start.
    pub const fn start(&self) -> KinematicState {
        KinematicState::moving(self.v0, self.a0)
    }

    /// State `t` seconds after the start, with `t` clamped to the profile.
    pub fn at(&self, t: f64) -> KinematicState {
        let mut state = self.start();
        let mut remaining = t.max(0.0);
        if self.growth != 0.0 {
            return state.after_growth(self.growth, remaining.min(self.times[0]));
        }
        for (k, (sign, &phase)) in SIGNS.iter().zip(&self.times).enumerate() {
            state = self.entering(k, state).after(sign * self.jerk, phase.min(remaining));
            remaining -= phase;
            if remaining <= 0.0 {
                break;
            }
        }
        state
    }

    /// State at the end.
    pub fn end(&self) -> KinematicState {
        self.ends().last().unwrap_or(self.start())
    }

    /// States at the ends of the phases.
    #[inline]
    pub(crate) fn ends(&self) -> impl Iterator<Item = KinematicState> + '_ {
        let mut state = self.start();
        (0..7).map(move |k| {
            state = if self.growth != 0.0 {
                state.after_growth(self.growth, self.times[k])
            } else {
                self.entering(k, state).after(SIGNS[k] * self.jerk, self.times[k])
            };
            state
        })
    }

    /// Time at which place `s` is passed.
    pub(crate) fn time_at(&self, s: f64) -> f64 {
        ProfileCursor::new(self).seek_place(s)
    }

    /// Cuts the profile at time `t` into the part before and the part after.
    pub(crate) fn cut(&self, t: f64) -> (Self, Self) {
        let (mut before, mut after) = (*self, *self);
        let mut remaining = t;
        for k in 0..7 {
            before.times[k] = self.times[k].min(remaining.max(0.0));
            after.times[k] = self.times[k] - before.times[k];
            remaining -= self.times[k];
        }
        let KinematicState { v, a, .. } = self.at(t);
        (after.v0, after.a0) = (v, a);
        (before, after)
    }

    /// Profile over `length` mm on which the square of the speed is the quadratic of the place with these coefficients
    /// in Bernstein form, all above 0, and with these accelerations at its ends.
    pub(crate) fn of_squared_speed([b0, b1, b2]: [f64; 3], [a0, a1]: [f64; 2], length: f64) -> Self {
        let (v0, v1) = (b0.sqrt(), b2.sqrt());
        let growth = (a1 - a0) / length;
        // ds/v: with tanh or tan of half the angle, t = 2·artanh(√growth·x)/√growth for x = length/(v0 + v1), as the
        // speed changes by a mean acceleration; its series by growth·x².
        let x = length / (v0 + v1);
        let z = growth * x * x;
        let series = 1.0 + z * (1.0 / 3.0 + z * (0.2 + z * (1.0 / 7.0 + z * (1.0 / 9.0 + z / 11.0))));
        let time = 2.0 * x * series;
        // The series may lack a few digits.
        let time = time - (KinematicState::moving(v0, a0).after_growth(growth, time).s - length) / v1;
        let fastest = b0.max(b1).max(b2).sqrt();
        Self {
            v0,
            a0,
            jerk: growth.abs() * fastest,
            times: [time, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            growth: if growth == 0.0 { f64::MIN_POSITIVE } else { growth },
        }
    }

    /// Highest speed, and the places between which it is constant.
    pub(crate) fn crest(&self) -> (f64, f64, f64) {
        let mut state = self.start();
        for (sign, &phase) in SIGNS.iter().zip(&self.times).take(3) {
            state = state.after(sign * self.jerk, phase);
        }
        (state.v, state.s, state.s + state.v * self.times[3])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: PathLimits = PathLimits { v: 100.0, a: 900.0, j: 18_000.0 };

    /// A speed and an acceleration that can be left and reached without running backward.
    fn state() -> impl Strategy<Value = KinematicState> {
        (0.0..1.0f64, -1.0..1.0f64).prop_map(|(v, a)| {
            let (v, a) = (100.0 * v * v, 890.0 * a);
            let most = (1.9 * LIMITS.j * v.min(LIMITS.v - v)).sqrt();
            KinematicState::moving(v, a.clamp(-most, most))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        #[test]
        fn a_profile_keeps_its_limits_and_lands(from in state(), to in state(), size in -4.0..3.0f64) {
            let length = 10f64.powf(size);
            if let Ok(profile) = fastest(from, to, length, LIMITS) {
                let end = profile.end();
                prop_assert!((end.s - length).abs() <= 1e-12 * (1.0 + length));
                prop_assert!((end.v - to.v).abs() <= 1e-9 && (end.a - to.a).abs() <= 1e-6);
                let duration = profile.duration();
                for k in 0..=200 {
                    let KinematicState { v, a, .. } = profile.at(duration * f64::from(k) / 200.0);
                    prop_assert!((-1e-9..=LIMITS.v * (1.0 + 1e-9)).contains(&v) && a.abs() <= LIMITS.a * (1.0 + 1e-9));
                }
                // The reversed profile takes as long.
                let back = fastest(KinematicState::moving(to.v, -to.a), KinematicState::moving(from.v, -from.a),
                    length, LIMITS);
                if let Ok(back) = back {
                    prop_assert!((back.duration() - duration).abs() <= 1e-9 * (1.0 + duration));
                }
                // A profile that may run backward is no slower.
                let any_way = fastest_any_way(from, to, length, LIMITS);
                prop_assert!(any_way.is_ok_and(|any_way| any_way.duration() <= duration * (1.0 + 1e-9)));
            }
        }

        /// The general solver stays within the limits, for any speeds and over any distance, and always finds a
        /// profile.
        #[test]
        fn any_two_states_are_connected(from in state(), to in state(), signs in 0..4, length in -50.0..50.0f64) {
            let turned = |state: KinematicState, turn: bool| if turn { KinematicState::moving(-state.v,
                -state.a) } else { state };
            let (from, to) = (turned(from, signs & 1 != 0), turned(to, signs & 2 != 0));
            let profile = fastest_any_way(from, to, length, LIMITS);
            prop_assert!(profile.is_ok());
            let profile = profile.unwrap_or_default();
            prop_assert!((profile.end().s - length).abs() <= 1e-11 && (profile.end().v - to.v).abs() <= 1e-9);
            for k in 0..=200 {
                let KinematicState { v, a, .. } = profile.at(profile.duration() * f64::from(k) / 200.0);
                prop_assert!(v.abs() <= LIMITS.v * (1.0 + 1e-9) && a.abs() <= LIMITS.a * (1.0 + 1e-9));
            }
        }

        /// Nothing is faster: whatever a few phases within the limits reach, the solver reaches in no more time. Many
        /// of them are the fastest themselves, on the border between two kinds of profile.
        #[test]
        fn no_other_phases_are_faster(from in state(), turn in any::<bool>(),
                                      phases in prop::collection::vec((-1..=1i8, 0.0..0.03f64), 1..4)) {
            let from = if turn { KinematicState::moving(-from.v, -from.a) } else { from };
            let (mut state, mut duration) = (from, 0.0);
            let legal = |s: KinematicState| {
                let free = s.a * s.a / (2.0 * LIMITS.j);
                s.a.abs() <= LIMITS.a && s.v.abs() + free <= LIMITS.v
            };
            for (sign, t) in phases {
                let next = state.after(f64::from(sign) * LIMITS.j, t);
                if legal(next) {
                    (state, duration) = (next, duration + t);
                }
            }
            let takes = |to: KinematicState| fastest_any_way(from, to, state.s, LIMITS).map_or(f64::MAX,
                |p| p.duration());
            // Where the acceleration only just keeps its sign, the last digits of the speed decide whether it can.
            let near = |part: f64| takes(KinematicState { v: state.v * (1.0 + part), ..state });
            let is_as_fast = takes(state) <= duration * (1.0 + 1e-9) + 1e-9;
            prop_assert!(is_as_fast || near(1e-13).min(near(-1e-13)) <= duration + 1e-6);
        }

        /// Within the stopping distance a profile to rest exists; within less there is none.
        #[test]
        fn the_stopping_distance_is_the_least_way_to_rest(from in state()) {
            prop_assume!(from.v > 0.1);
            let distance = stopping_distance(from, LIMITS);
            let rests = |distance: f64| fastest(from, KinematicState::default(), distance, LIMITS).is_ok();
            prop_assert!(rests(distance * (1.0 + 1e-9)) && !rests(distance * (1.0 - 1e-6)));
        }

        /// More length never makes an impossible profile of an easy one: with space to stop and to start, there always
        /// is one.
        #[test]
        fn with_enough_road_there_is_a_profile(from in state(), to in state(), more in 0.0..100.0f64) {
            prop_assert!(fastest(from, to, 30.0 + more, LIMITS).is_ok());
        }

        #[test]
        fn a_cut_profile_goes_on_where_it_was(from in state(), to in state(), share in 0.0..1.0f64) {
            let Ok(whole) = fastest(from, to, 40.0, LIMITS) else { return Ok(()) };
            let (before, after) = whole.cut(share * whole.duration());
            let (middle, end) = (before.at(before.duration()), after.at(after.duration()));
            prop_assert!((middle.v - after.v0).abs() < 1e-9 && (middle.a - after.a0).abs() < 1e-8);
            prop_assert!((middle.s + end.s - 40.0).abs() < 1e-9);
            prop_assert!((whole.time_at(middle.s) - before.duration()).abs() < 1e-6 || middle.v < 1e-3);
        }
    }

    /// A long distance at low speed has a profile too: the rounding of the acceleration does not accumulate over the
    /// time.
    #[test]
    fn a_long_way_at_a_crawl_has_a_profile() {
        let crawl = PathLimits { v: 0.5, ..LIMITS };
        let profile = fastest(KinematicState::default(), KinematicState::moving(0.3, 20.0), 1_000.0, crawl);
        assert!(profile.is_ok_and(|profile| profile.duration() < 2_001.0));
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        let rest = KinematicState::default();
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(fastest_any_way(rest, rest, bad, LIMITS).is_err() && fastest(rest, rest, bad, LIMITS).is_err());
            assert!(fastest_any_way(KinematicState::moving(bad, 0.0), rest, 1.0, LIMITS).is_err());
            assert!(fastest_any_way(rest, KinematicState::moving(0.0, bad), 1.0, LIMITS).is_err());
        }
        for limits in
            [PathLimits { v: 0.0, ..LIMITS }, PathLimits { a: 0.0, ..LIMITS }, PathLimits { j: 0.0, ..LIMITS }]
        {
            assert!(fastest_any_way(rest, rest, 1.0, limits).is_err(), "{limits:?}");
        }
        assert_eq!(
            fastest_any_way(KinematicState::moving(101.0, 0.0), rest, 1.0, LIMITS),
            Err(ProfileError::StartTooHigh)
        );
        assert_eq!(
            fastest_any_way(rest, KinematicState::moving(0.0, -901.0), 1.0, LIMITS),
            Err(ProfileError::TargetTooHigh)
        );
        assert_eq!(fastest(rest, rest, -1.0, LIMITS), Err(ProfileError::StartTooHigh));
    }
}
