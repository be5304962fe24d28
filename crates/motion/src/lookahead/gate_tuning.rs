//! Tuning of a plan that the look-ahead has found: slow spans are split, and single gates dropped or raised.
//!
//! Invariant: a change is accepted only where every span that it touches is legal and all of them together take no more
//! time.

use super::{LookAhead, PlanError, PlanGate, SpanLimits};
use crate::envelope::{PathBlock, gate_acceleration};
use crate::profile::{KinematicState, PathLimits};

/// Gates that are further apart than this many blocks are not tried without the one between them.
const DROP_REACH: usize = 256;
/// A span is split if it takes at least so many times as long as the envelope, …
const SLOW: f64 = 1.05;
/// … and if the halves take less than this part of its time, …
const SAVES: f64 = 0.99;
/// … or if they cover at least this many blocks: then a smaller part may save more.
const MANY_BLOCKS: usize = 4;

/// Change that tuning makes to one gate.
enum GateChange {
    Keep,
    /// The gate is dropped; the next gate is reached by one span.
    Drop(PlanGate),
    /// The gate and the next gate, with their new spans.
    Move(PlanGate, PlanGate),
}

impl LookAhead {
    /// Splits spans that are much slower than the envelope at one of their junctions, in the state that they have
    /// there.
    ///
    /// A span has the tightest limits of all its blocks, each half only those of its own, so the halves together are
    /// no slower. They are split in turn. So a block with tight limits costs time near itself only.
    pub(super) fn split_slow_spans(&mut self, blocks: &[PathBlock]) {
        let mut waiting = std::mem::take(&mut self.gates);
        let mut done = std::mem::take(&mut self.tuned);
        done.clear();
        waiting.reverse();
        done.extend(waiting.pop());
        while let (Some(right), Some(&left)) = (waiting.pop(), done.last()) {
            match self.split(blocks, left, right) {
                Some((middle, right)) => waiting.extend([right, middle]),
                None => done.push(right),
            }
        }
        self.gates = done;
        self.tuned = waiting;
    }

    /// The gate in the middle of the span from `left` to `right`, and `right` with its shorter span; `None` where
    /// nothing is gained.
    fn split(&mut self, blocks: &[PathBlock], left: PlanGate, right: PlanGate) -> Option<(PlanGate, PlanGate)> {
        let (first, last, profile) = (left.junction, right.junction, right.profile);
        let least: f64 = self.envelope.time[first..last].iter().sum();
        if last - first < 2 || profile.duration() < SLOW * least {
            return None;
        }
        let (from, to) = (self.envelope.s[first], self.envelope.s[last]);
        let half = self.envelope.s.partition_point(|s| *s < 0.5 * (from + to)).clamp(first + 1, last - 1);
        let (before, after) = profile.cut(profile.time_at(self.envelope.s[half] - from));
        let limits = [SpanLimits::of(&blocks[first..half]), SpanLimits::of(&blocks[half..last])];
        let middle = PlanGate { junction: half, v: after.v0, a: after.a0, limits: limits[0], profile: before };
        let right = PlanGate { limits: limits[1], profile: after, ..right };
        let one = self.faster(blocks, left, middle);
        let two = self.faster(blocks, middle, right);
        let enough = if last - first >= MANY_BLOCKS { 1.0 + 1e-9 } else { SAVES };
        let pays = one.profile.duration() + two.profile.duration() < enough * profile.duration();
        pays.then_some((one, two))
    }

    /// The gate `right` with the fastest span from `left`, where that is faster than its own and legal.
    fn faster(&mut self, blocks: &[PathBlock], left: PlanGate, right: PlanGate) -> PlanGate {
        match self.span(blocks, &left, right.junction, right.state(), right.limits) {
            Ok(Ok(profile))
                if profile.duration() < right.profile.duration()
                    && self.overshoot(left.junction, right.junction, &profile).is_none() =>
            {
                PlanGate { profile, ..right }
            }
            _ => right,
        }
    }

    /// Tries to drop or raise each gate. A change is accepted only where both spans it touches stay legal and together
    /// take less time.
    pub(super) fn tune(&mut self, blocks: &[PathBlock]) {
        let mut old = std::mem::take(&mut self.gates);
        let mut new = std::mem::take(&mut self.tuned);
        new.clear();
        new.push(old[0]);
        for g in 1..old.len() - 1 {
            let (gate, right) = (old[g], old[g + 1]);
            let Some(&left) = new.last() else { break };
            let Ok(change) = self.better(blocks, left, gate, right) else {
                new.extend_from_slice(&old[g..old.len() - 1]);
                break;
            };
            match change {
                GateChange::Keep => new.push(gate),
                GateChange::Drop(merged) => old[g + 1] = merged,
                GateChange::Move(moved, next) => {
                    new.push(moved);
                    old[g + 1] = next;
                }
            }
        }
        new.extend(old.last().copied());
        self.gates = new;
        self.tuned = old;
    }

    fn better(
        &mut self,
        blocks: &[PathBlock],
        left: PlanGate,
        gate: PlanGate,
        right: PlanGate,
    ) -> Result<GateChange, PlanError> {
        let both = gate.limits.with(right.limits);
        let s = |junction: usize| self.envelope.s[junction];
        let time = gate.profile.duration() + right.profile.duration();
        if time * both.tight.v <= (s(right.junction) - s(left.junction)) * (1.0 + 1e-9) {
            return Ok(GateChange::Keep); // at the speed limit throughout
        }
        if right.junction - left.junction <= DROP_REACH
            && let Ok(profile) = self.span(blocks, &left, right.junction, right.state(), both)?
            && profile.duration() < time
            && self.overshoot(left.junction, right.junction, &profile).is_none()
        {
            return Ok(GateChange::Drop(PlanGate { limits: both, profile, ..right }));
        }
        let cap = self.envelope.cap[gate.junction];
        for v in [cap, 0.5 * (gate.v + cap), 0.8 * gate.v + 0.2 * cap] {
            if gate.v >= cap {
                break;
            }
            let most = gate_acceleration(v, PathLimits { a: 0.9999 * both.tight.a, ..both.tight });
            let to = KinematicState::moving(v, gate.a.clamp(-most, most));
            let Ok(one) = self.span(blocks, &left, gate.junction, to, gate.limits)? else { continue };
            let moved = PlanGate { v, a: to.a, profile: one, ..gate };
            let Ok(two) = self.span(blocks, &moved, right.junction, right.state(), right.limits)? else { continue };
            if one.duration() + two.duration() < time
                && self.overshoot(left.junction, gate.junction, &one).is_none()
                && self.overshoot(gate.junction, right.junction, &two).is_none()
            {
                return Ok(GateChange::Move(moved, PlanGate { profile: two, ..right }));
            }
        }
        Ok(GateChange::Keep)
    }
}
