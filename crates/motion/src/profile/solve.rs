//! Solving for a profile: which family covers the distance, and its fastest member.
//!
//! Invariant: a profile is returned only after it was integrated and found to end in the requested state at the
//! requested distance.
//!
//! Take the profiles that change from one state to the other in the duration T. Those that get furthest leave with
//! rising acceleration, those that get least far with falling; both families begin with the fastest change of speed and
//! acceleration, which covers the distance d. Between them every distance is covered, so the fastest profile over a
//! length beyond d is the first member of the rising family that covers it, and below d the first of the falling one,
//! its mirror image.

use super::profile_shape::{Cap, End, ProfileFamily, Shape};
use super::{KinematicState, PathLimits, Profile, ProfileError, SIGNS};

/// Returns the fastest profile from `from` to `to` over `length` mm that never runs backward. The places of the states
/// are ignored; speeds and `length` are not negative.
///
/// Where both ends accelerate in the same direction, there can be one more profile whose acceleration decreases between
/// them and keeps its sign. It is not searched for here; [`fastest_any_way`] finds it.
///
/// # Errors
/// [`ProfileError`] says which of the two states is too high for the distance or the limits. A state that cannot be
/// left or reached without running backward is too high for any distance.
pub fn fastest(
    from: KinematicState,
    to: KinematicState,
    length: f64,
    limits: PathLimits,
) -> Result<Profile, ProfileError> {
    let ends = Ends::new(from, to, limits);
    if !(ends.from.legal(&ends) && (from.a >= 0.0 || ends.from.free >= 0.0)) {
        return Err(ProfileError::StartTooHigh);
    }
    if !(ends.to.legal(&ends) && (to.a <= 0.0 || ends.to.free >= 0.0)) {
        return Err(ProfileError::TargetTooHigh);
    }
    let slack = 1e-14 * (length + 1.0) * ends.per_jerk;
    let (is_start, length_per_jerk) = (ends.from.free >= ends.to.free, length * ends.per_jerk);
    let family = ends.family(!is_start);
    let excess = family.excess(length_per_jerk);
    if excess < -slack {
        return Err(if is_start { ProfileError::StartTooHigh } else { ProfileError::TargetTooHigh });
    }
    let shape = if excess <= slack { family.first() } else { family.beyond(length_per_jerk) };
    let profile = Profile { v0: from.v, a0: from.a, jerk: limits.j, times: shape.times(!is_start), growth: 0.0 };
    let (sound, least) = lands(&profile, length, to, 1.0 + length);
    if sound && least >= -1e-10 { Ok(profile) } else { Err(ProfileError::TargetTooHigh) }
}

/// Returns the fastest profile from `from` to `to` over `length` mm, with speeds and length of any sign. The places of
/// the states are ignored. The limits hold in both directions, and the jerk of the first phase is positive or negative.
///
/// # Errors
/// [`ProfileError`] says which of the two states is outside the limits, or leaves them when its acceleration is taken
/// to zero at once.
pub fn fastest_any_way(
    from: KinematicState,
    to: KinematicState,
    length: f64,
    limits: PathLimits,
) -> Result<Profile, ProfileError> {
    let ends = Ends::new(from, to, limits);
    if !ends.from.legal_any_way(&ends) {
        return Err(ProfileError::StartTooHigh);
    }
    if !ends.to.legal_any_way(&ends) {
        return Err(ProfileError::TargetTooHigh);
    }
    // Within a rounding of the fastest change, that change is the answer; the mirror image would cover the rest on a
    // detour.
    if let Some(straight) = straight(from, to, length, limits) {
        return Ok(straight);
    }
    let excursion = length.abs() + ends.excursion() * limits.j;
    let slack = 1e-15 * excursion * ends.per_jerk;
    let length_per_jerk = length * ends.per_jerk;
    let apart = if from.a * to.a > 0.0 { ends.apart(length_per_jerk, slack) } else { None };
    let (sign, times) = apart.unwrap_or_else(|| {
        let swapped = ends.from.free < ends.to.free;
        let family = ends.family(swapped);
        let excess = family.excess(length_per_jerk);
        if excess.abs() <= slack {
            return (1.0, family.first().times(swapped));
        }
        if excess > 0.0 {
            return (1.0, family.beyond(length_per_jerk).times(swapped));
        }
        let sign = -1.0;
        let ends = ends.signed(sign);
        let swapped = ends.from.free < ends.to.free;
        (sign, ends.family(swapped).beyond(sign * length_per_jerk).times(swapped))
    });
    let jerk = sign * limits.j;
    let profile = Profile { v0: from.v, a0: from.a, jerk, times, growth: 0.0 };
    if lands(&profile, length, to, 1.0 + excursion).0 { Ok(profile) } else { Err(ProfileError::TargetTooHigh) }
}

/// The change with one jerk only, where it fits up to rounding. It is on the border of all families, where the distance
/// depends without bound on the last digits of the speeds.
#[inline]
fn straight(from: KinematicState, to: KinematicState, length: f64, limits: PathLimits) -> Option<Profile> {
    let (rise, sum) = (to.a - from.a, from.v.abs() + to.v.abs());
    let change = 2.0 * limits.j * (to.v - from.v);
    if (change - (from.a + to.a) * rise.abs()).abs() > 2e-14 * limits.j * sum || rise == 0.0 {
        return None;
    }
    let jerk = limits.j.copysign(rise);
    let t = rise / jerk;
    let profile = Profile { v0: from.v, a0: from.a, jerk, times: [t, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], growth: 0.0 };
    ((profile.end().s - length).abs() <= 1e-14 * sum * t).then_some(profile)
}

/// Both ends and the limits, with the jerk as unit.
#[derive(Clone, Copy)]
struct Ends {
    from: End,
    to: End,
    cap: Cap,
    top: f64,
    per_jerk: f64,
}

impl Ends {
    #[inline]
    fn new(from: KinematicState, to: KinematicState, limits: PathLimits) -> Self {
        let per_jerk = 1.0 / limits.j;
        // An end may exceed the limit by a rounding.
        let a = limits.a.max(from.a.abs().max(to.a.abs()).min(limits.a * (1.0 + 1e-9)));
        Self {
            from: End::new(from.v * per_jerk, from.a * per_jerk),
            to: End::new(to.v * per_jerk, -to.a * per_jerk),
            cap: Cap { w: a * per_jerk, per_w: limits.j / a },
            top: limits.v * per_jerk,
            per_jerk,
        }
    }

    /// At least the distance that the fastest change of speed and acceleration covers to and fro (s³).
    #[inline]
    fn excursion(&self) -> f64 {
        let reach = |end: End| end.v.abs() + end.alpha * end.alpha;
        let v = reach(self.from) + reach(self.to);
        // A ramp that meets the acceleration limit takes longer than one that does not.
        2.0 * v * (self.cap.w + v * self.cap.per_w)
    }

    /// The ends with all signs reversed where `sign` is −1.
    #[inline]
    fn signed(&self, sign: f64) -> Self {
        Self { from: self.from.signed(sign), to: self.to.signed(sign), ..*self }
    }

    /// Profile over `length` (s³) that belongs to the few separate ones, see [`ProfileFamily::apart`], where one
    /// exists, and the sign of its first jerk. Both ends accelerate in the same direction.
    #[cold]
    fn apart(&self, length: f64, slack: f64) -> Option<(f64, [f64; 7])> {
        let one_way = |ends: &Self, length: f64| {
            let swapped = ends.to.alpha < 0.0;
            Some(ends.family(swapped).apart(length, slack)?.times(swapped))
        };
        let rising = one_way(self, length).map(|times| (1.0, times));
        rising.or_else(|| one_way(&self.signed(-1.0), -length).map(|times| (-1.0, times)))
    }

    #[inline]
    fn family(&self, swapped: bool) -> ProfileFamily {
        let (high, low) = if swapped { (self.to, self.from) } else { (self.from, self.to) };
        ProfileFamily { high, low, cap: self.cap, top: self.top }
    }
}

impl Shape {
    /// Phases in the order of time.
    #[inline]
    fn times(self, swapped: bool) -> [f64; 7] {
        let Self { up, cruise, down } = self;
        let ([a, b, c], [g, f, e]) = if swapped { (down, up) } else { (up, down) };
        [a, b, c, cruise, e, f, g].map(|t| if t > 0.0 { t } else { 0.0 })
    }
}

impl End {
    /// Whether the end is within the limits and stays below the speed limit when its acceleration is taken to zero at
    /// once.
    #[inline]
    fn legal(self, ends: &Ends) -> bool {
        self.alpha.abs() <= ends.cap.w && self.free <= ends.top * (1.0 + 1e-12)
    }

    /// Whether the end is within the limits in both directions.
    #[inline]
    fn legal_any_way(self, ends: &Ends) -> bool {
        let top = ends.top * (1.0 + 1e-12);
        self.alpha.abs() <= ends.cap.w && self.v.abs().max(self.free.abs()) <= top
    }
}

/// Whether the phases end at `length` in the state `to`, and the lowest speed between two of them. Places may be off by
/// a part in 10¹² of `excursion`. This guards against lost digits.
#[inline(always)]
fn lands(profile: &Profile, length: f64, to: KinematicState, excursion: f64) -> (bool, f64) {
    // The same sums as in `Profile::ends`, without a division.
    let (mut s, mut v, mut a, mut least) = (0.0, profile.v0, profile.a0, profile.v0);
    for (k, (&t, sign)) in profile.times.iter().zip(SIGNS).enumerate() {
        if k == 3 && t > 0.0 {
            a = 0.0;
        }
        let change = sign * profile.jerk * t;
        s += t * (v + t * (0.5 * a + (1.0 / 6.0) * change));
        v += t * (a + 0.5 * change);
        a += change;
        if v < least {
            least = v;
        }
    }
    let lands = (s - length).abs() < 1e-12 * excursion
        && (v - to.v).abs() <= 1e-10 * (1.0 + to.v.abs())
        && (a - to.a).abs() <= 1e-8 * (1.0 + to.a.abs());
    (lands, least)
}
