//! One jerk-limited profile: the fastest motion between two states over a given distance (SMO-1).
//!
//! Invariant: a profile is seven phases of constant jerk, [+J, 0, −J, 0, −J, 0, +J], any of which may be empty; speed and
//! acceleration are continuous in it, and it never leaves the limits it was asked for. All units are mm and s along the path.

/// Signs of the jerk in the seven phases.
pub(crate) const SIGNS: [f64; 7] = [1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0];

/// Place, speed and acceleration along the path, in mm, mm/s and mm/s².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct State {
    pub(crate) s: f64,
    pub(crate) v: f64,
    pub(crate) a: f64,
}

impl State {
    /// A state at place 0.
    pub(crate) const fn moving(v: f64, a: f64) -> Self {
        Self { s: 0.0, v, a }
    }

    /// The state `t` seconds later under constant jerk.
    #[inline]
    pub(crate) fn after(self, jerk: f64, t: f64) -> Self {
        Self {
            s: self.s + t * (self.v + t * (0.5 * self.a + t * jerk / 6.0)),
            v: self.v + t * (self.a + 0.5 * t * jerk),
            a: self.a + t * jerk,
        }
    }
}

/// Limits along the path: mm/s, mm/s², mm/s³.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PathLimits {
    pub(crate) v: f64,
    pub(crate) a: f64,
    pub(crate) j: f64,
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
pub(crate) enum Misfit {
    /// The target cannot be reached: it asks for more speed than the distance gives.
    TargetTooHigh,
    /// The start cannot be left: it has more speed than the distance can take away.
    StartTooHigh,
}

/// Seven phases from a start state at place 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Profile {
    pub(crate) v0: f64,
    pub(crate) a0: f64,
    pub(crate) jerk: f64,
    pub(crate) times: [f64; 7],
}

impl Profile {
    /// Duration in s.
    pub(crate) fn duration(&self) -> f64 {
        self.times.iter().sum()
    }

    /// The state at the start.
    pub(crate) const fn start(&self) -> State {
        State::moving(self.v0, self.a0)
    }

    /// The state `t` seconds after the start, held within the profile.
    pub(crate) fn at(&self, t: f64) -> State {
        let mut state = self.start();
        let mut left = t.max(0.0);
        for (sign, &phase) in SIGNS.iter().zip(&self.times) {
            state = state.after(sign * self.jerk, phase.min(left));
            left -= phase;
            if left <= 0.0 {
                break;
            }
        }
        state
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

    /// Do the phases really end at `length` in state (v, a), never running backward? It guards against lost digits.
    fn lands(&self, length: f64, v: f64, a: f64) -> bool {
        let mut state = self.start();
        let mut sound = true;
        for (sign, &phase) in SIGNS.iter().zip(&self.times) {
            state = state.after(sign * self.jerk, phase);
            sound &= phase >= 0.0 && state.v >= -1e-10;
        }
        sound
            && (state.s - length).abs() <= 1e-12 * (1.0 + length)
            && (state.v - v).abs() <= 1e-10 * (1.0 + v)
            && (state.a - a).abs() <= 1e-8 * (1.0 + a.abs())
    }
}

/// A ramp from (v, a) to (peak, 0): +J, held at the limit, −J.
struct Ramp {
    times: [f64; 3],
    distance: f64,
    /// d distance / d peak.
    slope: f64,
}

#[inline]
fn ramp(v: f64, a: f64, peak: f64, limits: PathLimits) -> Ramp {
    let PathLimits { a: a_max, j, .. } = limits;
    let top = (j * (peak - v) + 0.5 * a * a).max(0.0).sqrt().max(a);
    let held = top > a_max;
    let top = top.min(a_max.max(a));
    let (rise, fall) = ((top - a) / j, top / j);
    let v_rise = v + 0.5 * (top + a) * rise;
    let v_fall = peak - 0.5 * top * fall;
    let hold = if held { ((v_fall - v_rise) / top).max(0.0) } else { 0.0 };
    let distance = rise * (v + rise * (0.5 * a + rise * j / 6.0))
        + 0.5 * (v_rise + v_fall) * hold
        + fall * (peak - j * fall * fall / 6.0);
    Ramp { times: [rise, hold, fall], distance, slope: fall + v_fall / top.max(1e-9) }
}

/// Braking in which the acceleration never comes to 0: a0 up to `p` ≤ 0, down to the limit, up to a1.
#[inline]
fn fall(from: State, to: State, p: f64, limits: PathLimits) -> ([f64; 4], f64) {
    let PathLimits { a: a_max, j, .. } = limits;
    let squares = p * p - 0.5 * (from.a * from.a - to.a * to.a);
    let lost = from.v - to.v;
    let q = (-(squares + j * lost).max(0.0).sqrt()).min(p).min(to.a).max(-a_max);
    let hold = if q <= -a_max { ((squares - q * q) / j + lost).max(0.0) / -q } else { 0.0 };
    let times = [(p - from.a) / j, (p - q) / j, hold, (to.a - q) / j];
    let end = from.after(j, times[0]).after(-j, times[1]).after(0.0, times[2]).after(j, times[3]);
    (times, end.s)
}

/// The least distance in which `from`, whose speed is not below what its acceleration takes away, comes to rest.
pub(crate) fn stopping_distance(from: State, limits: PathLimits) -> f64 {
    -ramp(-from.v, -from.a, 0.0, limits).distance
}

/// The fastest profile from `from` (its place is ignored) to `to` over `length` within the limits, in closed form up to one
/// root (SMO-8's better sibling).
///
/// # Errors
/// Which of the two states is too high for the distance or the limits.
pub(crate) fn fastest(from: State, to: State, length: f64, limits: PathLimits) -> Result<Profile, Misfit> {
    let (from, to) = (State::moving(from.v, from.a), State::moving(to.v, to.a));
    let PathLimits { v: v_max, a: a_max, j } = limits;
    // The speed each end comes to when its acceleration is taken to 0 at once.
    let free_from = from.v + from.a * from.a.abs() / (2.0 * j);
    let free_to = to.v - to.a * to.a.abs() / (2.0 * j);
    let (a_slack, v_slack) = (a_max * (1.0 + 1e-9), v_max * (1.0 + 1e-12));
    if from.a.abs() > a_slack || free_from > v_slack || (from.a < 0.0 && free_from < 0.0) {
        return Err(Misfit::StartTooHigh);
    }
    if to.a.abs() > a_slack || free_to > v_slack || (to.a > 0.0 && free_to < 0.0) {
        return Err(Misfit::TargetTooHigh);
    }
    let lowest = free_from.max(free_to);
    let times = match crest(from, to, length, lowest, limits) {
        Some(times) => times,
        None if free_from >= free_to => {
            let [p, q, hold, r] = without_crest(from, to, length, limits).ok_or(Misfit::StartTooHigh)?;
            [p, 0.0, 0.0, 0.0, q, hold, r]
        }
        None => {
            // Rising without a crest is falling without a crest, run backward.
            let (back_from, back_to) = (State::moving(to.v, -to.a), State::moving(from.v, -from.a));
            let [p, q, hold, r] = without_crest(back_from, back_to, length, limits).ok_or(Misfit::TargetTooHigh)?;
            [r, hold, q, 0.0, 0.0, 0.0, p]
        }
    };
    let profile = Profile { v0: from.v, a0: from.a, jerk: j, times: times.map(|t| t.max(0.0)) };
    if profile.lands(length, to.v, to.a) { Ok(profile) } else { Err(Misfit::TargetTooHigh) }
}

/// Up to a crest speed of at least `lowest` and down again; `None` where the distance is too short for it.
fn crest(from: State, to: State, length: f64, lowest: f64, limits: PathLimits) -> Option<[f64; 7]> {
    let both = |peak: f64| (ramp(from.v, from.a, peak, limits), ramp(to.v, -to.a, peak, limits));
    let joined = |up: &Ramp, down: &Ramp, cruise: f64| {
        let ([a, b, c], [g, f, e]) = (up.times, down.times);
        [a, b, c, cruise, e, f, g]
    };
    let top = limits.v.max(lowest);
    let (up, down) = both(top);
    let rest = length - up.distance - down.distance;
    if rest >= 0.0 {
        return Some(joined(&up, &down, rest / top));
    }
    let tolerance = 1e-14 * (length + 1.0);
    let (up, down) = both(lowest);
    let excess = up.distance + down.distance - length;
    if excess.abs() <= tolerance {
        return Some(joined(&up, &down, 0.0));
    }
    if excess > 0.0 {
        return None;
    }
    // Newton's method, kept inside the bracket (low, high).
    let (mut low, mut high) = (lowest, top);
    let mut peak = 0.5 * (low + high);
    for round in 0..60 {
        let (up, down) = both(peak);
        let excess = up.distance + down.distance - length;
        let newton = peak - excess / (up.slope + down.slope);
        if excess > 0.0 {
            high = peak
        } else {
            low = peak
        }
        let next = if newton > low && newton < high && round < 40 { newton } else { 0.5 * (low + high) };
        if excess.abs() <= tolerance || (next - peak).abs() <= 1e-16 * peak {
            return Some(joined(&up, &down, 0.0));
        }
        peak = next;
    }
    let (up, down) = both(low);
    let rest = length - up.distance - down.distance;
    Some(joined(&up, &down, (rest / low.max(1e-9)).max(0.0)))
}

/// Falling from `from` to `to` with the acceleration never positive; `None` where even the hardest braking is too long.
fn without_crest(from: State, to: State, length: f64, limits: PathLimits) -> Option<[f64; 4]> {
    if from.a >= 0.0 || (to.a > 0.0 && to.v < to.a * to.a / (2.0 * limits.j)) {
        return None;
    }
    let excess = |p: f64| {
        let (times, distance) = fall(from, to, p, limits);
        (times, distance - length)
    };
    let (mut low, mut high) = (from.a, 0.0);
    let (mut times, mut f_low) = excess(low);
    let mut f_high = excess(high).1;
    if f_low > 0.0 || f_high < 0.0 {
        return None;
    }
    let tolerance = 1e-14 * (length + 1.0);
    for round in 0..80 {
        let secant = (low * f_high - high * f_low) / (f_high - f_low);
        let p = if round % 3 == 2 || !secant.is_finite() { 0.5 * (low + high) } else { secant };
        let (at_p, f) = excess(p);
        times = at_p;
        if f.abs() <= tolerance || high - low < 1e-15 * limits.a {
            break;
        }
        if f > 0.0 { (high, f_high) = (p, f) } else { (low, f_low) = (p, f) }
    }
    Some(times)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: PathLimits = PathLimits { v: 100.0, a: 900.0, j: 18_000.0 };

    /// A speed and an acceleration that can be left and reached without running backward.
    fn state() -> impl Strategy<Value = State> {
        (0.0..1.0f64, -1.0..1.0f64).prop_map(|(v, a)| {
            let (v, a) = (100.0 * v * v, 890.0 * a);
            let most = (1.9 * LIMITS.j * v.min(LIMITS.v - v)).sqrt();
            State::moving(v, a.clamp(-most, most))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn a_profile_keeps_its_limits_and_lands(from in state(), to in state(), size in -4.0..3.0f64) {
            let length = 10f64.powf(size);
            let forward = fastest(from, to, length, LIMITS);
            if let Ok(profile) = forward {
                prop_assert!(profile.lands(length, to.v, to.a));
                let duration = profile.duration();
                for k in 0..=200 {
                    let State { v, a, .. } = profile.at(duration * f64::from(k) / 200.0);
                    prop_assert!((-1e-9..=LIMITS.v * (1.0 + 1e-9)).contains(&v) && a.abs() <= LIMITS.a * (1.0 + 1e-9));
                }
                // Run backward it takes as long.
                let back = fastest(State::moving(to.v, -to.a), State::moving(from.v, -from.a), length, LIMITS);
                if let Ok(back) = back {
                    prop_assert!((back.duration() - duration).abs() <= 1e-7 * (1.0 + duration));
                }
            }
        }

        /// More road never makes an impossible profile of an easy one: with room to stop and go, there always is one.
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
}
