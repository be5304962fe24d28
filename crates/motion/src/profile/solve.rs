//! Solving for a profile: which family covers the distance, and its fastest member.
//!
//! Invariant: what is returned was integrated and lands on the state and the distance that were asked for.
//!
//! Take the profiles that change from one state to the other in the duration T. Those that get furthest leave with rising
//! acceleration, those that get least far with falling; both families begin with the fastest change of speed and acceleration,
//! which covers the distance d. Between them every distance is covered, so the fastest profile over a length beyond d is the
//! first member of the rising family that covers it, and below d the first of the falling one, its mirror image.

use super::family::{End, Family, Shape};
use super::{Misfit, PathLimits, Profile, State};

/// The fastest profile from `from` to `to` (their places are ignored) over `length` mm that never runs backward.
///
/// # Errors
/// Which of the two states is too high for the distance or the limits; a state that cannot be left or reached without
/// running backward is too high for any distance.
pub fn fastest(from: State, to: State, length: f64, limits: PathLimits) -> Result<Profile, Misfit> {
    let ends = Ends::new(from, to, limits);
    if !(ends.from.legal(&ends) && (from.a >= 0.0 || ends.from.free >= 0.0)) {
        return Err(Misfit::StartTooHigh);
    }
    if !(ends.to.legal(&ends) && (to.a <= 0.0 || ends.to.free >= 0.0)) {
        return Err(Misfit::TargetTooHigh);
    }
    let slack = 1e-14 * (length + 1.0) * ends.per_jerk;
    let Some(times) = ends.times(length, slack, slack) else {
        let is_start = ends.from.free >= ends.to.free;
        return Err(if is_start { Misfit::StartTooHigh } else { Misfit::TargetTooHigh });
    };
    let profile = Profile { v0: from.v, a0: from.a, jerk: limits.j, times };
    let (sound, least) = lands(&profile, length, to, 1.0 + length);
    if sound && least >= -1e-10 { Ok(profile) } else { Err(Misfit::TargetTooHigh) }
}

/// The fastest profile from `from` to `to` (their places are ignored) over `length` mm; speeds and the length may have any
/// sign. The limits hold in both directions, and the first phase's jerk is positive or negative.
///
/// # Errors
/// Which of the two states lies outside the limits, or leaves them when its acceleration is taken to zero at once.
pub fn fastest_any_way(from: State, to: State, length: f64, limits: PathLimits) -> Result<Profile, Misfit> {
    let ends = Ends::new(from, to, limits);
    if !ends.from.legal_any_way(&ends) {
        return Err(Misfit::StartTooHigh);
    }
    if !ends.to.legal_any_way(&ends) {
        return Err(Misfit::TargetTooHigh);
    }
    // Within a rounding of the fastest change that change is the answer; the mirror image would cover the rest on a detour.
    let excursion = length.abs() + ends.excursion() * limits.j;
    let slack = 2e-15 * excursion * ends.per_jerk;
    let mirrored = ends.mirrored();
    let (jerk, times) = if let Some(times) = ends.times_apart(length, slack) {
        (limits.j, Some(times))
    } else if let Some(times) = mirrored.times_apart(-length, slack) {
        (-limits.j, Some(times))
    } else if let Some(times) = ends.times(length, slack, slack) {
        (limits.j, Some(times))
    } else {
        (-limits.j, mirrored.times(-length, f64::INFINITY, slack))
    };
    let Some(times) = times else { return Err(Misfit::TargetTooHigh) };
    let profile = Profile { v0: from.v, a0: from.a, jerk, times };
    if lands(&profile, length, to, 1.0 + excursion).0 { Ok(profile) } else { Err(Misfit::TargetTooHigh) }
}

/// Both ends and the limits, with the jerk as unit.
#[derive(Clone, Copy)]
struct Ends {
    from: End,
    to: End,
    w: f64,
    top: f64,
    per_jerk: f64,
}

impl Ends {
    #[inline]
    fn new(from: State, to: State, limits: PathLimits) -> Self {
        let per_jerk = 1.0 / limits.j;
        Self {
            from: End::new(from.v * per_jerk, from.a * per_jerk),
            to: End::new(to.v * per_jerk, -to.a * per_jerk),
            w: limits.a * per_jerk,
            top: limits.v * per_jerk,
            per_jerk,
        }
    }

    /// No less than what the fastest change of speed and acceleration covers to and fro (s³).
    #[inline]
    fn excursion(&self) -> f64 {
        let reach = |end: End| end.v.abs() + 0.5 * end.alpha * end.alpha;
        let v = reach(self.from).max(reach(self.to));
        let ramp = if 2.0 * v > self.w * self.w { self.w + 2.0 * v / self.w } else { 2.0 * (2.0 * v).sqrt() };
        v * (ramp + self.from.alpha.abs() + self.to.alpha.abs())
    }

    /// The ends with all signs turned.
    fn mirrored(self) -> Self {
        Self { from: self.from.mirrored(), to: self.to.mirrored(), ..self }
    }

    /// The phases of the fastest profile over `length` that leaves with rising acceleration, or `None` where the fastest change
    /// of speed and acceleration is longer by more than `below` (s³). It is the answer too where it is shorter by up to `above`.
    #[inline]
    fn times(&self, length: f64, below: f64, above: f64) -> Option<[f64; 7]> {
        let swapped = self.from.free < self.to.free;
        Some(self.family(swapped).plus(length * self.per_jerk, below, above)?.times(swapped))
    }

    /// The same for the members that stand apart, see [`Family::apart`].
    #[inline]
    fn times_apart(&self, length: f64, slack: f64) -> Option<[f64; 7]> {
        // Both accelerate the same way.
        if self.from.alpha * self.to.alpha >= 0.0 {
            return None;
        }
        let swapped = self.to.alpha < 0.0;
        Some(self.family(swapped).apart(length * self.per_jerk, slack)?.times(swapped))
    }

    #[inline]
    fn family(&self, swapped: bool) -> Family {
        let (high, low) = if swapped { (self.to, self.from) } else { (self.from, self.to) };
        // An end may lie above the limit by a rounding.
        Family { high, low, w: self.w.max(high.alpha.abs()).max(low.alpha.abs()), top: self.top }
    }
}

impl Shape {
    /// The phases in the order of time.
    #[inline]
    fn times(self, swapped: bool) -> [f64; 7] {
        let Self { up, cruise, down } = self;
        let ([a, b, c], [g, f, e]) = if swapped { (down, up) } else { (up, down) };
        [a, b, c, cruise, e, f, g].map(|t| t.max(0.0))
    }
}

impl End {
    /// Is it within the limits, and does it stay below the speed limit when its acceleration is taken to zero at once?
    #[inline]
    fn legal(self, ends: &Ends) -> bool {
        self.alpha.abs() <= ends.w * (1.0 + 1e-9) && self.free <= ends.top * (1.0 + 1e-12)
    }

    /// The same in both directions.
    #[inline]
    fn legal_any_way(self, ends: &Ends) -> bool {
        let top = ends.top * (1.0 + 1e-12);
        self.alpha.abs() <= ends.w * (1.0 + 1e-9) && self.v.abs().max(self.free.abs()) <= top
    }
}

/// Do the phases really end at `length` in the state `to`, and what is the lowest speed between two of them? Places may be off
/// by a part in 10¹² of `excursion`. It guards against lost digits.
fn lands(profile: &Profile, length: f64, to: State, excursion: f64) -> (bool, f64) {
    let (mut state, mut least) = (profile.start(), profile.v0);
    for end in profile.ends() {
        least = least.min(end.v);
        state = end;
    }
    let lands = (state.s - length).abs() <= 1e-12 * excursion
        && (state.v - to.v).abs() <= 1e-10 * (1.0 + to.v.abs())
        && (state.a - to.a).abs() <= 1e-8 * (1.0 + to.a.abs());
    (lands, least)
}
