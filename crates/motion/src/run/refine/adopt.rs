//! Blocks and plan of a run with refined laws in it.
//!
//! Invariant: blocks, numbers and spans cover the same path as before; outside the laws the plan is what it was.

use super::RunRefiner;
use super::knots::{Knot, SLIVER};
use crate::emitter::Emitter;
use crate::envelope::PathBlock;
use crate::profile::{PathLimits, Profile};
use crate::run::PlanRun;
use crate::span::Span;

/// Blocks, their numbers and the plan over them, as they grow.
#[derive(Default)]
struct RefinedPlan {
    blocks: Vec<PathBlock>,
    numbers: Vec<u64>,
    plan: Vec<Span>,
}

impl<const A: usize> PlanRun<A> {
    /// Replaces blocks and plan from block `first` to the last knot; `s` holds the places of the junctions.
    pub(super) fn adopt_laws(&mut self, refiner: &mut RunRefiner<A>, first: usize, s: &[f64], emitter: &Emitter<A>) {
        let RunRefiner { knots, law, .. } = refiner;
        drop_useless_knots(knots, law);
        let mut refined = RefinedPlan::default();
        self.copy_before(&knots[0], first, &mut refined);
        let mut known = (u64::MAX, PathLimits { v: 0.0, a: 0.0, j: 0.0 });
        for pair in knots.windows(2) {
            let Some((block, number)) = self.block_between(&pair[0], &pair[1], &mut known, emitter) else { return };
            refined.blocks.push(block);
            refined.numbers.push(number);
        }
        self.append_laws(knots, law, first, &mut refined.plan);
        self.copy_behind(&knots[knots.len() - 1], s, &mut refined);
        self.planned = self.planned + refined.blocks.len() - self.blocks.len();
        (self.blocks, self.numbers, self.plan) = (refined.blocks, refined.numbers, refined.plan);
    }

    /// Copies what precedes block `first`, at which the first knot is.
    fn copy_before(&self, knot: &Knot, first: usize, refined: &mut RefinedPlan) {
        refined.blocks.extend(&self.blocks[..first]);
        refined.numbers.extend(&self.numbers[..first]);
        refined.plan.extend(&self.plan[..knot.span]);
        if knot.t > 0.0 {
            let span = self.plan[knot.span];
            refined.plan.push(Span { first: span.first, last: first, profile: span.profile.cut(knot.t).0 });
        }
    }

    /// Block between two knots, and its number. The limits of the piece that was looked at last are `known`.
    fn block_between(
        &self,
        from: &Knot,
        to: &Knot,
        known: &mut (u64, PathLimits),
        emitter: &Emitter<A>,
    ) -> Option<(PathBlock, u64)> {
        let last = if to.on > SLIVER { to.piece } else { to.piece - 1 };
        let limits = (from.piece..=last)
            .filter_map(|number| {
                if known.0 != number {
                    *known = (number, emitter.piece(number)?.limit_options(&self.axes, self.factor).rough);
                }
                Some(known.1)
            })
            .reduce(PathLimits::tighter)?;
        let at_border = to.on <= SLIVER;
        let exit_v = if at_border { emitter.piece(last).map_or(f64::MAX, |piece| piece.exit_v) } else { f64::MAX };
        let number = from.piece + u64::from(from.on > SLIVER && from.s > 0.0);
        Some((PathBlock { length: to.s - from.s, limits, exit_v }, number))
    }

    /// Appends the laws, and the plan between them, over the blocks from number `first` on.
    fn append_laws(&self, knots: &[Knot], law: &[Option<Profile>], first: usize, plan: &mut Vec<Span>) {
        let mut k = 0;
        while k < law.len() {
            if let Some(profile) = law[k] {
                plan.push(Span { first: first + k, last: first + k + 1, profile });
                k += 1;
                continue;
            }
            let (begin, span) = (&knots[k], self.plan[knots[k].span]);
            let mut last = k + 1;
            while last < law.len() && law[last].is_none() && knots[last].span == begin.span {
                last += 1;
            }
            let end = &knots[last];
            let is_within = end.span == begin.span && end.t < span.profile.duration();
            let part = if is_within { span.profile.cut(end.t).0 } else { span.profile };
            let profile = if begin.t > 0.0 { part.cut(begin.t).1 } else { part };
            plan.push(Span { first: first + k, last: first + last, profile });
            k = last;
        }
    }

    /// Copies what follows the last knot: the rest of its span, and everything behind it.
    fn copy_behind(&self, end: &Knot, s: &[f64], refined: &mut RefinedPlan) {
        if end.s >= s[self.blocks.len()] - SLIVER {
            return;
        }
        let begin = refined.blocks.len();
        let behind = s.partition_point(|place| *place <= end.s + SLIVER);
        // Where the end is inside a block, the rest of it is a block of its own.
        let is_split = end.s > s[behind - 1] + SLIVER;
        refined.blocks.extend(&self.blocks[behind - 1..]);
        refined.numbers.extend(&self.numbers[behind - 1..]);
        if is_split {
            refined.blocks[begin].length = s[behind] - end.s;
            refined.numbers[begin] = end.piece + u64::from(end.on > SLIVER);
        }
        let shifted = |junction: usize| junction + begin - (behind - 1);
        let span = self.plan[end.span];
        if end.t < span.profile.duration() {
            let profile = if end.t > 0.0 { span.profile.cut(end.t).1 } else { span.profile };
            refined.plan.push(Span { first: begin, last: shifted(span.last), profile });
        }
        refined.plan.extend(self.plan[end.span + 1..].iter().map(|span| Span {
            first: shifted(span.first),
            last: shifted(span.last),
            profile: span.profile,
        }));
    }
}

/// Drops the knots that no law needs: between two segments over which the plan remains.
fn drop_useless_knots(knots: &mut Vec<Knot>, law: &mut Vec<Option<Profile>>) {
    let n = law.len();
    let is_useful = |knots: &[Knot], law: &[Option<Profile>], k: usize| {
        k == 0 || k == n || knots[k].is_fixed || law[k - 1].is_some() || law[k].is_some()
    };
    let mut kept = 0;
    for k in 0..=n {
        if is_useful(knots, law, k) {
            knots[kept] = knots[k];
            if k < n {
                law[kept] = law[k];
            }
            kept += 1;
        }
    }
    knots.truncate(kept);
    law.truncate(kept - 1);
}
