//! The rate law on real records: planned by the planner, played by the card, checked period by period.

use crate::hold;

use hold::{FEED_MM_S, Played, circle, line, paths, records};
use proptest::prelude::*;
use retrace_config::MachineConfig;
use retrace_core::Rate;

/// Length in mm of the shortest stop within acceleration and jerk: v(v/A + A/J)/2, where v is high enough to reach A.
fn optimum_mm(v: f64, a: f64, j: f64) -> f64 {
    v * (v / a + a / j) / 2.0
}

/// Length in mm and periods of the stop that the law's own bound gives, integrated in small steps: the commanded rate
/// falls by (A − c·u²)/v, c being what the path takes of the acceleration, and the cursor is its mean over n periods.
fn bound(v: f64, c: f64, a: f64, n: f64, period_s: f64) -> (f64, f64) {
    let (mut u, mut way, mut time) = (1.0_f64, 0.0, 0.0);
    let step_s = 1e-6;
    while u > 0.0 {
        way += u * v * step_s;
        u -= (a - c * u * u) / v * step_s;
        time += step_s;
    }
    (way + v * n * period_s / 2.0, time / period_s + n)
}

/// A hold from every speed on a straight run: the length is the bound's, and near the optimum.
#[test]
fn a_hold_from_a_straight_run_is_as_short_as_the_limits_allow() {
    for v in [100.0, 80.0, 50.0, 20.0, 10.0, 3.0] {
        let mut played = Played::of(records(&line(v)));
        let speed = played.run_to_speed();
        assert!((speed - v).abs() < 0.1, "{speed} mm/s");
        let stop = played.hold();
        let (length, periods) = bound(v, 0.0, 1000.0, 50.0, 0.001);
        let (share, optimum) = (stop.length_mm / length, stop.length_mm / optimum_mm(v, 1000.0, 20_000.0));
        println!("straight, {v} mm/s: {} periods, {:.3} mm, {optimum:.3} of the optimum", stop.periods, stop.length_mm);
        assert!((0.98..=1.02).contains(&share), "{v} mm/s: {} mm of {length}", stop.length_mm);
        assert!(f64::from(stop.periods) <= 1.02 * periods + 2.0, "{} periods of {periods}", stop.periods);
        assert!(stop.first_slower <= 2);
        played.finish();
    }
}

/// On a circle that takes all of the acceleration that the plan may use.
#[test]
fn a_hold_on_a_circle_at_full_lateral_acceleration_is_within_the_bound_on_time() {
    for v in [100.0, 50.0, 10.0] {
        let mut played = Played::of(records(&circle(v)));
        let speed = played.run_to_speed();
        assert!(speed > 0.75 * v, "{speed} mm/s");
        let stop = played.hold();
        println!("circle for {v} mm/s, {speed:.1} reached: {} periods, {:.3} mm", stop.periods, stop.length_mm);
        assert!(stop.periods <= 300 && stop.first_slower <= 2, "{stop:?}");
        played.finish();
    }
}

/// Where the path turns tightly, the jerk limits a change of the rate; most of all where the change is reversed within
/// the filter length.
#[test]
fn a_hold_that_is_taken_back_keeps_the_jerk_on_a_tight_circle() {
    for v in [8.0, 12.0, 18.0, 26.0, 40.0, 60.0] {
        for periods in [18, 30, 42, 51, 64, 90] {
            let mut played = Played::of(records(&circle(v)));
            played.run_to_speed();
            for _ in 0..4 {
                played.ask(Rate::ZERO, periods);
                played.ask(Rate::ONE, periods + 7);
            }
            assert_eq!(played.violations(), None, "{v} mm/s, turned round every {periods} periods");
        }
    }
}

/// Any rate from `low` up to `high`, in whole records per period.
fn rates(low: i64, high: i64) -> impl Strategy<Value = Rate> {
    (low << 32..high << 32).prop_map(Rate::from_units)
}

/// Requests of an operator: a target, and for how many periods.
fn requests() -> impl Strategy<Value = Vec<(Rate, u32)>> {
    let target = prop_oneof![
        4 => Just(Rate::ONE), 2 => Just(Rate::ZERO), 2 => Just(-Rate::ONE), 1 => rates(-1, 1), 1 => Just(-Rate::MAX),
            1 => rates(1, 8),
        1 => Just(Rate::ONE / 20),
    ];
    prop::collection::vec((target, prop_oneof![1u32..12, 1u32..120, 100u32..900]), 1..24)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(), failure_persistence: None, ..ProptestConfig::default() })]

    /// For any requests on any path: no limit is violated, and from full speed it is at rest within 300 periods.
    #[test]
    fn whatever_is_asked_no_limit_is_broken(path in paths(), requests in requests()) {
        let mut played = Played::of(records(&path));
        for (target, periods) in requests {
            played.ask(target, periods);
        }
        prop_assert_eq!(played.violations(), None);
        let stop = played.hold();
        prop_assert!(stop.periods <= 300 || stop.from.abs() > Rate::ONE, "{:?}", stop);
        prop_assert!(stop.first_slower <= 2);
        played.ask_until_rest(Rate::ONE);
        prop_assert_eq!(played.violations(), None);
        prop_assert!(played.at_end(), "ends exactly at the end");
        played.ask_until_rest(-Rate::ONE);
        prop_assert_eq!(played.finish(), [0; 3]);
    }

    /// A hold at any place, from motion as recorded.
    #[test]
    fn a_hold_anywhere_is_at_rest_within_300_periods(path in paths(), place in 0.0..1.0f64, backward in any::<bool>()) {
        let mut played = Played::of(records(&path));
        played.run_to_share(place, backward);
        let stop = played.hold();
        prop_assert!(stop.periods <= 300 && stop.first_slower <= 2, "{:?}", stop);
        prop_assert_eq!(played.violations(), None);
    }
}

fn cases() -> u32 {
    std::env::var("RETRACE_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(48)
}

#[test]
fn the_paths_are_as_fast_as_the_machine() {
    assert_eq!(MachineConfig::built_in().expect("valid").path_velocity_mm_s, FEED_MM_S);
}
