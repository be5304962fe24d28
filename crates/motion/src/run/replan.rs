//! Planning again, with another factor of the feeds, what is not emitted.
//!
//! Glides and stops that are committed do not change, so the path is the same for every factor. Between them the pieces
//! are planned from one end state to the other. The first section begins in the state at the end of the last record.
//! Behind the last stop or glide the path is open, and what is committed of it returns to the run.
//!
//! A state may be too fast, or accelerate too hard, for the limits that the new factor gives. So the limits of the
//! factor before are tried along the distance that the state takes to stop. If there is still no plan, the old one
//! remains up to one of its next spans. Where nothing helps, the whole old plan remains.
//!
//! Invariant: every span is legal by the same check as in any other plan; positions, speed and acceleration are
//! continuous.

use std::collections::VecDeque;

use super::{GROUP, PlanRun};
use crate::accel_split::LimitOptions;
use crate::emitter::{Emitter, PlanItem};
use crate::envelope::PathBlock;
use crate::profile::{KinematicState, PathLimits, Profile, stopping_distance};
use crate::span::Span;

/// Distance in which a state is brought down to lower limits, over its stopping distance.
const SLOWING_DISTANCE: f64 = 1.05;
/// Feeds, as shares of the programmed ones, at which a plan into a glide is tried where none is found otherwise.
const APPROACHES: [f64; 4] = [1.0, 0.7, 0.5, 0.3];
/// How often the number of spans that are planned again for that is doubled.
const APPROACHED: usize = 5;
/// A remainder of a piece that is shorter than this, in mm, counts as zero.
const SLIVER: f64 = 1e-12;

/// A profile of the old plan.
#[derive(Clone, Copy, Debug)]
struct CommittedPlan<const A: usize> {
    item: PlanItem<A>,
    profile: Profile,
    length: f64,
}

/// Pieces between two states, both of which are fixed.
#[derive(Clone, Copy, Debug)]
struct ReplanSection {
    /// Number of the first piece, and the distance from its start to the start of the section, mm.
    first: u64,
    skip: f64,
    /// Number of the piece behind it.
    to: u64,
    end: KinematicState,
    /// Whether the path continues behind it.
    open: bool,
}

/// Pieces laid out as blocks.
#[derive(Debug, Default)]
struct ReplanLayout {
    blocks: Vec<PathBlock>,
    options: Vec<LimitOptions>,
    /// For each block, one more than the number of the last piece of the block before.
    numbers: Vec<u64>,
    length: f64,
    /// Whether the last block may grow.
    grows: bool,
}

impl ReplanLayout {
    /// Appends a block, or extends the last one.
    fn push(&mut self, number: u64, offer: &LimitOptions, block: (f64, f64), joins: bool) {
        let (length, exit_v) = block;
        self.length += length;
        if let Some((last, of_last)) = self.blocks.last_mut().zip(self.options.last_mut())
            && joins
            && self.grows
            && last.exit_v == f64::MAX
            && last.length + length <= GROUP
        {
            last.length += length;
            last.exit_v = exit_v;
            *of_last = of_last.tighter(offer);
            last.limits = of_last.rough;
        } else {
            // The first block does not change, so that a run that begins in motion can stop in it.
            self.grows = !self.blocks.is_empty();
            self.blocks.push(PathBlock { length, limits: offer.rough, exit_v });
            self.options.push(*offer);
            self.numbers.push(number);
        }
    }
}

/// New plan, and how much of the old plan precedes it.
struct ReplanOutcome {
    retained_spans: usize,
    from: KinematicState,
    layout: ReplanLayout,
    spans: Vec<Span>,
}

impl<const A: usize> PlanRun<A> {
    /// Multiplies programmed feeds by `factor` from now on, and plans again what is not emitted.
    pub(crate) fn set_feed_factor(&mut self, factor: f64, emitter: &mut Emitter<A>) {
        if factor == self.factor {
            return;
        }
        let before = std::mem::replace(&mut self.factor, factor);
        let items = emitter.withdraw();
        let (mut first, mut skip) = emitter.front();
        let (mut fresh, mut old, mut glides) = (VecDeque::with_capacity(items.len()), Vec::new(), 0);
        for item in items {
            let (to, end) = match item {
                PlanItem::Span { profile, length, .. } => {
                    old.push(CommittedPlan { item, profile, length });
                    continue;
                }
                PlanItem::Glide { piece } => {
                    let [out, _] =
                        emitter.glide_after(glides).map_or([KinematicState::default(); 2], |glide| glide.ramps.ends());
                    glides += 1;
                    (piece, KinematicState::moving(out.v, -out.a))
                }
                PlanItem::Stop { piece, .. } => (piece, KinematicState::default()),
            };
            let section = ReplanSection { first, skip, to, end, open: false };
            self.replan_between(section, &old, before, emitter, &mut fresh);
            fresh.push_back(item);
            old.clear();
            (first, skip) = (to, 0.0);
        }
        emitter.recommit(fresh);
        let section = ReplanSection { first, skip, to: self.next_piece, end: KinematicState::default(), open: true };
        self.replan_open(section, old, before, emitter);
    }

    /// Plans between two fixed states and appends the plan to `out`; the old one where no other is found.
    fn replan_between(
        &mut self,
        section: ReplanSection,
        old: &[CommittedPlan<A>],
        before: f64,
        emitter: &Emitter<A>,
        out: &mut VecDeque<PlanItem<A>>,
    ) {
        // More speed somewhere need not be less time, as gates are proposed elsewhere then.
        let pays = |found: &ReplanOutcome| {
            let fresh: f64 = found.spans.iter().map(|span| span.profile.duration()).sum();
            fresh <= old[found.retained_spans..].iter().map(|old| old.profile.duration()).sum()
        };
        let raised = self.factor > before;
        let found = self.search(section, old, before, emitter).filter(|found| !raised || pays(found));
        out.extend(old[..found.as_ref().map_or(old.len(), |found| found.retained_spans)].iter().map(|old| old.item));
        let Some(ReplanOutcome { layout, spans, .. }) = found else { return };
        out.extend(spans.iter().map(|span| {
            let length = layout.blocks[span.first..span.last].iter().map(|block| block.length).sum();
            let last = layout.numbers.get(span.last).map_or(section.to, |number| *number) - 1;
            PlanItem::Span { profile: span.profile, duration: span.profile.duration(), length, last }
        }));
    }

    /// Brings the run, which is planned to rest, into state `end` nevertheless, at lower feeds than programmed, which
    /// leave more acceleration along curves; false where that does not help either. So a glide that is possible at one
    /// feed override is hardly ever given up at another one.
    pub(super) fn approach(&mut self, end: KinematicState, emitter: &Emitter<A>) -> bool {
        self.fallbacks.approaches += 1;
        let s = self.joints();
        let old: Vec<CommittedPlan<A>> = self.plan.iter().map(|span| self.old(span, &s)).collect();
        // Start of the run, counted from its end.
        let (mut first, mut skip) = (self.next_piece, -self.length);
        while skip < -SLIVER
            && let Some(piece) = first.checked_sub(1).and_then(|before| emitter.piece(before))
        {
            (first, skip) = (first - 1, skip + piece.length);
        }
        let section = ReplanSection { first, skip: skip.max(0.0), to: self.next_piece, end, open: false };
        let factor = self.factor;
        // What prevents the glide is at its end, so the last spans are planned again, ever more of them.
        let last = std::iter::successors(Some(1), |spans| Some(2 * spans)).take(APPROACHED);
        let gates = || last.clone().filter_map(|spans| old.len().checked_sub(spans));
        let found = APPROACHES.into_iter().filter(|share| *share <= factor).find_map(|share| {
            self.factor = share;
            gates().find_map(|gate| self.search_from(gate, section, &old, factor, emitter))
        });
        self.factor = factor;
        let Some(ReplanOutcome { retained_spans, layout, spans, .. }) = found else { return false };
        self.adopt_end(retained_spans, layout, spans);
        true
    }

    /// A span of the current plan in its committed form; `s` holds the places of the junctions.
    fn old(&self, span: &Span, s: &[f64]) -> CommittedPlan<A> {
        let (profile, length) = (span.profile, s[span.last] - s[span.first]);
        CommittedPlan { item: self.item(profile, length, span.last - 1), profile, length }
    }

    /// Plans the open end of the path: what is committed of it, and what is not.
    fn replan_open(
        &mut self,
        section: ReplanSection,
        mut old: Vec<CommittedPlan<A>>,
        before: f64,
        emitter: &mut Emitter<A>,
    ) {
        let committed = old.len();
        let s = self.joints();
        old.extend(self.plan.iter().map(|span| self.old(span, &s)));
        let found = self.search(section, &old, before, emitter);
        let retained_spans = found.as_ref().map_or(committed, |found| found.retained_spans);
        for old in &old[..retained_spans] {
            emitter.commit(old.item);
        }
        match found {
            Some(ReplanOutcome { from, layout, spans, .. }) => {
                self.adopt_layout(layout, from);
                (self.plan, self.planned) = (spans, self.blocks.len());
                self.options.clear();
                // Where the plan could be extended before, it can be now.
                if committed > retained_spans || self.length > 2.0 * self.keep {
                    self.commit_part(emitter);
                }
            }
            None if old.is_empty() => {
                let from = KinematicState::moving(self.v, self.a);
                let layout = self.lay(&section, None, emitter);
                self.adopt_layout(layout, from);
            }
            None => {}
        }
    }

    /// Replaces the plan behind its first `retained` spans, and the blocks under it.
    fn adopt_end(&mut self, retained: usize, layout: ReplanLayout, spans: Vec<Span>) {
        let first = self.plan[retained].first;
        // The block before ends where it did.
        let number = self.numbers[first];
        self.blocks.truncate(first);
        self.blocks.extend(layout.blocks);
        self.numbers.truncate(first);
        self.numbers.extend(layout.numbers);
        self.numbers[first] = number;
        self.plan.truncate(retained);
        self.plan.extend(spans.into_iter().map(|span| Span {
            first: span.first + first,
            last: span.last + first,
            ..span
        }));
        self.options.clear();
        (self.planned, self.refined) = (self.blocks.len(), self.refined.min(first));
    }

    /// Replaces the path that is not committed by `layout`, which begins in state `from`.
    fn adopt_layout(&mut self, layout: ReplanLayout, from: KinematicState) {
        (self.v, self.a) = (from.v, from.a);
        (self.length, self.refined) = (layout.length, 0);
        (self.blocks, self.options, self.numbers) = (layout.blocks, layout.options, layout.numbers);
    }

    /// Searches for a plan: from the start of the section, otherwise from that of one of the old plan's next spans.
    fn search(
        &mut self,
        section: ReplanSection,
        old: &[CommittedPlan<A>],
        before: f64,
        emitter: &Emitter<A>,
    ) -> Option<ReplanOutcome> {
        let later = std::iter::successors(Some(1), |gate| Some(2 * gate)).take_while(|&gate| gate < old.len());
        std::iter::once(0)
            .chain(later)
            .take_while(|_| !old.is_empty())
            .find_map(|gate| self.search_from(gate, section, old, before, emitter))
    }

    /// Searches for a plan from the start of span `retained_spans` of the old plan on.
    fn search_from(
        &mut self,
        retained_spans: usize,
        section: ReplanSection,
        old: &[CommittedPlan<A>],
        before: f64,
        emitter: &Emitter<A>,
    ) -> Option<ReplanOutcome> {
        let skip = section.skip + old[..retained_spans].iter().map(|old| old.length).sum::<f64>();
        let from = old[retained_spans].profile.start();
        for zone in [None, Some((from, before))] {
            let mut layout = self.lay(&ReplanSection { skip, ..section }, zone, emitter);
            if layout.blocks.is_empty() {
                return None;
            }
            self.choice.choose(&mut layout.blocks, &layout.options, from.v, !section.open);
            let mut spans = Vec::new();
            let (start, look_ahead) = ((from.v, from.a), &mut self.look_ahead);
            if look_ahead.plan(&layout.blocks, start, section.end, &mut spans).is_ok()
                || look_ahead.plan_over_zones(&layout.blocks, start, section.end, &mut spans).is_ok()
            {
                return Some(ReplanOutcome { retained_spans, from, layout, spans });
            }
        }
        None
    }

    /// Lays the pieces of `section` out as blocks. In a `zone` from its start, in which a state can stop, limits are
    /// those of another factor, at no more speed than the state has or reaches.
    fn lay(
        &self,
        section: &ReplanSection,
        mut zone: Option<(KinematicState, f64)>,
        emitter: &Emitter<A>,
    ) -> ReplanLayout {
        let (mut layout, mut skip) = (ReplanLayout::default(), section.skip);
        let mut tight = PathLimits { v: f64::MAX, a: f64::MAX, j: f64::MAX };
        let mut joins = false;
        for (number, piece) in (section.first..section.to).map_while(|number| Some((number, emitter.piece(number)?))) {
            if skip >= piece.length - SLIVER {
                skip = (skip - piece.length).max(0.0);
                continue;
            }
            let (mut number, mut length, offer) =
                (number, piece.length - skip, piece.limit_options(&self.axes, self.factor));
            skip = 0.0;
            if let Some((from, factor)) = zone {
                let held = piece.limit_options(&self.axes, factor);
                tight = tight.tighter(held.rough).tighter(held.calm);
                let peak = from.v + 0.5 * from.a.max(0.0).powi(2) / tight.j;
                let part = (SLOWING_DISTANCE * stopping_distance(from, tight) - layout.length).min(length);
                if part > SLIVER {
                    let whole = part >= length - SLIVER;
                    let part = if whole { length } else { part };
                    let exit_v = if whole { piece.exit_v } else { f64::MAX };
                    layout.push(number, &held.up_to(peak.max(offer.v)), (part, exit_v), joins && !piece.rough_entry);
                    length -= part;
                    joins = whole;
                }
                if length > 0.0 {
                    // Where the zone ends within this piece, the block before ends in it too.
                    number += u64::from(part > SLIVER);
                    (zone, joins) = (None, false);
                }
            }
            if length > 0.0 {
                layout.push(number, &offer, (length, piece.exit_v), joins && !piece.rough_entry);
                joins = true;
            }
        }
        layout
    }
}
