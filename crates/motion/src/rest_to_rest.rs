//! The fallback: a plan with zero acceleration at every junction.
//!
//! Invariant: from rest it always exists, because a profile from rest to rest does over any length; it is legal like
//! any other plan, only slower.

use crate::envelope::PathBlock;
use crate::profile::{KinematicState, PathLimits, Profile, fastest};
use crate::span::Span;

/// Plans `blocks` from rest to rest and appends one span for each block to `out`.
pub(crate) fn plan(blocks: &[PathBlock], out: &mut Vec<Span>) {
    if !plan_between(blocks, 0.0, 0.0, out) {
        out.extend(blocks.iter().enumerate().map(|(k, b)| Span { first: k, last: k + 1, profile: rest_to_rest(b) }));
    }
}

/// Plans `blocks` from speed `v0` to speed `v1` with zero acceleration at every junction and appends one span for each
/// block to `out`; false, with nothing appended, where one of them is too fast.
pub(crate) fn plan_between(blocks: &[PathBlock], v0: f64, v1: f64, out: &mut Vec<Span>) -> bool {
    let spans_before = out.len();
    let found = flowing(blocks, (v0, v1), out).is_some();
    if !found {
        out.truncate(spans_before);
    }
    found
}

/// Plans each junction as fast as zero acceleration there allows; `None` where an end is too fast or a profile lost its
/// digits.
fn flowing(blocks: &[PathBlock], (v0, v1): (f64, f64), out: &mut Vec<Span>) -> Option<()> {
    let n = blocks.len();
    if n == 0 {
        return (v0 == v1).then_some(());
    }
    let mut v = vec![0.0f64; n + 1];
    (v[0], v[n]) = (v0, v1);
    for k in 1..n {
        v[k] = blocks[k - 1].exit_v.min(blocks[k - 1].limits.v).min(blocks[k].limits.v);
    }
    for k in (1..n).rev() {
        v[k] = v[k].min(reach(v[k + 1], &blocks[k]));
    }
    if v0 > reach(v[1], &blocks[0]) * (1.0 + 1e-5) {
        return None;
    }
    for k in 1..n {
        v[k] = v[k].min(reach(v[k - 1], &blocks[k - 1]));
    }
    for (k, block) in blocks.iter().enumerate() {
        let (from, to) = (KinematicState::moving(v[k], 0.0), KinematicState::moving(v[k + 1], 0.0));
        let profile = fastest(from, to, block.length, block.limits).ok()?;
        out.push(Span { first: k, last: k + 1, profile });
    }
    Some(())
}

/// Four equal phases of the jerk that the limits allow; it needs no root and no check.
fn rest_to_rest(block: &PathBlock) -> Profile {
    let PathLimits { v, a, j } = block.limits;
    let length = block.length;
    let t = (length / (2.0 * j)).cbrt().max((length / (2.0 * a)).sqrt()).max(length / (2.0 * v));
    Profile { v0: 0.0, a0: 0.0, jerk: length / (2.0 * t * t * t), times: [t, 0.0, t, 0.0, t, 0.0, t], growth: 0.0 }
}

/// Highest speed at the other end of a block that is at `v` at one end, with zero acceleration at both; rounded down by
/// a part in 10⁶.
pub(crate) fn reach(v: f64, block: &PathBlock) -> f64 {
    let PathLimits { a, j, .. } = block.limits;
    let distance = |dv: f64| {
        let time = if dv * j >= a * a { dv / a + a / j } else { 2.0 * (dv / j).sqrt() };
        (v + 0.5 * dv) * time
    };
    let most = block.limits.v.max(v) - v;
    if distance(most) <= block.length {
        return v + most;
    }
    // Where the acceleration limit is not met, the root x of the change solves x³ + 2vx = length·√j, a convex function;
    // Newton's steps come from above.
    let whole = block.length * j.sqrt();
    let mut x = whole.cbrt().min(whole / (2.0 * v));
    for _ in 0..8 {
        x -= (x * (x * x + 2.0 * v) - whole) / (3.0 * x * x + 2.0 * v);
    }
    let dv = if x * x * j < a * a {
        x * x
    } else {
        let half = v + 0.5 * a * a / j;
        let rest = 2.0 * (a * block.length - v * a * a / j);
        rest / (half + (half * half + rest).max(0.0).sqrt())
    };
    v + dv.clamp(0.0, most) * (1.0 - 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lookahead::tests::{block_path, check};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn there_always_is_a_legal_plan_from_rest(blocks in block_path()) {
            let mut spans = Vec::new();
            plan(&blocks, &mut spans);
            prop_assert_eq!(check(&blocks, &spans, KinematicState::default()), Ok(()));
            let crawling: Vec<Span> = blocks
                .iter()
                .enumerate()
                .map(|(k, b)| Span { first: k, last: k + 1, profile: rest_to_rest(b) })
                .collect();
            prop_assert_eq!(check(&blocks, &crawling, KinematicState::default()), Ok(()));
        }
    }

    /// A run whose only block is the stop in it leaves nothing to plan.
    #[test]
    fn no_blocks_need_no_plan() {
        let mut spans = Vec::new();
        plan(&[], &mut spans);
        assert!(spans.is_empty() && !plan_between(&[], 1.0, 2.0, &mut spans));
    }

    proptest! {
        /// The speed that is reached is the highest one that a profile without acceleration at its ends reaches.
        #[test]
        fn the_speed_at_the_other_end_is_the_highest(v in 0.0..90.0f64, size in -4.0..1.5f64, a in 20.0..900.0f64,
            j in 500.0..18_000.0f64) {
            let limits = PathLimits { v: 100.0, a, j };
            let block = PathBlock { length: 10f64.powf(size), limits, exit_v: f64::MAX };
            let reached = reach(v, &block);
            prop_assume!(reached > v + 1e-6);
            let is_reached = |to: f64| {
                let (from, to) = (KinematicState::moving(v, 0.0), KinematicState::moving(to, 0.0));
                fastest(from, to, block.length, limits).is_ok()
            };
            prop_assert!(is_reached(reached));
            prop_assert!(reached == 100.0 || !is_reached(v + (reached - v) * (1.0 + 1e-5)));
        }
    }
}
