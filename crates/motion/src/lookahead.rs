//! Look-ahead: a jerk-limited plan over a whole path of blocks, with the acceleration carried across junctions (design,
//! idea 7).
//!
//! A *gate* is a state (v, a) that the plan passes at a junction; between two gates runs one *span*, the fastest
//! profile between them, however many blocks it covers. Junctions where the envelope touches its cap propose gates. A
//! stack pass connects them from left to right: a gate that cannot be reached is skipped, one that cannot brake to the
//! next is dropped, and where a span overshoots a cap that junction becomes a gate. Tuning then drops or raises single
//! gates.
//!
//! Invariant: a span is accepted only after it was computed again from its phases and compared with every cap it
//! passes. Choosing gates decides how fast a plan is, never whether it is legal. The work has a limit. Where it is used
//! up, or the start state allows no plan, there is none, and the caller continues its previous plan, which ends at
//! rest.

mod end_zones;
mod gate_tuning;
mod profile_walk;

use profile_walk::ProfileWalk;

use crate::envelope::{Envelope, PathBlock, gate_acceleration};
use crate::profile::{KinematicState, PathLimits, Profile, ProfileError, fastest};
use crate::rest_to_rest;
use crate::span::Span;
use std::fmt;

/// No plan exists within the limit of work, or none from this start state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PlanError;

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("no plan exists within the limit of work, or none from this start state")
    }
}

impl std::error::Error for PlanError {}

/// No limit: the limits of an empty part of the path.
const UNLIMITED: SpanLimits = SpanLimits { tight: PathLimits { v: f64::MAX, a: f64::MAX, j: f64::MAX }, fastest: 0.0 };

/// Limits over several blocks.
#[derive(Clone, Copy, Debug)]
struct SpanLimits {
    tight: PathLimits,
    /// Highest speed limit of the blocks.
    fastest: f64,
}

impl SpanLimits {
    fn with(self, other: Self) -> Self {
        Self { tight: self.tight.tighter(other.tight), fastest: self.fastest.max(other.fastest) }
    }

    fn of(blocks: &[PathBlock]) -> Self {
        blocks.iter().fold(UNLIMITED, |all, b| all.with(Self { tight: b.limits, fastest: b.limits.v }))
    }
}

/// A gate and the span that leads to it.
#[derive(Clone, Copy, Debug)]
struct PlanGate {
    junction: usize,
    v: f64,
    a: f64,
    limits: SpanLimits,
    profile: Profile,
}

impl PlanGate {
    fn state(&self) -> KinematicState {
        KinematicState::moving(self.v, self.a)
    }
}

/// Number of spans that are solved before planning fails: a fixed part and one for each block.
const WORK: (usize, usize) = (1000, 30);
/// Least time between two proposed gates, in units of A/J; valleys always propose.
const SPACING: f64 = 0.3;
/// How often overshoots may make a junction a gate, and how deep such insertions may nest.
const TRIES: (u8, u8) = (60, 40);
/// How often a path is halved to brake on each part within its own limits.
const HALVINGS: u8 = 4;
/// Shares of the speed that can be braked from, tried in turn.
const EASED: [f64; 3] = [1.0, 0.75, 0.5];
/// How often the end of a slow block is tried as a gate.
const SLOW_TRIES: u8 = 3;

/// The planner's look-ahead; it retains its memory from plan to plan.
#[derive(Debug, Default)]
pub(crate) struct LookAhead {
    envelope: Envelope,
    gates: Vec<PlanGate>,
    tuned: Vec<PlanGate>,
    tries: Vec<u8>,
    work: usize,
    /// End of the last of the slowest blocks that held down the crest of the last span; 0 where none did.
    slow_end: usize,
}

impl LookAhead {
    /// Plans `blocks` from speed `v0` and acceleration `a0` to those of `end` and appends the spans to `out`.
    ///
    /// # Errors
    /// [`PlanError`]; `out` is unchanged then.
    pub(crate) fn plan(
        &mut self,
        blocks: &[PathBlock],
        (v0, a0): (f64, f64),
        end: KinematicState,
        out: &mut Vec<Span>,
    ) -> Result<(), PlanError> {
        self.begin(blocks, (v0, a0), end);
        self.connect_all(blocks, end)?;
        self.improve(blocks, out);
        Ok(())
    }

    /// Begins a search with the gate at the start.
    fn begin(&mut self, blocks: &[PathBlock], (v0, a0): (f64, f64), end: KinematicState) {
        self.envelope.compute(blocks, v0, end.v);
        self.work = WORK.0 + WORK.1 * blocks.len();
        self.tries.clear();
        self.tries.resize(blocks.len() + 1, 0);
        self.gates.clear();
        self.gates.push(PlanGate { junction: 0, v: v0, a: a0, limits: UNLIMITED, profile: Profile::default() });
    }

    /// Tunes the plan over the gates and appends its spans to `out`.
    fn improve(&mut self, blocks: &[PathBlock], out: &mut Vec<Span>) {
        // A raised gate needs no split, and a split makes gates that can be raised.
        self.tune(blocks);
        self.split_slow_spans(blocks);
        self.tune(blocks);
        out.extend(self.gates.windows(2).map(|g| Span {
            first: g[0].junction,
            last: g[1].junction,
            profile: g[1].profile,
        }));
    }

    /// Runs the stack pass over all proposals.
    fn connect_all(&mut self, blocks: &[PathBlock], end: KinematicState) -> Result<(), PlanError> {
        let n = blocks.len();
        let mut since = UNLIMITED;
        let mut elapsed = 0.0;
        for k in 1..n {
            since = since.with(SpanLimits::of(&blocks[k - 1..k]));
            elapsed += self.envelope.time[k - 1];
            let valley = self.envelope.is_valley(blocks, k);
            let spaced = elapsed >= SPACING * blocks[k].limits.a / blocks[k].limits.j;
            if self.envelope.touches[k] && (valley || spaced) {
                elapsed = 0.0;
                self.attach(
                    blocks,
                    k,
                    KinematicState::moving(self.envelope.cap[k], self.envelope.a[k]),
                    &mut since,
                    (0, valley),
                )?;
            }
        }
        since = since.with(SpanLimits::of(&blocks[n - 1..]));
        if self.attach(blocks, n, end, &mut since, (0, false))? { Ok(()) } else { Err(PlanError) }
    }

    /// Connects junction `k` in state `to` to the gates so far; false where it cannot be reached. `since` holds the
    /// limits between the last gate and `k`, and afterwards those beyond the last gate. `must`: another state is better
    /// than none.
    fn attach(
        &mut self,
        blocks: &[PathBlock],
        k: usize,
        to: KinematicState,
        since: &mut SpanLimits,
        (depth, must): (u8, bool),
    ) -> Result<bool, PlanError> {
        while let Some(&left) = self.gates.last() {
            match self.span(blocks, &left, k, to, *since)? {
                Ok(profile) => match self.overshoot(left.junction, k, &profile) {
                    None => {
                        self.gates.push(PlanGate { junction: k, v: to.v, a: to.a, limits: *since, profile });
                        *since = UNLIMITED;
                        return Ok(true);
                    }
                    Some((junction, a)) => {
                        self.insert(blocks, left.junction, junction, a, depth)?;
                        let last = self.gates.last().map_or(0, |gate| gate.junction);
                        *since = SpanLimits::of(&blocks[last..k]);
                    }
                },
                Err(ProfileError::TargetTooHigh) if self.has_slow_block(blocks, left, k, to, depth) => {
                    let slow = self.slow_end;
                    self.tries[slow] += 1;
                    let (v, mut before) = (self.envelope.v[slow], SpanLimits::of(&blocks[left.junction..slow]));
                    self.attach(blocks, slow, KinematicState::moving(v, 0.0), &mut before, (depth + 1, false))?;
                    let last = self.gates.last().map_or(0, |gate| gate.junction);
                    *since = SpanLimits::of(&blocks[last..k]);
                }
                Err(error) if self.relax(blocks, k, to, since, error)? => return Ok(true),
                Err(ProfileError::TargetTooHigh) if k < blocks.len() => return Ok(false),
                Err(error) if self.gates.len() == 1 => {
                    let eased = error == ProfileError::StartTooHigh
                        && (must && self.tries[k] <= 2 || k == blocks.len())
                        && self.ease(blocks, k, to, since, depth)?;
                    // The start is fixed: skip k, and check its cap when the span is longer.
                    return if eased || k < blocks.len() { Ok(eased) } else { Err(PlanError) };
                }
                Err(_) => {
                    *since = since.with(left.limits);
                    self.gates.pop();
                }
            }
        }
        Err(PlanError)
    }

    /// Connects junction `k` with zero acceleration there, or at the last gate, which brakes too hard to reach `k`
    /// afterwards; false where that does not help.
    fn relax(
        &mut self,
        blocks: &[PathBlock],
        k: usize,
        to: KinematicState,
        since: &mut SpanLimits,
        error: ProfileError,
    ) -> Result<bool, PlanError> {
        let Some(&left) = self.gates.last() else { return Ok(false) };
        // The state at the end of the path does not change. Every other junction is tried with zero acceleration: a
        // gate that was dropped because it could not brake to this one is lost, even if this one is given up later.
        let levels = to.a != 0.0 && k < blocks.len();
        if levels && self.push_span(blocks, left, k, KinematicState::moving(to.v, 0.0), since)? {
            return Ok(true);
        }
        let [.., before, _] = self.gates[..] else { return Ok(false) };
        if error != ProfileError::TargetTooHigh || left.a >= 0.0 {
            return Ok(false);
        }
        let Ok(profile) =
            self.span(blocks, &before, left.junction, KinematicState::moving(left.v, 0.0), left.limits)?
        else {
            return Ok(false);
        };
        if self.overshoot(before.junction, left.junction, &profile).is_some() {
            return Ok(false);
        }
        let flat = PlanGate { a: 0.0, profile, ..left };
        let pushed = self.push_span(blocks, flat, k, to, since)?;
        if pushed {
            let last = self.gates.len() - 2;
            self.gates[last] = flat;
        }
        Ok(pushed)
    }

    /// Whether the cap of a slow block holds the crest of the last span, from `left`, below the speed at junction `k`.
    ///
    /// The end of that block is made a gate then. Otherwise every later junction may be too fast for that crest: the
    /// search would never recover, and one span at the cap of the slow block would lead to the end of the path.
    fn has_slow_block(&self, blocks: &[PathBlock], left: PlanGate, k: usize, to: KinematicState, depth: u8) -> bool {
        let slow = self.slow_end;
        slow > left.junction
            && slow < k
            && depth <= TRIES.1
            && self.tries[slow] < SLOW_TRIES
            && blocks[slow - 1].limits.v < to.v
    }

    /// Connects junction `k` over a gate half-distance, from where braking is possible however tight the limits are
    /// there: each half of the path is then braked on within its own limits. False where that does not help.
    fn ease(
        &mut self,
        blocks: &[PathBlock],
        k: usize,
        to: KinematicState,
        since: &mut SpanLimits,
        depth: u8,
    ) -> Result<bool, PlanError> {
        let left = self.gates.last().map_or(0, |gate| gate.junction);
        if k < left + 2 || depth > HALVINGS {
            return Ok(false);
        }
        let (from, end) = (self.envelope.s[left], self.envelope.s[k]);
        let middle = self.envelope.s.partition_point(|s| *s < 0.5 * (from + end)).clamp(left + 1, k - 1);
        let behind = SpanLimits::of(&blocks[middle..k]);
        let limits = PathLimits { v: behind.fastest, ..behind.tight };
        let second_half = PathBlock { length: end - self.envelope.s[middle], limits, exit_v: to.v };
        let v = rest_to_rest::reach(to.v, &second_half).min(self.envelope.v[middle]);
        let to = if k < blocks.len() { KinematicState { a: 0.0, ..to } } else { to };
        for share in EASED {
            let mut ahead = SpanLimits::of(&blocks[left..middle]);
            if self.attach(blocks, middle, KinematicState::moving(share * v, 0.0), &mut ahead, (depth + 1, true))? {
                *since = behind;
                return self.attach(blocks, k, to, since, (depth + 1, false));
            }
        }
        Ok(false)
    }

    /// Makes junction `k` a gate if one legal span leads to it from `left`, which is or replaces the last gate.
    fn push_span(
        &mut self,
        blocks: &[PathBlock],
        left: PlanGate,
        k: usize,
        to: KinematicState,
        since: &mut SpanLimits,
    ) -> Result<bool, PlanError> {
        let Ok(profile) = self.span(blocks, &left, k, to, *since)? else { return Ok(false) };
        let legal = self.overshoot(left.junction, k, &profile).is_none();
        if legal {
            self.gates.push(PlanGate { junction: k, v: to.v, a: to.a, limits: *since, profile });
            *since = UNLIMITED;
        }
        Ok(legal)
    }

    /// Makes the overshot junction `m` a gate: at its cap with the slope `a` of the span; if that was tried before, at
    /// ever lower speeds.
    fn insert(&mut self, blocks: &[PathBlock], left: usize, m: usize, a: f64, depth: u8) -> Result<(), PlanError> {
        let mut since = SpanLimits::of(&blocks[left..m]);
        loop {
            let tries = self.tries[m];
            self.tries[m] = tries.saturating_add(1);
            if depth > TRIES.1 || tries > TRIES.0 {
                return Err(PlanError);
            }
            let own = self.envelope.a[m];
            let (share, a) = match tries {
                0 => (1.0, a),
                1 => (1.0, own),
                2 => (0.99, a),
                3 => (0.97, own),
                4 => (0.95, a),
                more => (0.93f64.powi(i32::from(more) - 4), 0.0),
            };
            let v = self.envelope.cap[m] * share;
            let tight = since.tight.tighter(blocks[m].limits);
            let most = gate_acceleration(v, PathLimits { a: 0.999 * tight.a, ..tight });
            if self.attach(blocks, m, KinematicState::moving(v, a.clamp(-most, most)), &mut since, (depth + 1, true))? {
                return Ok(());
            }
        }
    }

    /// The fastest profile from gate `left` to junction `k` in state `to` whose crest observes the limits of the blocks
    /// under it.
    fn span(
        &mut self,
        blocks: &[PathBlock],
        left: &PlanGate,
        k: usize,
        to: KinematicState,
        stretch: SpanLimits,
    ) -> Result<Result<Profile, ProfileError>, PlanError> {
        let start = self.envelope.s[left.junction];
        let length = self.envelope.s[k] - start;
        let mut v = stretch.fastest;
        self.slow_end = 0;
        for _ in 0..8 {
            self.work = self.work.checked_sub(1).ok_or(PlanError)?;
            let profile = match fastest(left.state(), to, length, PathLimits { v, ..stretch.tight }) {
                Ok(profile) => profile,
                Err(error) => return Ok(Err(error)),
            };
            if v <= stretch.tight.v {
                return Ok(Ok(profile));
            }
            let (peak, begin, end) = profile.crest();
            let (mut cap, mut slow) = (f64::MAX, 0);
            for (m, block) in (left.junction..k).zip(&blocks[left.junction..k]) {
                let is_under_crest = self.envelope.s[m + 1] >= start + begin && self.envelope.s[m] <= start + end;
                if is_under_crest && block.limits.v <= cap {
                    (cap, slow) = (block.limits.v, m + 1);
                }
            }
            if peak <= cap * (1.0 + 1e-9) {
                return Ok(Ok(profile));
            }
            v = cap;
            self.slow_end = slow;
        }
        Ok(Err(ProfileError::TargetTooHigh))
    }

    /// The worst overshoot of a touching cap strictly inside a span: the junction and the acceleration of the span
    /// there.
    fn overshoot(&self, first: usize, last: usize, profile: &Profile) -> Option<(usize, f64)> {
        let mut walk = ProfileWalk::new(profile);
        let (mut worst, mut found) = (1.0 + 1e-9, None);
        for m in first + 1..last {
            if self.envelope.touches[m] {
                let KinematicState { v, a, .. } = walk.at(self.envelope.s[m] - self.envelope.s[first]);
                if v > self.envelope.cap[m] * worst {
                    worst = v / self.envelope.cap[m].max(1e-12);
                    found = Some((m, a));
                }
            }
        }
        found
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Paths of all kinds: tiny and long blocks, caps that wander or jump, limits that change, full stops.
    pub(crate) fn block_path() -> impl Strategy<Value = Vec<PathBlock>> {
        let block = (-3.0..1.5f64, 0.0..1.0f64, 0.05..1.0f64, 0.1..1.0f64, 0.0..1.0f64, prop::bool::weighted(0.1));
        (prop::collection::vec(block, 1..80), 0.02..1.0f64).prop_map(|(blocks, least)| {
            blocks
                .into_iter()
                .map(|(size, v, a, j, exit, stop)| {
                    let v = 100.0 * (least + (1.0 - least) * v);
                    let limits = PathLimits { v, a: 900.0 * a.max(least), j: 18_000.0 * j.max(least) };
                    PathBlock { length: 10f64.powf(size), limits, exit_v: if stop { 0.0 } else { exit * 100.0 } }
                })
                .collect()
        })
    }

    /// Spans follow one another from (v, a) to rest, and observe every limit of every block under them.
    pub(crate) fn check(blocks: &[PathBlock], spans: &[Span], start: KinematicState) -> Result<(), String> {
        let (mut junction, mut state) = (0, start);
        for span in spans {
            let Span { first, last, profile } = span;
            if *first != junction || (profile.v0, profile.a0) != (state.v, state.a) {
                return Err(format!("the span at junction {first} does not follow junction {junction}"));
            }
            let (duration, mut begin) = (profile.duration(), 0.0);
            for block in &blocks[*first..*last] {
                let (from, to) = (profile.time_at(begin), profile.time_at(begin + block.length).min(duration));
                for k in 0..=20 {
                    let KinematicState { v, a, .. } = profile.at(from + (to - from) * f64::from(k) / 20.0);
                    let PathLimits { v: v_max, a: a_max, j: j_max } = block.limits;
                    if v > v_max * (1.0 + 1e-7) || a.abs() > a_max * (1.0 + 1e-7) || profile.jerk > j_max * (1.0 + 1e-9)
                    {
                        return Err(format!("{v} mm/s, {a} mm/s², {} mm/s³ in {:?}", profile.jerk, block.limits));
                    }
                    if k == 20 && v > block.exit_v * (1.0 + 1e-7) + 1e-6 {
                        return Err(format!("{v} mm/s over an exit at {}", block.exit_v));
                    }
                }
                begin += block.length;
            }
            let end = profile.at(duration);
            if (end.s - begin).abs() > 1e-9 {
                return Err(format!("the span to junction {last} ends {} mm off", end.s - begin));
            }
            (junction, state) = (*last, KinematicState::moving(end.v, end.a));
            // The next span starts in the exact state of the gate.
            if let Some(next) = spans.iter().find(|next| next.first == junction) {
                let gap = (next.profile.v0 - state.v).abs().max(1e-3 * (next.profile.a0 - state.a).abs());
                if gap > 1e-8 {
                    return Err(format!("a gap of {gap} at junction {junction}"));
                }
                state = KinematicState::moving(next.profile.v0, next.profile.a0);
            }
        }
        if junction == blocks.len() && state.v.abs() < 1e-8 { Ok(()) } else { Err("does not end at rest".into()) }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        #[test]
        fn plans_are_legal_from_rest_and_from_their_own_gates(blocks in block_path(),
            pick in any::<prop::sample::Index>()) {
            let (mut look_ahead, mut spans) = (LookAhead::default(), Vec::new());
            if look_ahead.plan(&blocks, (0.0, 0.0), KinematicState::default(), &mut spans).is_err() {
                prop_assert!(spans.is_empty());
                return Ok(());
            }
            prop_assert_eq!(check(&blocks, &spans, KinematicState::default()), Ok(()));
            let bound: f64 = look_ahead.envelope.time.iter().sum();
            let total: f64 = spans.iter().map(|span| span.profile.duration()).sum();
            prop_assert!(total >= bound * (1.0 - 1e-9), "faster than the envelope: {} < {}", total, bound);
            let gate = spans[pick.index(spans.len())];
            let mut fresh = Vec::new();
            if look_ahead.plan(&blocks[gate.first..], (gate.profile.v0, gate.profile.a0), KinematicState::default(),
                &mut fresh).is_ok() {
                let start = KinematicState::moving(gate.profile.v0, gate.profile.a0);
                prop_assert_eq!(check(&blocks[gate.first..], &fresh, start), Ok(()));
            }
        }
    }

    #[test]
    fn a_line_in_many_blocks_is_planned_like_one_block() {
        let limits = PathLimits { v: 100.0, a: 900.0, j: 18_000.0 };
        let time = |n: usize| {
            let blocks = vec![PathBlock { length: 100.0 / n as f64, limits, exit_v: f64::MAX }; n];
            let mut spans = Vec::new();
            LookAhead::default()
                .plan(&blocks, (0.0, 0.0), KinematicState::default(), &mut spans)
                .expect("a straight line has a plan");
            spans.iter().map(|span| span.profile.duration()).sum::<f64>()
        };
        for n in [2, 7, 100, 5000] {
            assert!((time(n) - time(1)).abs() < 1e-9, "{n} blocks: {} s, one block: {} s", time(n), time(1));
        }
    }
}
