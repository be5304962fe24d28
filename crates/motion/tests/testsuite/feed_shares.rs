//! The speed of each record as a share of the programmed feed (CUT-20).
//!
//! Invariant: the expected share is computed from the set-points alone.

use proptest::prelude::*;
use retrace_core::{FeedShare, Flags, Record};
use retrace_motion::{FeedRate, MachineLimits, PathMode, Planner};

const LIMITS: MachineLimits<2> = MachineLimits { feed_shares: true, ..MachineLimits::built_in() };

/// Records of these moves, with the length of the path in each.
fn records(limits: MachineLimits<2>, moves: &[([f64; 2], FeedRate)], mode: PathMode) -> Vec<(Record<2>, f64)> {
    let mut planner = Planner::new(limits, [0.0; 2]).expect("valid");
    for (tag, &(end, feed)) in (1..).zip(moves) {
        planner.line(end, feed, mode, tag).expect("valid");
    }
    planner.stop(Flags::NONE);
    let (mut records, mut before) = (Vec::new(), [0.0; 2]);
    while let Some(record) = planner.next_record() {
        let now = planner.set_point().position_mm;
        records.push((record, (now[0] - before[0]).hypot(now[1] - before[1])));
        before = now;
    }
    records
}

proptest! {
    /// At one feed, each record has the speed of its own set-points, in corners and at rest as well.
    #[test]
    fn the_share_is_that_of_the_way(
        points in prop::collection::vec([-30.0..30.0f64, -30.0..30.0f64], 1..12), feed in 0.5..90.0f64,
        mode in prop_oneof![
            Just(PathMode::ExactStop), Just(PathMode::ExactPath), (0.001..1.0f64).prop_map(PathMode::blend),
        ],
    ) {
        let moves: Vec<_> = points.iter().map(|&end| (end, FeedRate::PerSecond(feed))).collect();
        for (number, (record, way)) in records(LIMITS, &moves, mode).iter().enumerate() {
            let share = f64::from(record.feed_share.units()) / f64::from(FeedShare::FEED.units());
            let expected = way / (feed * LIMITS.period_s);
            prop_assert!((share - expected).abs() < 3.1e-5, "{number}: {share} {expected}");
            prop_assert!(*way == 0.0 || record.feed_share > FeedShare::NONE);
        }
    }

    /// Rapid moves have none, feed moves that of their own feed, and a planner without shares changes nothing else.
    #[test]
    fn rapid_moves_have_no_share(
        ends in prop::collection::vec((prop::bool::ANY, 1.0..20.0f64, 2.0..50.0f64), 1..8),
        mode in prop_oneof![Just(PathMode::ExactStop), (0.01..0.5f64).prop_map(PathMode::blend)],
    ) {
        let mut at = 0.0;
        let moves: Vec<_> = ends.iter().enumerate().map(|(number, &(is_rapid, length, feed))| {
            at += length;
            let end = if number % 2 == 0 { [at, 0.0] } else { [at, 3.0] };
            (end, if is_rapid { FeedRate::Rapid } else { FeedRate::PerSecond(feed) })
        }).collect();
        let with = records(LIMITS, &moves, mode);
        let without = records(MachineLimits { feed_shares: false, ..LIMITS }, &moves, mode);
        prop_assert_eq!(with.len(), without.len());
        for ((record, way), (plain, _)) in with.iter().zip(&without) {
            prop_assert_eq!(*plain, Record { feed_share: FeedShare::NONE, ..*record });
            if record.flags.contains(Flags::RAPID) {
                prop_assert_eq!(record.feed_share, FeedShare::NONE);
            }
            let (is_rapid, _, feed) = ends[record.line as usize - 1];
            if !is_rapid && mode == PathMode::ExactStop {
                let share = f64::from(record.feed_share.units()) / 32_768.0;
                prop_assert!((share - way / (feed * LIMITS.period_s)).abs() < 3.1e-5, "{} {} {:?}", share, way, record);
            }
        }
    }
}
