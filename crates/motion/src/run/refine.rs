//! Refinement of the plan of a run before it is committed.
//!
//! The plan is cut at knots, a few milliseconds apart, and each stretch between two slow places is replaced by a faster
//! speed law between the same two states. Near rest the plan remains: there the square of the speed is no quadratic.
//!
//! Invariant: blocks, piece numbers and places stay those of the path; only the speed between the knots changes. How
//! far the plan is refined depends on the path alone.

use super::{PlanMode, PlanRun};
use crate::emitter::Emitter;
use crate::envelope::PathBlock;
use crate::profile::{PathLimits, Profile};
use crate::span::Span;
use crate::speed_law::SpeedLawRefiner;
use crate::speed_law::law_path::{LawPart, LawPath, LawSegment};

/// Longest and shortest time between two knots, s.
const KNOTS: (f64, f64) = (6e-3, 2e-3);
/// A remainder of a piece or of a span that is shorter than this, mm, counts as zero.
const SLIVER: f64 = 1e-9;
/// Shortest segment, mm, but between two knots that have to be there: over a shorter one the acceleration loses digits.
const SHORTEST: f64 = 1e-4;
/// Speed below which the plan remains, mm/s.
const SLOWEST: f64 = 2.0;
/// Fewest segments of a stretch that is refined.
const FEWEST: usize = 6;
/// How often a stretch for which no law is found is halved.
const HALVINGS: u8 = 3;
/// Time beyond the part that is committed next that is refined with it, s.
const BEYOND: f64 = 0.25;

/// Refiner of runs; it retains its memory.
#[derive(Debug)]
pub(super) struct RunRefiner<const A: usize> {
    laws: SpeedLawRefiner,
    knots: Vec<Knot>,
    path: LawPath<A>,
    states: Vec<(f64, f64)>,
}

impl<const A: usize> Default for RunRefiner<A> {
    fn default() -> Self {
        Self { laws: SpeedLawRefiner::default(), knots: Vec::new(), path: LawPath::default(), states: Vec::new() }
    }
}

/// Start of a segment.
#[derive(Clone, Copy, Debug)]
struct Knot {
    /// Place, mm from the start of the run.
    s: f64,
    /// State of the plan.
    v: f64,
    a: f64,
    /// Span of the plan, and place in it.
    span: usize,
    at: f64,
    /// Number of the piece, and place on it.
    piece: u64,
    on: f64,
    /// Whether it has to be there: a span of the plan begins, or a speed is limited at this place.
    is_fixed: bool,
}

/// Adds a knot; of two that are too close together one that need not be there is left out.
fn push_apart(knots: &mut Vec<Knot>, knot: Knot) {
    while let Some(last) = knots.last()
        && knot.s - last.s < SHORTEST
    {
        if !knot.is_fixed {
            return;
        }
        if last.is_fixed {
            break;
        }
        knots.pop();
    }
    knots.push(knot);
}

impl<const A: usize> PlanRun<A> {
    /// Refines what is committed next, and a little more.
    pub(super) fn refine_part(&mut self, emitter: &Emitter<A>) {
        if self.mode == PlanMode::Fast {
            return;
        }
        let s = self.joints();
        let target = if self.length > 2.0 * self.keep { self.length - self.keep } else { s[self.blocks.len() / 2] };
        // From there on the plan may be replaced.
        let settled = self.plan.get(self.settled()).map_or(0.0, |span| s[span.first]);
        let (mut at, mut beyond) = (0.0, 0.0);
        for span in &self.plan {
            at = s[span.last];
            if at > target {
                beyond += span.profile.duration();
            }
            if beyond > BEYOND {
                break;
            }
        }
        self.refine(at.min(settled), emitter);
    }

    /// Refines the plan up to place `until`, mm from the start of the run.
    pub(super) fn refine(&mut self, until: f64, emitter: &Emitter<A>) {
        if self.mode == PlanMode::Fast || self.plan.is_empty() {
            return;
        }
        let mut refiner = std::mem::take(&mut self.refiner);
        if self.lay_knots(&mut refiner, until, emitter) {
            self.replace_stretches(&mut refiner, emitter);
        }
        self.refiner = refiner;
    }

    /// Start of the run: number of its first piece, and the place on it.
    fn start_of_run(&self, emitter: &Emitter<A>) -> (u64, f64) {
        let (mut first, mut skip) = (self.next_piece, -self.length);
        while skip < -1e-12
            && let Some(piece) = first.checked_sub(1).and_then(|before| emitter.piece(before))
        {
            (first, skip) = (first - 1, skip + piece.length);
        }
        (first, skip.max(0.0))
    }

    /// Cuts the plan at knots; false where nothing can be refined.
    fn lay_knots(&self, refiner: &mut RunRefiner<A>, until: f64, emitter: &Emitter<A>) -> bool {
        let s = self.joints();
        let end = s[self.plan[self.plan.len() - 1].last].min(until);
        let (mut piece, mut on) = self.start_of_run(emitter);
        let knots = &mut refiner.knots;
        knots.clear();
        let (mut at, mut span, mut curved) = (0.0, 0, false);
        let knot = |at: f64, span: &mut usize, piece: u64, on: f64| {
            while *span + 1 < self.plan.len() && at >= s[self.plan[*span].last] {
                *span += 1;
            }
            let in_span = at - s[self.plan[*span].first];
            let state = self.plan[*span].profile.at_place(in_span);
            Knot { s: at, v: state.v, a: state.a, span: *span, at: in_span, piece, on, is_fixed: in_span == 0.0 }
        };
        let mut since = f64::MAX;
        while at < end - 1e-9 && piece < self.next_piece {
            let Some(here) = emitter.piece(piece) else { return false };
            let first = knot(at, &mut span, piece, on);
            let span_ends = s[self.plan[span].last];
            let left = (here.length - on).min(end - at).min(span_ends - at);
            let at_end = left >= here.length - on - SLIVER;
            if left > SLIVER {
                let mut look = span;
                let last = knot(at + left, &mut look, piece, on);
                let seconds = left / (0.5 * (first.v + last.v)).max(0.5);
                if since >= KNOTS.1 || first.v < SLOWEST || first.at == 0.0 {
                    push_apart(knots, Knot { is_fixed: first.at == 0.0 || since == f64::MAX, ..first });
                    since = 0.0;
                }
                let cuts = (seconds / KNOTS.0).ceil().clamp(1.0, 1e5) as usize;
                for k in 1..cuts {
                    let part = left * k as f64 / cuts as f64;
                    push_apart(knots, knot(at + part, &mut span, piece, on + part));
                }
                since = if cuts > 1 { seconds / cuts as f64 } else { since + seconds };
                if at_end && here.exit_v < f64::MAX {
                    since = f64::MAX;
                }
                curved |= !here.curve.is_line();
            }
            // Exactly at the end of the span, so that a knot is there.
            at = if at + left >= span_ends - SLIVER { span_ends } else { at + left };
            (piece, on) = if at_end { (piece + 1, 0.0) } else { (piece, on + left) };
        }
        if knots.is_empty() {
            return false;
        }
        push_apart(knots, Knot { is_fixed: true, ..knot(end, &mut span, piece, on) });
        curved && knots.len() > FEWEST
    }

    /// Refines each stretch between two slow knots and lays plan and blocks anew.
    fn replace_stretches(&mut self, refiner: &mut RunRefiner<A>, emitter: &Emitter<A>) {
        let knots = std::mem::take(&mut refiner.knots);
        let n = knots.len() - 1;
        let mut laws: Vec<(usize, Vec<Profile>)> = Vec::new();
        let mut first = 0;
        while first < n {
            if knots[first].v < SLOWEST {
                first += 1;
                continue;
            }
            let mut last = first;
            while last < n && knots[last + 1].v >= SLOWEST {
                last += 1;
            }
            self.refine_halves(refiner, &knots, (first, last, 0), emitter, &mut laws);
            first = last + 1;
        }
        if !laws.is_empty() {
            self.adopt_laws(&knots, &laws, emitter);
        }
        refiner.knots = knots;
    }

    /// Refines the stretch between two knots; where that fails, each half of it.
    fn refine_halves(
        &self,
        refiner: &mut RunRefiner<A>,
        knots: &[Knot],
        (first, last, depth): (usize, usize, u8),
        emitter: &Emitter<A>,
        laws: &mut Vec<(usize, Vec<Profile>)>,
    ) {
        if last - first < FEWEST {
            return;
        }
        if let Some(law) = self.refine_stretch(refiner, &knots[first..=last], emitter) {
            laws.push((first, law));
        } else if depth < HALVINGS {
            let middle = first.midpoint(last);
            self.refine_halves(refiner, knots, (first, middle, depth + 1), emitter, laws);
            self.refine_halves(refiner, knots, (middle, last, depth + 1), emitter, laws);
        }
    }

    /// The faster law between the first and the last of `knots`.
    fn refine_stretch(
        &self,
        refiner: &mut RunRefiner<A>,
        knots: &[Knot],
        emitter: &Emitter<A>,
    ) -> Option<Vec<Profile>> {
        let RunRefiner { laws, path, states, .. } = refiner;
        path.segments.clear();
        path.parts.clear();
        states.clear();
        let mut seconds = 0.0;
        for pair in knots.windows(2) {
            let (from, to) = (&pair[0], &pair[1]);
            states.push((from.v, from.a));
            let length = to.s - from.s;
            let (mut v, mut exit_v, mut covered) = (f64::MAX, f64::MAX, 0.0);
            let (mut piece, mut on) = (from.piece, from.on);
            while covered < length - 1e-9 {
                let here = emitter.piece(piece)?;
                let part = (here.length - on).min(length - covered);
                let (limit, a, j) = here.axis_limits(&self.axes, self.factor);
                v = v.min(limit);
                if part > 1e-12 {
                    path.parts.push(LawPart { curve: here.curve.from(on), length: part, a, j });
                }
                covered += part;
                exit_v = if on + part >= here.length - 1e-9 { here.exit_v } else { f64::MAX };
                if exit_v < f64::MAX && covered < length - 1e-9 {
                    return None;
                }
                (piece, on) = (piece + 1, 0.0);
            }
            path.segments.push(LawSegment { length, v, exit_v, parts_end: path.parts.len() });
        }
        let last = knots[knots.len() - 1];
        states.push((last.v, last.a));
        for pair in knots.windows(2) {
            seconds += self.time_at_knot(&pair[1]) - self.time_at_knot(&pair[0]);
            for span in pair[0].span..pair[1].span {
                seconds += self.plan[span].profile.duration();
            }
        }
        laws.refine(path, states, seconds)
    }

    /// Time of a knot in its span.
    fn time_at_knot(&self, knot: &Knot) -> f64 {
        self.plan[knot.span].profile.time_at(knot.at)
    }

    /// Replaces blocks and plan up to the last knot.
    fn adopt_laws(&mut self, knots: &[Knot], laws: &[(usize, Vec<Profile>)], emitter: &Emitter<A>) {
        let s = self.joints();
        let n = knots.len() - 1;
        let (mut blocks, mut numbers, mut plan) = (Vec::new(), Vec::new(), Vec::new());
        for pair in knots.windows(2) {
            let (from, to) = (&pair[0], &pair[1]);
            let last = if to.on > 1e-9 { to.piece } else { to.piece - 1 };
            let mut limits: Option<PathLimits> = None;
            for number in from.piece..=last {
                if let Some(piece) = emitter.piece(number) {
                    let rough = piece.limit_options(&self.axes, self.factor).rough;
                    limits = Some(limits.map_or(rough, |limits| limits.tighter(rough)));
                }
            }
            let exit_v =
                if to.on > 1e-9 { f64::MAX } else { emitter.piece(last).map_or(f64::MAX, |piece| piece.exit_v) };
            if let Some(limits) = limits {
                blocks.push(PathBlock { length: to.s - from.s, limits, exit_v });
                numbers.push(from.piece + u64::from(from.on > 1e-9 && from.s > 0.0));
            }
        }
        if blocks.len() != n {
            return;
        }
        // What is kept of the plan, cut at the knots around the laws.
        let keep = |plan: &mut Vec<Span>, from: usize, to: usize| {
            let mut first = from;
            while first < to {
                let span = knots[first].span;
                let mut last = first + 1;
                while last < to && knots[last].span == span {
                    last += 1;
                }
                let whole = self.plan[span].profile;
                let begin = if knots[first].at > 0.0 { self.time_at_knot(&knots[first]) } else { 0.0 };
                // Near rest the time at a place has few digits: the end of a span is not looked for.
                let within = knots[last].span == span && knots[last].at < self.plan[span].profile.end().s - SLIVER;
                let part = if within { whole.cut(self.time_at_knot(&knots[last])).0 } else { whole };
                plan.push(Span { first, last, profile: part.cut(begin).1 });
                first = last;
            }
        };
        let mut at = 0;
        for (first, law) in laws {
            keep(&mut plan, at, *first);
            plan.extend(law.iter().enumerate().map(|(k, profile)| Span {
                first: first + k,
                last: first + k + 1,
                profile: *profile,
            }));
            at = first + law.len();
        }
        keep(&mut plan, at, n);
        // The rest of the last span, and everything behind it.
        let end = knots[n];
        let behind = s.partition_point(|place| *place <= end.s + 1e-9);
        if end.s < s[self.blocks.len()] - 1e-9 {
            let whole = self.plan[end.span];
            let inside = s[behind] - end.s;
            let block = self.blocks[behind - 1];
            // Where the end is inside a block, the rest of it is a block of its own.
            let split = end.s > s[behind - 1] + 1e-9;
            let from_block = behind - 1;
            for k in from_block..self.blocks.len() {
                let mut one = self.blocks[k];
                let mut number = self.numbers[k];
                if k == from_block && split {
                    one = PathBlock { length: inside, ..block };
                    number = end.piece + u64::from(end.on > 1e-9);
                }
                blocks.push(one);
                numbers.push(number);
            }
            let shift = |junction: usize| junction - from_block + n;
            let begin = self.time_at_knot(&end);
            let rest = if end.at > 1e-12 { whole.profile.cut(begin).1 } else { whole.profile };
            plan.push(Span { first: n, last: shift(whole.last), profile: rest });
            plan.extend(self.plan[end.span + 1..].iter().map(|span| Span {
                first: shift(span.first),
                last: shift(span.last),
                profile: span.profile,
            }));
        }
        self.planned = self.planned + blocks.len() - self.blocks.len();
        (self.blocks, self.numbers, self.plan) = (blocks, numbers, plan);
    }
}
