//! A plan over gates at zero acceleration near both ends of the path, for the case that the search finds none.
//!
//! A path that begins behind a glide, or ends in one, has a large acceleration there. Spans have the tightest limits of
//! all their blocks, so the first and the last span must not reach beyond the blocks that allow this acceleration; the
//! search proposes gates by the envelope and may have none there. Here such gates are set, ever slower ones, and the
//! search plans between them.
//!
//! Invariant: every span is checked as in any other plan.

use super::{LookAhead, PlanError, PlanGate, SpanLimits, UNLIMITED};
use crate::envelope::PathBlock;
use crate::profile::{KinematicState, Profile};
use crate::rest_to_rest;
use crate::span::Span;

/// Numbers of blocks from an end to its gate that are tried, in turn.
const REACHES: [usize; 11] = [1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144];
/// Speeds of a gate, as shares of the envelope.
const SHARES: [f64; 7] = [1.0, 0.85, 0.7, 0.5, 0.3, 0.15, 0.05];
/// Most gates at each end.
const MAX_GATES: usize = 32;
/// Most blocks that are planned between pairs of gates.
const MAX_BLOCKS: usize = 8192;

/// Gate at zero acceleration near an end, and the profile between it and the end.
#[derive(Clone, Copy, Debug)]
struct ZoneGate {
    junction: usize,
    v: f64,
    /// `None` where the gate is the end itself.
    profile: Option<Profile>,
}

impl LookAhead {
    /// Plans like [`LookAhead::plan`], over a gate near each end at which the path begins or ends with an acceleration.
    ///
    /// # Errors
    /// [`PlanError`]; `out` is unchanged then.
    pub(crate) fn plan_over_zones(
        &mut self,
        blocks: &[PathBlock],
        (v0, a0): (f64, f64),
        end: KinematicState,
        out: &mut Vec<Span>,
    ) -> Result<(), PlanError> {
        let n = blocks.len();
        self.begin(blocks, (v0, a0), end);
        let starts = self.start_gates(blocks, KinematicState::moving(v0, a0));
        let ends = self.end_gates(blocks, end);
        let mut middle = Vec::new();
        // From the gate at the start the motion must be able to come to rest.
        let unable = starts.iter().take_while(|first| {
            middle.clear();
            !self.plan_from_gate(blocks, first, None, &mut middle)
        });
        let starts = &starts[unable.count()..];
        let pairs = (0..starts.len() + ends.len()).flat_map(|sum| (0..=sum).map(move |k| (k, sum - k)));
        let pairs = pairs.filter_map(|(k, l)| Some((*starts.get(k)?, *ends.get(l)?)));
        let mut left = MAX_BLOCKS;
        let (first, last) = pairs
            .filter(|(first, last)| first.junction < last.junction)
            .take_while(|(first, last)| {
                let count = last.junction - first.junction;
                left = left.saturating_sub(count);
                left > 0
            })
            .find(|(first, last)| {
                middle.clear();
                self.plan_from_gate(blocks, first, Some(last), &mut middle)
            })
            .ok_or(PlanError)?;
        let begin = first.profile.map(|profile| Span { first: 0, last: first.junction, profile });
        let behind = last.profile.map(|profile| Span { first: last.junction, last: n, profile });
        let spans: Vec<Span> = begin.into_iter().chain(middle).chain(behind).collect();
        self.begin(blocks, (v0, a0), end);
        self.gates.extend(spans.iter().enumerate().map(|(k, span)| {
            let next = spans.get(k + 1).map_or(end, |next| next.profile.start());
            let limits = SpanLimits::of(&blocks[span.first..span.last]);
            PlanGate { junction: span.last, v: next.v, a: next.a, limits, profile: span.profile }
        }));
        self.improve(blocks, out);
        Ok(())
    }

    /// Plans from gate `first` to gate `last`, or to rest at the end of the path, into `spans`; false where no plan is
    /// found.
    fn plan_from_gate(
        &mut self,
        blocks: &[PathBlock],
        first: &ZoneGate,
        last: Option<&ZoneGate>,
        spans: &mut Vec<Span>,
    ) -> bool {
        let (to, v) = last.map_or((blocks.len(), 0.0), |last| (last.junction, last.v));
        let from = first.junction;
        let found = self.plan(&blocks[from..to], (first.v, 0.0), KinematicState::moving(v, 0.0), spans).is_ok()
            || rest_to_rest::plan_between(&blocks[from..to], first.v, v, spans);
        for span in spans {
            (span.first, span.last) = (span.first + from, span.last + from);
        }
        found
    }

    /// Gates near the start that can be reached from it, the fastest of each junction first.
    fn start_gates(&mut self, blocks: &[PathBlock], start: KinematicState) -> Vec<ZoneGate> {
        let mut found = Vec::new();
        if start.a == 0.0 {
            found.push(ZoneGate { junction: 0, v: start.v, profile: None });
        }
        let left = PlanGate { junction: 0, v: start.v, a: start.a, limits: UNLIMITED, profile: Profile::default() };
        for junction in REACHES.into_iter().take_while(|reach| *reach < blocks.len()) {
            for share in SHARES {
                let v = share * self.envelope.v[junction];
                found.extend(
                    self.zone_span(blocks, left, junction, KinematicState::moving(v, 0.0)).map(|profile| ZoneGate {
                        junction,
                        v,
                        profile: Some(profile),
                    }),
                );
            }
        }
        found.truncate(MAX_GATES);
        found
    }

    /// Gates near the end from which it can be reached, the fastest of each junction first.
    fn end_gates(&mut self, blocks: &[PathBlock], end: KinematicState) -> Vec<ZoneGate> {
        let n = blocks.len();
        if end.a == 0.0 {
            return vec![ZoneGate { junction: n, v: end.v, profile: None }];
        }
        let mut found = Vec::new();
        for junction in REACHES.into_iter().filter_map(|reach| n.checked_sub(reach)).take_while(|at| *at > 0) {
            for share in SHARES {
                let v = share * self.envelope.v[junction];
                let left = PlanGate { junction, v, a: 0.0, limits: UNLIMITED, profile: Profile::default() };
                found.extend(self.zone_span(blocks, left, n, end).map(|profile| ZoneGate {
                    junction,
                    v,
                    profile: Some(profile),
                }));
            }
        }
        found.truncate(MAX_GATES);
        found
    }

    /// The fastest legal profile from `left` to junction `k` in state `to`.
    fn zone_span(&mut self, blocks: &[PathBlock], left: PlanGate, k: usize, to: KinematicState) -> Option<Profile> {
        let limits = SpanLimits::of(&blocks[left.junction..k]);
        let profile = self.span(blocks, &left, k, to, limits).ok()?.ok()?;
        self.overshoot(left.junction, k, &profile).is_none().then_some(profile)
    }
}
