//! A run: the path since the last stop, as far as its plan is not committed.
//!
//! Invariant: the plan over the first `planned` blocks ends at rest; what is committed of it can always be followed by
//! the rest of it. Only the number and length of the pieces, and the records after which the override is changed,
//! decide when a part is committed. Where possible, a run that ends at rest takes whole periods (SMO-9).

mod fallback_plan;
mod plan_mode;
mod refine;
mod replan;

pub use plan_mode::{PlanFallbacks, PlanMode};

use crate::accel_split::{LimitOptions, LimitSelector};
use crate::emitter::{Emitter, PlanItem};
use crate::envelope::PathBlock;
use crate::limits::AxisLimits;
use crate::lookahead::LookAhead;
use crate::piece::{PathPiece, PieceJunction};
use crate::planned_section::{self, PlannedSection};
use crate::profile::{KinematicState, PathLimits, Profile, lengthened, slowed};
use crate::span::Span;

/// Path since the last stop, as far as it is not committed.
#[derive(Debug)]
pub(crate) struct PlanRun<const A: usize> {
    axes: AxisLimits<A>,
    /// Factor of programmed feeds.
    factor: f64,
    /// The last piece and the junction at its start, retained until the junction at its end is known.
    tail: Option<(PathPiece<A>, PieceJunction)>,
    blocks: Vec<PathBlock>,
    /// Options of the limits of the blocks behind the planned ones.
    options: Vec<LimitOptions>,
    choice: LimitSelector,
    /// Number of the first piece of each block.
    numbers: Vec<u64>,
    /// Number of the piece after the last block.
    next_piece: u64,
    /// Sum of the lengths of the blocks, mm.
    length: f64,
    /// Speed and acceleration at the start.
    v: f64,
    a: f64,
    /// Time since the last stop that is committed, less whole periods, s.
    elapsed: f64,
    /// Limits of a run that begins in motion.
    lead: PathLimits,
    /// Plan over the first `planned` blocks; it ends at rest.
    plan: Vec<Span>,
    planned: usize,
    look_ahead: LookAhead,
    /// Spans of the next plan, retained for their memory.
    fresh: Vec<Span>,
    /// Length of path in mm that is retained when a part of the plan is committed.
    keep: f64,
    /// Number of blocks after which the run is planned and partly committed however short they are.
    max_blocks: usize,
    /// Number of times that the plan could not be extended since it last was.
    failures: usize,
    fallbacks: PlanFallbacks,
    refiner: refine::RunRefiner<A>,
    /// Number of blocks whose plan is refined and remains.
    refined: usize,
    mode: PlanMode,
    /// Whether a run that ends at rest takes whole periods.
    takes_whole_periods: bool,
}

/// Number of blocks after which a run is planned and partly committed even if they are short.
const MAX_BLOCKS: usize = 8192;
/// Number of blocks that are planned together where the path is long enough.
const BATCH: usize = 48;
/// Stopping distances from the end of a plan to the part that more path does not change.
const SPARE: f64 = 1.5;
/// Part of a period: a run that exceeds a border between periods by less than this ends on it.
const PERIOD_SLACK: f64 = 1e-6;
/// Smooth pieces are planned together up to this length, mm: what is shorter is passed in less than a few periods.
const GROUP: f64 = 0.02;

impl<const A: usize> PlanRun<A> {
    pub(crate) fn new(axes: AxisLimits<A>) -> Self {
        let (v, a, j) = (axes.path_v, smallest(axes.a), smallest(axes.j));
        let stopping = 0.5 * v * (v / a + a / j);
        Self {
            axes,
            factor: 1.0,
            tail: None,
            blocks: Vec::new(),
            options: Vec::new(),
            choice: LimitSelector::default(),
            numbers: Vec::new(),
            next_piece: 0,
            length: 0.0,
            v: 0.0,
            a: 0.0,
            elapsed: 0.0,
            lead: PathLimits { v, a, j },
            plan: Vec::new(),
            planned: 0,
            look_ahead: LookAhead::default(),
            fresh: Vec::new(),
            keep: 3.0 * stopping,
            max_blocks: MAX_BLOCKS,
            failures: 0,
            fallbacks: PlanFallbacks::default(),
            refiner: refine::RunRefiner::default(),
            refined: 0,
            mode: PlanMode::default(),
            takes_whole_periods: true,
        }
    }

    /// Sets how much is calculated for a faster plan of what is not committed yet.
    pub(crate) fn set_mode(&mut self, mode: PlanMode) {
        self.mode = mode;
    }

    /// Does not slow a run down so that it takes whole periods.
    pub(crate) fn keep_feed(&mut self) {
        self.takes_whole_periods = false;
    }

    /// What is committed and not emitted.
    pub(crate) fn sections(&self, emitter: &Emitter<A>) -> Vec<PlannedSection<A>> {
        planned_section::sections(emitter, &self.axes, self.factor)
    }

    /// Number of fallbacks so far.
    pub(crate) fn fallbacks(&self) -> PlanFallbacks {
        self.fallbacks
    }

    /// Sets the look-ahead to `blocks` blocks, whatever their length.
    pub(crate) fn set_look_ahead(&mut self, blocks: usize) {
        (self.keep, self.max_blocks) = (f64::MAX, blocks.max(2));
    }

    /// Appends a piece that is entered through `entry`.
    pub(crate) fn push(&mut self, piece: PathPiece<A>, entry: PieceJunction, emitter: &mut Emitter<A>) {
        self.push_tail(entry, emitter);
        self.tail = Some((piece, entry));
        let fresh = self.blocks.len() - self.planned;
        let must = self.length > 8.0 * self.keep || self.blocks.len() >= self.max_blocks;
        if must || self.length > 2.0 * self.keep && fresh >= (self.failures + 1) * BATCH {
            if must {
                self.replan(KinematicState::default(), false);
            } else if !self.extend() {
                self.failures += 1;
                return;
            }
            self.refine_part(emitter);
            self.commit_part(emitter);
            self.failures = 0;
        }
    }

    /// Plans and commits everything, to rest; returns the number of the next piece.
    pub(crate) fn finish(&mut self, emitter: &mut Emitter<A>) -> u64 {
        self.push_tail(PieceJunction::STOP, emitter);
        self.replan(KinematicState::default(), true);
        self.refine_all(emitter);
        self.stop_on_a_period();
        self.commit_all(emitter);
        self.elapsed = 0.0;
        self.next_piece
    }

    /// Begins the next run in motion, after a glide of `glide` seconds. Within `limits` it must be able to come to rest
    /// on its first piece.
    pub(crate) fn begin(&mut self, start: KinematicState, limits: PathLimits, glide: f64) {
        (self.v, self.a) = (start.v, start.a);
        self.lead = limits;
        self.add_time(glide);
    }

    /// Adds `seconds` to the committed time.
    fn add_time(&mut self, seconds: f64) {
        self.elapsed = (self.elapsed + seconds) % self.axes.period;
    }

    /// Slows the plan, which ends at rest, down until the run takes whole periods (SMO-9): the last period exists
    /// anyway. A plan from rest is slowed as a whole; otherwise one of its spans rises less high, or the last period is
    /// not filled.
    fn stop_on_a_period(&mut self) {
        let period = self.axes.period;
        let duration: f64 = self.plan.iter().map(|span| span.profile.duration()).sum();
        let periods = (self.elapsed + duration) / period;
        let missing = ((periods - PERIOD_SLACK).ceil() - periods) * period;
        if missing <= 0.0 || duration <= 0.0 || !self.takes_whole_periods {
            return;
        }
        if self.v == 0.0 && self.a == 0.0 {
            for span in &mut self.plan {
                span.profile = slowed(&span.profile, 1.0 + missing / duration);
            }
            return;
        }
        let mut to = KinematicState::default();
        for span in self.plan.iter_mut().rev() {
            if let Some(slower) = lengthened(&span.profile, to, missing) {
                span.profile = slower;
                return;
            }
            to = span.profile.start();
        }
    }

    /// Plans and commits everything, to state `end`, or to rest where that cannot be reached. Returns the number of the
    /// next piece, and whether `end` was reached.
    pub(crate) fn finish_moving(&mut self, end: KinematicState, emitter: &mut Emitter<A>) -> (u64, bool) {
        self.push_tail(PieceJunction { v: end.v, share: 0.0 }, emitter);
        let reached = self.replan(end, true) || self.approach(end, emitter);
        self.refine_all(emitter);
        if reached {
            self.commit_all(emitter);
        } else {
            self.stop_on_a_period();
            self.commit_all(emitter);
            self.elapsed = 0.0;
        }
        (self.next_piece, reached)
    }

    /// Adds the last piece to the path once the junction at its end is known.
    fn push_tail(&mut self, exit: PieceJunction, emitter: &mut Emitter<A>) {
        let Some((mut piece, entry)) = self.tail.take() else { return };
        piece.rough_entry = entry.share > 0.0;
        (piece.share, piece.exit_v) = (entry.share.max(exit.share), exit.v);
        let offer = piece.limit_options(&self.axes, self.factor);
        let number = emitter.append(piece);
        self.next_piece = number + 1;
        self.length += piece.length;
        // The first block of a run that begins in motion does not change, so that it is long enough to stop in; nor
        // does the last block before a glide, which begins within its limits.
        let glides = exit.v > 0.0 && exit.v < f64::MAX && exit.share == 0.0;
        let grows = (self.blocks.len() > 1 || self.v == 0.0) && !glides;
        if let Some((block, last)) = self.blocks.last_mut().zip(self.options.last_mut())
            && grows
            && entry == PieceJunction::SMOOTH
            && block.length + piece.length <= GROUP
        {
            block.length += piece.length;
            *last = last.tighter(&offer);
            block.exit_v = exit.v;
        } else {
            self.blocks.push(PathBlock { length: piece.length, limits: offer.rough, exit_v: exit.v });
            self.options.push(offer);
            self.numbers.push(number);
        }
    }

    /// Plans all blocks to rest from the gate on that more path cannot change, or from a gate near it if that has
    /// failed before. Returns false, with nothing changed, where no such plan exists. With more path there may be one,
    /// as the path does not end here.
    fn extend(&mut self) -> bool {
        if !self.choose(false) {
            return true;
        }
        // In turn one further back and one further on.
        let aside = self.failures.div_ceil(2);
        let settled = self.settled();
        let gate = if self.failures % 2 == 1 { settled.saturating_sub(aside) } else { settled + aside };
        let found = (gate == 0 || gate < self.plan.len()) && self.plan_from_gate(gate, KinematicState::default());
        if found {
            self.options.clear();
            self.adopt_plan(gate);
        }
        found
    }

    /// Chooses the limits of the blocks behind the planned ones; false where there are none.
    fn choose(&mut self, ends: bool) -> bool {
        let before = self.blocks.len().saturating_sub(self.options.len());
        let v = before.checked_sub(1).map_or(self.v, |last| self.blocks[last].limits.v.min(self.blocks[last].exit_v));
        self.choice.choose(&mut self.blocks[before..], &self.options, v, ends);
        before < self.blocks.len()
    }

    /// Plans all blocks behind gate `gate` of the current plan; false where no such plan exists.
    fn plan_from_gate(&mut self, gate: usize, end: KinematicState) -> bool {
        let (first, from) = self.state_at(gate);
        self.plan_from(first, from, end)
    }

    /// First block behind gate `gate` of the current plan, and speed and acceleration there.
    fn state_at(&self, gate: usize) -> (usize, (f64, f64)) {
        let state = self.plan.get(gate).map(|span| (span.first, (span.profile.v0, span.profile.a0)));
        state.unwrap_or((0, (self.v, self.a)))
    }

    /// Appends the fresh spans to the current plan behind gate `gate`.
    fn adopt_plan(&mut self, gate: usize) {
        let beyond = self.plan.get(gate).map_or(self.planned, |span| span.first);
        self.plan.truncate(gate);
        self.refined = self.refined.min(beyond);
        self.plan.extend(self.fresh.drain(..).map(|span| Span {
            first: span.first + beyond,
            last: span.last + beyond,
            ..span
        }));
        self.planned = self.blocks.len();
    }

    /// The gate that more path cannot change: the last before the plan brakes to its end, and one more for the tuning
    /// of gates, or one from which the end is far enough away to stop with a margin. Otherwise the plan would lose a
    /// little time there, no more.
    fn settled(&self) -> usize {
        let v = |gate: usize| self.plan[gate].profile.v0;
        let rises =
            (1..self.plan.len()).rev().find(|&gate| v(gate - 1) <= v(gate)).map_or(0, |gate| gate.saturating_sub(2));
        let (mut limits, mut rest) = (PathLimits { v: f64::MAX, a: f64::MAX, j: f64::MAX }, 0.0);
        let far = (rises..self.plan.len()).rev().find(|&gate| {
            for block in &self.blocks[self.plan[gate].first..self.plan[gate].last] {
                limits = limits.tighter(block.limits);
                rest += block.length;
            }
            rest > SPARE * 0.5 * v(gate) * (v(gate) / limits.a + limits.a / limits.j)
        });
        far.unwrap_or(rises)
    }

    /// Plans the blocks from number `first` on into `fresh`; false where no plan exists between these states.
    fn plan_from(&mut self, first: usize, from: (f64, f64), end: KinematicState) -> bool {
        first < self.blocks.len() && self.look_ahead.plan(&self.blocks[first..], from, end, &mut self.fresh).is_ok()
    }

    /// Commits the whole plan.
    fn commit_all(&mut self, emitter: &mut Emitter<A>) {
        let s = self.joints();
        for span in &self.plan {
            emitter.commit(self.item(span.profile, s[span.last] - s[span.first], span.last - 1));
        }
        self.add_time(self.plan.iter().map(|span| span.profile.duration()).sum());
        self.plan.clear();
        self.blocks.clear();
        self.numbers.clear();
        (self.planned, self.v, self.a, self.length, self.refined) = (0, 0.0, 0.0, 0.0, 0);
    }

    /// Places of all junctions, mm from the start.
    fn joints(&self) -> Vec<f64> {
        let mut sum = 0.0;
        let ends = self.blocks.iter().map(|block| {
            sum += block.length;
            sum
        });
        std::iter::once(0.0).chain(ends).collect()
    }

    /// Committed form of `profile` over `length` mm, which ends in block `last`.
    fn item(&self, profile: Profile, length: f64, last: usize) -> PlanItem<A> {
        let last = self.numbers.get(last + 1).map_or(self.next_piece, |number| *number) - 1;
        PlanItem::Span { profile, duration: profile.duration(), length, last }
    }

    /// Commits the plan up to a place inside the block `keep` before the end, or in the middle of the blocks where they
    /// are shorter than that.
    fn commit_part(&mut self, emitter: &mut Emitter<A>) {
        let s = self.joints();
        let target = if self.length > 2.0 * self.keep { self.length - self.keep } else { s[self.blocks.len() / 2] };
        let block = s.partition_point(|&s| s <= target).clamp(1, self.blocks.len()) - 1;
        // Away from the junctions, so that no block has zero length.
        let (from, to) = (s[block], s[block + 1]);
        let target = target.clamp(0.75 * from + 0.25 * to, 0.25 * from + 0.75 * to);
        let cut = self.plan.partition_point(|span| s[span.last] <= target);
        let Some(&crossing) = self.plan.get(cut) else { return };
        for span in &self.plan[..cut] {
            emitter.commit(self.item(span.profile, s[span.last] - s[span.first], span.last - 1));
        }
        let length = target - s[crossing.first];
        let (before, after) = crossing.profile.cut(crossing.profile.time_at(length));
        emitter.commit(self.item(before, length, block));
        self.add_time(self.plan[..cut].iter().map(|span| span.profile.duration()).sum::<f64>() + before.duration());
        self.plan.drain(..cut);
        self.plan[0].profile = after;
        for span in &mut self.plan {
            span.first = span.first.saturating_sub(block);
            span.last -= block;
        }
        self.blocks.drain(..block);
        self.blocks[0].length = to - target;
        self.numbers.drain(..block);
        self.planned -= block;
        self.refined = self.refined.saturating_sub(block);
        self.length -= target;
        (self.v, self.a) = (after.v0, after.a0);
    }
}

/// Smallest of the limits of all axes.
pub(crate) fn smallest<const A: usize>(values: [f64; A]) -> f64 {
    values.into_iter().fold(f64::MAX, f64::min)
}
