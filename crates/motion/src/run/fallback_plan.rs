//! Plans of a run that do not depend on the present plan's end: to a state, and to rest where no other plan is found.
//!
//! Invariant: there always is a plan afterwards, to rest at the end of the path at least.

use super::PlanRun;
use crate::envelope::PathBlock;
use crate::profile::{KinematicState, PathLimits, fastest};
use crate::rest_to_rest;
use crate::span::Span;

impl<const A: usize> PlanRun<A> {
    /// Plans all blocks to `end`: from the gate on that more path cannot change, otherwise from the current state.
    /// Where that fails too, the current plan remains up to one of its next gates, and the path beyond is planned from
    /// there; its last gate is at rest, and from rest there always is a plan to rest. Returns false where only that was
    /// left and `end` is not at rest. The path continues behind the blocks unless it `ends`.
    pub(super) fn replan(&mut self, end: KinematicState, ends: bool) -> bool {
        if !self.choose(ends) {
            return true;
        }
        self.options.clear();
        // What is refined remains.
        let first = self.plan.iter().rposition(|span| span.profile.growth != 0.0).map_or(0, |last| last + 1);
        let (settled, gates) = (self.settled().max(first), self.plan.len());
        let later = std::iter::successors(Some(1), |gate| Some(2 * gate)).map(|gate| first + gate);
        let later = later.take_while(|&gate| gate < gates);
        let tries = [settled, first].into_iter().take(if settled > first { 2 } else { 1 }).chain(later);
        let retained = tries
            .clone()
            .find(|&gate| self.plan_from_gate(gate, end))
            .or_else(|| tries.clone().find(|&gate| self.plan_over_zones(gate, end)));
        let reached = retained.is_some() || self.plan_from_rest(end);
        self.adopt_plan(retained.unwrap_or(self.plan.len()));
        reached
    }

    /// Plans all blocks behind gate `gate` over gates near both ends; false where no such plan is found.
    fn plan_over_zones(&mut self, gate: usize, end: KinematicState) -> bool {
        let (first, from) = self.state_at(gate);
        first < self.blocks.len()
            && self.look_ahead.plan_over_zones(&self.blocks[first..], from, end, &mut self.fresh).is_ok()
    }

    /// Plans the blocks behind the current plan, which ends at rest; false where that is to rest instead of `end`.
    fn plan_from_rest(&mut self, end: KinematicState) -> bool {
        self.fallbacks.no_plan += 1;
        if self.planned == 0 && self.v > 0.0 {
            self.fallbacks.stops_in_first_block += 1;
            self.stop_in_first_block();
        }
        if self.plan_from(self.planned, (0.0, 0.0), end) {
            return true;
        }
        if !self.plan_from(self.planned, (0.0, 0.0), KinematicState::default()) {
            rest_to_rest::plan(&self.blocks[self.planned..], &mut self.fresh);
        }
        end == KinematicState::default()
    }

    /// Brings a run that begins in motion and finds no other plan to rest at the end of its first block, which is long
    /// enough.
    fn stop_in_first_block(&mut self) {
        let PathBlock { length, limits, .. } = self.blocks[0];
        let (from, rest) = (KinematicState::moving(self.v, self.a), KinematicState::default());
        // Motion at rest does not need what a block leaves to a junction at its end; and slightly more than the feed is
        // better than a jump.
        let any_feed = PathLimits { v: f64::MAX, a: self.lead.a.max(self.a.abs()), ..self.lead };
        let stop =
            [limits, self.lead, any_feed].into_iter().find_map(|limits| fastest(from, rest, length, limits).ok());
        if let Some(profile) = stop {
            self.plan.push(Span { first: 0, last: 1, profile });
            self.planned = 1;
        }
    }
}
