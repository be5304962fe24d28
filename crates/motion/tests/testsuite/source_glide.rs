//! The source's own glide: it may be slower than the optimum, but every limit and the tolerance hold.

use crate::cases::cases;
use crate::common;

use common::*;
use proptest::prelude::*;
use retrace_motion::{Blending, FeedRate, GlideRatio, MachineLimits, PathMode, Planner, RatioOf};

fn planner(limits: MachineLimits<3>, value: f64, of: RatioOf) -> Planner<3> {
    let ratio = GlideRatio::new(value, of).expect("in range");
    Planner::new(limits, [0.0; 3]).expect("valid limits").with_blending(Blending::Source(ratio))
}

fn ratio_of() -> impl Strategy<Value = RatioOf> {
    prop_oneof![Just(RatioOf::Length), Just(RatioOf::Speed)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(40)))]

    #[test]
    fn limits_ends_and_paths_are_kept(
        steps in prop::collection::vec(step(), 1..40), tolerance in 0.002..0.5f64, value in 0.01..1.0f64,
            of in ratio_of(),
    ) {
        let limits = MachineLimits::built_in();
        let moves = program(&steps, PathMode::blend(tolerance));
        let run = play_on(planner(limits, value, of), &moves, usize::MAX);
        if let Err(broken) = check(&limits, &moves, &run, tolerance, 40) {
            prop_assert!(false, "{}", broken);
        }
    }

    /// Axes with different limits, and chains of short lines.
    #[test]
    fn any_machine_keeps_its_limits(
        turns in prop::collection::vec((-2.5..2.5f64, -1.5..1.0f64), 2..60), value in 0.01..0.6f64, of in ratio_of(),
        v in [1.0..2.5f64, 1.0..2.5f64], a in [2.0..4.0f64, 2.0..4.0f64], j in [3.0..6.0f64, 3.0..6.0f64],
    ) {
        let mut limits = MachineLimits::built_in();
        for i in 0..2 {
            limits.velocity_mm_s[i] = 10f64.powf(v[i]);
            limits.acceleration_mm_s2[i] = 10f64.powf(a[i]);
            limits.jerk_mm_s3[i] = 10f64.powf(j[i]);
        }
        let (mut at, mut heading) = ([0.0f64; 3], 0.0f64);
        let moves: Vec<Move> = turns
            .iter()
            .map(|(turn, size)| {
                heading += turn;
                let length = 10f64.powf(*size);
                at = [at[0] + length * heading.cos(), at[1] + length * heading.sin(), 0.0];
                Move { path: Path::Line(at), feed: FeedRate::PerSecond(60.0), mode: PathMode::blend(0.05), stop: false }
            })
            .collect();
        let run = play_on(planner(limits, value, of), &moves, usize::MAX);
        if let Err(broken) = check(&limits, &moves, &run, 0.05, 60) {
            prop_assert!(false, "{}", broken);
        }
    }
}

/// It is another method: a corner is passed, not stopped in, at the speed that the ratio gives, and a larger ratio is
/// faster.
#[test]
fn a_corner_is_passed_at_the_speed_of_the_ratio() {
    let limits = MachineLimits::built_in();
    let mode = PathMode::blend(1.0);
    let corner = [[20.0, 0.0, 0.0], [20.0, 20.0, 0.0]].map(|end| Move {
        path: Path::Line(end),
        feed: FeedRate::Rapid,
        mode,
        stop: false,
    });
    let periods = |value: f64| {
        let run = play_on(planner(limits, value, RatioOf::Speed), &corner, usize::MAX);
        check(&limits, &corner, &run, 1.0, 2).expect("legal");
        // The shortest distance in a period around the corner, as a speed.
        let slowest = run.points.windows(2).filter(|pair| pair[0][0] > 10.0 && pair[1][1] < 10.0).map(|pair| {
            let way: f64 = (0..3).map(|i| (pair[1][i] - pair[0][i]).powi(2)).sum();
            way.sqrt() / limits.period_s
        });
        (run.records.len(), slowest.fold(f64::MAX, f64::min))
    };
    let (slow, fast) = (periods(0.05), periods(0.2));
    assert!(fast.0 < slow.0, "{fast:?} {slow:?}");
    // Half way through a square corner both parts have half of the speed.
    for ((_, speed), value) in [(slow, 0.05), (fast, 0.2)] {
        let expected = 100.0 * value * 0.5f64.sqrt();
        assert!((speed - expected).abs() < 0.05 * expected, "{speed} mm/s for {expected} mm/s");
    }
}
