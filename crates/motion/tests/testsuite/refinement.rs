//! Plans that are made faster up to the exact limits of the axes (`PlanMode::Best`).

use crate::cases::cases;
use crate::common;
use crate::look_ahead::{Numbers, spiral};
use crate::plan::{mode, wandering};

use common::*;
use proptest::prelude::*;
use retrace_motion::{MachineLimits, PathMode, PlanMode};

fn tolerance_of(mode: PathMode) -> f64 {
    if let PathMode::Blend { tolerance_mm, .. } = mode { tolerance_mm } else { 0.0 }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(40)))]

    /// Lines, arcs and curves: the limits, the ends and the path are kept, the records do not depend on when they are
    /// asked for, and the program is no slower.
    #[test]
    fn a_refined_program_keeps_everything_and_is_no_slower(
        steps in prop::collection::vec(step(), 1..40), mode in mode(), most in 0usize..40,
    ) {
        let (limits, moves) = (MachineLimits::built_in(), program(&steps, mode));
        let best = play_in(PlanMode::Best, limits, &moves, usize::MAX);
        if let Err(broken) = check(&limits, &moves, &best, tolerance_of(mode), 40) {
            prop_assert!(false, "{}", broken);
        }
        let fast = play_in(PlanMode::Fast, limits, &moves, usize::MAX);
        let (best_periods, fast_periods) = (best.records.len(), fast.records.len());
        prop_assert!(best_periods <= fast_periods, "{best_periods} periods, {fast_periods}");
        prop_assert_eq!(play_in(PlanMode::Best, limits, &moves, most), best);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Long chains of short lines, some nearly straight, some rough: re-planned, refined and cut many times.
    #[test]
    fn refined_dense_chains_keep_everything_too(
        seed in any::<u32>(), size in -2.5..-0.3f64, wander in -3.0..0.3f64, tolerance_mm in 0.005..0.1f64,
            most in 0usize..9,
    ) {
        let (limits, moves) = (MachineLimits::built_in(), wandering(seed, size, wander, PathMode::blend(tolerance_mm)));
        let best = play_in(PlanMode::Best, limits, &moves, most);
        if let Err(broken) = check(&limits, &moves, &best, tolerance_mm, 4000) {
            prop_assert!(false, "{}", broken);
        }
        let fast = play_in(PlanMode::Fast, limits, &moves, usize::MAX);
        let (best_periods, fast_periods) = (best.records.len(), fast.records.len());
        prop_assert!(best_periods <= fast_periods, "{best_periods} periods, {fast_periods}");
        prop_assert_eq!(play_in(PlanMode::Best, limits, &moves, usize::MAX), best);
    }
}

/// A spiral of short chords, on which the axes' own limits leave more than constant limits along the path do.
#[test]
fn a_refined_spiral_takes_a_tenth_less_time() {
    let mut numbers = Numbers(5);
    let [mut fast, mut best] = [0usize; 2];
    for _ in 0..6 {
        let moves = spiral(&mut numbers);
        let periods = |mode| play_in(mode, MachineLimits::built_in(), &moves, usize::MAX).records.len();
        (fast, best) = (fast + periods(PlanMode::Fast), best + periods(PlanMode::Best));
    }
    println!("{best} control periods, {fast} without refinement");
    assert!(10 * best <= 9 * fast, "{best} control periods, {fast} without refinement");
}

/// A refined program is the same each time, and whenever its records are asked for.
#[test]
fn a_refined_program_depends_on_nothing_but_itself() {
    let (mut numbers, limits) = (Numbers(6), MachineLimits::built_in());
    for _ in 0..3 {
        let moves = spiral(&mut numbers);
        let first = play_in(PlanMode::Best, limits, &moves, usize::MAX);
        for most in [0, 1, 7, 300, usize::MAX] {
            assert!(play_in(PlanMode::Best, limits, &moves, most) == first, "with {most} records after each move");
        }
    }
}

/// A long line into a chain of short ones. The law of one window, lowered by what it exceeds between the points, leaves
/// none from the state at its start: 1693 control periods if that window remains as it was planned.
#[test]
fn a_window_is_refined_although_its_first_law_exceeds_much() {
    let moves = wandering(118, -0.3, -1.0, PathMode::blend(0.05));
    let best = play_in(PlanMode::Best, MachineLimits::built_in(), &moves[1640..1700], usize::MAX);
    assert!(best.records.len() <= 1650, "{} control periods", best.records.len());
}
