//! The feed override above 100 %: it changes when the machine is where, and never the path.

use crate::cases::cases;
use crate::common;

use common::*;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use retrace_core::Flags;
use retrace_motion::{FeedRate, MAX_OVERRIDE, MachineLimits, PathMode, PlanMode, Planner};

/// Feeds `moves`, with at most `most` records taken out after each move; the override is changed before the records of
/// these numbers.
fn play_overridden(limits: MachineLimits<3>, moves: &[Move], most: usize, changes: &[(usize, f64)]) -> Run {
    play_overridden_in(PlanMode::Fast, limits, moves, most, changes)
}

/// The same with a planner that plans in `plan_mode`.
fn play_overridden_in(
    plan_mode: PlanMode,
    limits: MachineLimits<3>,
    moves: &[Move],
    most: usize,
    changes: &[(usize, f64)],
) -> Run {
    let mut changes = changes.iter().peekable();
    let planner = Planner::new(limits, [0.0; 3]).expect("valid limits").with_plan_mode(plan_mode);
    play_through(planner, moves, most, |planner, run| {
        while let Some((_, factor)) = changes.next_if(|(at, _)| *at <= run.records.len()) {
            assert_eq!(planner.set_feed_override(*factor), *factor);
        }
    })
}

fn mode() -> impl Strategy<Value = PathMode> {
    prop_oneof![
        Just(PathMode::ExactStop),
        Just(PathMode::ExactPath),
        Just(PathMode::Blend { tolerance_mm: 0.05, merge_mm: None }),
        (0.002..0.3f64).prop_map(|tolerance_mm| PathMode::Blend { tolerance_mm, merge_mm: None }),
    ]
}

/// Changes at growing record numbers, mostly within a second or two, some at the very next record.
fn changes() -> impl Strategy<Value = Vec<(usize, f64)>> {
    let factor = prop_oneof![Just(1.0), Just(1.5), Just(MAX_OVERRIDE), 1.0..MAX_OVERRIDE];
    let gap = prop_oneof![Just(0usize), Just(1), 2..30usize, 30..800usize];
    prop::collection::vec((gap, factor), 1..12).prop_map(|changes| {
        let mut at = 0;
        let place = |(gap, factor)| {
            at += gap;
            (at, factor)
        };
        changes.into_iter().map(place).collect()
    })
}

/// Counts at every planned stop, with its program line and flags.
fn stops(run: &Run) -> Vec<([i64; 3], u32)> {
    let mut counts = [0i64; 3];
    let mut stops = Vec::new();
    for record in &run.records {
        for (count, increment) in counts.iter_mut().zip(record.increments) {
            *count += i64::from(increment);
        }
        if record.flags.contains(Flags::REST) {
            stops.push((counts, record.line));
        }
    }
    stops
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(40)))]

    #[test]
    fn whatever_the_override_does_everything_is_kept(
        steps in prop::collection::vec(step(), 1..40), mode in mode(), plan_mode in plan_mode(), changes in changes(),
            most in prop_oneof![Just(usize::MAX), 0usize..40],
    ) {
        let limits = MachineLimits::built_in();
        let moves = program(&steps, mode);
        let run = play_overridden_in(plan_mode, limits, &moves, most, &changes);
        let tolerance = if let PathMode::Blend { tolerance_mm, .. } = mode { tolerance_mm } else { 0.0 };
        if let Err(broken) = check(&limits, &moves, &run, tolerance, 40) {
            prop_assert!(false, "{}", broken);
        }
    }

    /// An override of 100 % changes nothing, and neither does one that is cancelled before the first record.
    #[test]
    fn no_override_changes_nothing(
        steps in prop::collection::vec(step(), 1..20), mode in mode(), plan_mode in plan_mode(),
        at in prop::collection::vec(0usize..2000, 0..20),
    ) {
        let limits = MachineLimits::built_in();
        let moves = program(&steps, mode);
        let mut changes: Vec<_> = at.into_iter().map(|at| (at, 1.0)).collect();
        changes.sort_unstable_by_key(|change| change.0);
        let plain = play_in(plan_mode, limits, &moves, usize::MAX);
        prop_assert_eq!(&play_overridden_in(plan_mode, limits, &moves, usize::MAX, &changes), &plain);
    }
}

/// Programs at one feed, raised somewhere within their first half second, take less time together and stop where they
/// stop without it: the same corners are glided through. Once in some hundred programs a plan leads into a glide at one
/// feed and not at another; the machine then stops in that corner.
#[test]
fn raised_feeds_save_time_and_glide_through_the_same_corners() {
    let limits = MachineLimits::built_in();
    let mut runner = TestRunner::deterministic();
    let corner = (0.0..1.3f64, 0.3..2.8f64, any::<bool>(), 0u8..8, -2.0..2.0f64);
    let programs = (prop::collection::vec(corner, 2..30), 0usize..500, 1.0..60.0f64, 1.05..MAX_OVERRIDE);
    let (mut plain_time, mut raised_time, mut different) = (0, 0, 0);
    for _ in 0..300 {
        let (corners, at, feed, factor) = programs.new_tree(&mut runner).expect("a program").current();
        let step = |(size, turn, left, kind, bend)| Step {
            kind,
            size,
            turn: if left { turn } else { -turn },
            bend,
            rise: 0.1,
            feed: 0.0,
            stop: false,
        };
        let steps: Vec<Step> = corners.into_iter().map(step).collect();
        let mut moves = program(&steps, PathMode::Blend { tolerance_mm: 0.02, merge_mm: None });
        for m in &mut moves {
            m.feed = FeedRate::PerSecond(feed);
        }
        let plain = play(limits, &moves, usize::MAX);
        let raised = play_overridden(limits, &moves, usize::MAX, &[(at, factor)]);
        check_points(&limits, &raised.points, [0.0; 3]).expect("limits kept");
        (plain_time, raised_time) = (plain_time + plain.records.len(), raised_time + raised.records.len());
        different += usize::from(stops(&plain) != stops(&raised));
    }
    assert!(different <= 6, "{different} of 300 programs stop elsewhere");
    assert!(raised_time * 10 < plain_time * 9, "{raised_time} periods for {plain_time}");
}

/// Speeds in mm/s at the end of each record of a line of 400 mm at 20 mm/s.
fn speeds(moves: &[Move], changes: &[(usize, f64)]) -> Vec<f64> {
    let run = play_overridden(MachineLimits::built_in(), moves, usize::MAX, changes);
    check(&MachineLimits::built_in(), moves, &run, 0.05, 2).expect("limits kept, path and end exact");
    run.points.windows(2).map(|w| (0..3).map(|i| (w[1][i] - w[0][i]).powi(2)).sum::<f64>().sqrt() * 1000.0).collect()
}

/// Within a tenth of a second of the change the speed is the requested one, up and down, on one long line and on many
/// short ones.
#[test]
fn a_change_acts_at_once() {
    for (n, mode) in [
        (1, PathMode::ExactPath),
        (80, PathMode::ExactPath),
        (4000, PathMode::Blend { tolerance_mm: 0.01, merge_mm: None }),
    ] {
        let moves: Vec<Move> = (1..=n)
            .map(|k| {
                let x = 400.0 * f64::from(k) / f64::from(n);
                // Not quite straight, so that nothing is merged where that is a blend.
                let y = if mode == PathMode::ExactPath { 0.0 } else { 0.0005 * x * x };
                Move { path: Path::Line([x, y, 0.0]), feed: FeedRate::PerSecond(20.0), mode, stop: false }
            })
            .collect();
        let v = speeds(&moves, &[(3000, 1.5), (6000, 2.0), (9000, 1.2), (12_000, 1.0)]);
        for (at, wanted) in
            [(2990, 20.0), (3100, 30.0), (5990, 30.0), (6100, 40.0), (9100, 24.0), (12_100, 20.0), (13_000, 20.0)]
        {
            assert!((v[at] - wanted).abs() < 0.02, "{n} moves: {} mm/s at {at}, not {wanted}", v[at]);
        }
    }
}

/// Rapid moves are as fast as before, and a value that is not a number is refused.
#[test]
fn rapids_and_nonsense_change_nothing() {
    let moves =
        [Move { path: Path::Line([90.0, 50.0, 3.0]), feed: FeedRate::Rapid, mode: PathMode::ExactStop, stop: false }];
    let limits = MachineLimits::built_in();
    let plain = play(limits, &moves, usize::MAX);
    assert_eq!(play_overridden(limits, &moves, usize::MAX, &[(0, 1.5)]), plain);
    let mut planner = Planner::<3>::new(limits, [0.0; 3]).expect("valid limits");
    for (asked, given) in [(f64::NAN, 1.0), (0.3, 1.0), (-1.0, 1.0), (f64::INFINITY, MAX_OVERRIDE), (1.25, 1.25)] {
        assert_eq!(planner.set_feed_override(asked), given);
    }
}
