//! The outcome of the comparison of one case.
//!
//! Invariant: a profile of ours counts only after its phases were integrated here and found to end in the target state
//! within the limits.

use super::cases::Case;
use super::peer::Peer;
use retrace_motion::profile::{KinematicState, Profile, fastest_any_way};
use std::fmt;

/// Outcome of one case; everything but the first is a reason why the durations are not compared or not equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Outcome {
    /// Equal to 1e-9, relative and absolute.
    Equal,
    /// The peer finds nothing; ours is legal.
    PeerFails,
    /// The peer takes longer over a distance of zero between equal states, which takes no time.
    PeerDetours,
    /// The peer takes longer, ours is legal.
    PeerSlower,
    /// The peer is faster, but its phases end elsewhere: for the state and place in which they end ours takes no
    /// longer.
    PeerMisses,
    /// A rounding of the distance, which only real numbers could decide, causes more than the difference.
    Border,
    /// The peer is faster and reaches the target.
    OursSlower(f64),
    /// Ours finds nothing.
    OursFails,
    /// Ours misses or breaks a limit.
    OursIllegal,
}

impl Outcome {
    /// Whether nothing is wrong with ours.
    pub(crate) fn is_sound(self) -> bool {
        !matches!(self, Self::OursSlower(_) | Self::OursFails | Self::OursIllegal)
    }
}

/// Solves a case by both and compares.
pub(crate) fn compare(case: &Case, peer: &mut Peer) -> Outcome {
    let Ok(ours) = fastest_any_way(case.from, case.to, case.length, case.limits) else { return Outcome::OursFails };
    if !is_legal(case, &ours) {
        return Outcome::OursIllegal;
    }
    peer.set(case);
    let Ok(theirs) = peer.solve() else { return Outcome::PeerFails };
    let gap = ours.duration() - theirs;
    let allowed = 1e-9 * (1.0 + theirs);
    if gap.abs() <= allowed {
        return Outcome::Equal;
    }
    if gap < 0.0 {
        let still = case.from == case.to && ours.duration() == 0.0;
        return if still { Outcome::PeerDetours } else { Outcome::PeerSlower };
    }
    let to = peer.end(case);
    let moved = Case { to, length: to.s, ..*case };
    if let Ok(same) = fastest_any_way(moved.from, moved.to, moved.length, moved.limits)
        && (same.duration() <= theirs + allowed || is_at_border(&moved, same.duration() - theirs))
    {
        return Outcome::PeerMisses;
    }
    if is_at_border(case, gap) { Outcome::Border } else { Outcome::OursSlower(gap) }
}

/// Whether a rounding of the distance, in the sum of the distances to and fro that it is made of, changes the duration
/// by `gap`.
pub(crate) fn is_at_border(case: &Case, gap: f64) -> bool {
    let duration = |length: f64| {
        fastest_any_way(case.from, case.to, length, case.limits).map_or(f64::NAN, |profile| profile.duration())
    };
    let ways = case.length.abs() + excursion(case);
    let (less, more) = (duration(case.length - 1e-14 * ways), duration(case.length + 1e-14 * ways));
    let here = duration(case.length);
    gap <= 1.1 * (less - here).abs().max((more - here).abs()) + 1e-9
}

/// Distance that the two states cover in the time of a change of speed.
fn excursion(case: &Case) -> f64 {
    let Case { from, to, limits, .. } = *case;
    let v = (from.v.abs() + to.v.abs()) + 0.5 * (from.a * from.a + to.a * to.a) / limits.j;
    v * (2.0 * v / limits.a + limits.a / limits.j).min(2.0 * (2.0 * v / limits.j).sqrt() + 2.0 * v / limits.a)
}

/// Whether the integrated phases reach the target, with speed and acceleration within their limits at the ends of the
/// phases and at the extremes of the speed between.
fn is_legal(case: &Case, profile: &Profile) -> bool {
    let Case { from, to, length, limits } = *case;
    let (v_most, a_most) = (limits.v * (1.0 + 1e-9) + 1e-9, limits.a * (1.0 + 1e-9) + 1e-9);
    let mut state = from;
    let mut sound = profile.jerk.abs() == limits.j && (profile.v0, profile.a0) == (from.v, from.a);
    for (k, sign) in [1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0].into_iter().enumerate() {
        let (jerk, t) = (sign * profile.jerk, profile.times[k]);
        let before = if k == 3 && t > 0.0 { KinematicState { a: 0.0, ..state } } else { state };
        let turn = if jerk == 0.0 { 0.0 } else { (-before.a / jerk).clamp(0.0, t) };
        state = before.after(jerk, t);
        let extreme = before.after(jerk, turn).v.abs().max(state.v.abs());
        sound &= t >= 0.0 && extreme <= v_most && state.a.abs() <= a_most;
    }
    let ways = 1.0 + length.abs() + excursion(case);
    sound
        && (state.s - length).abs() <= 1e-11 * ways
        && (state.v - to.v).abs() <= 1e-9 * (1.0 + limits.v)
        && (state.a - to.a).abs() <= 1e-8 * (1.0 + limits.a)
}

/// Number of cases of each outcome.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tally {
    pub(crate) equal: u64,
    peer_fails: u64,
    peer_detours: u64,
    peer_slower: u64,
    peer_misses: u64,
    border: u64,
    wrong: u64,
}

impl Tally {
    pub(crate) fn count(&mut self, verdict: Outcome) {
        *match verdict {
            Outcome::Equal => &mut self.equal,
            Outcome::PeerFails => &mut self.peer_fails,
            Outcome::PeerDetours => &mut self.peer_detours,
            Outcome::PeerSlower => &mut self.peer_slower,
            Outcome::PeerMisses => &mut self.peer_misses,
            Outcome::Border => &mut self.border,
            Outcome::OursSlower(_) | Outcome::OursFails | Outcome::OursIllegal => &mut self.wrong,
        } += 1;
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { equal, peer_fails, peer_detours, peer_slower, peer_misses, border, wrong } = self;
        writeln!(f, "equal to 1e-9                                     {equal:>9}")?;
        writeln!(f, "rsruckig finds no profile, ours is legal          {peer_fails:>9}")?;
        writeln!(f, "rsruckig moves where nothing is to be done        {peer_detours:>9}")?;
        writeln!(f, "rsruckig is slower, ours is legal                 {peer_slower:>9}")?;
        writeln!(f, "rsruckig ends elsewhere, within its own tolerance {peer_misses:>9}")?;
        writeln!(f, "a rounding of the distance decides                {border:>9}")?;
        write!(f, "ours fails, is slower or breaks a limit           {wrong:>9}")
    }
}
