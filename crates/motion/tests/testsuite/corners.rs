//! Corners of two straight legs: never slower than stopping, and the table of their optima agrees with linear programs.

#[path = "../../benches/motion/oracle.rs"]
#[allow(dead_code, unreachable_pub)] // the bench uses the rest
mod oracle;

use crate::cases::cases;
use oracle::{Allowed, Legs, Optimum};
use proptest::prelude::*;
use retrace_core::Flags;
use retrace_motion::{FeedRate, MachineLimits, PathMode, Planner};

const OPTIMA: &str = include_str!("../../benches/motion/corner_optimum.csv");

/// Control periods through a corner, from rest to rest.
fn periods(degrees: f64, legs: [f64; 2], feed: FeedRate, mode: PathMode) -> usize {
    let mut planner = Planner::<3>::new(MachineLimits::built_in(), [0.0; 3]).expect("valid limits");
    let (sin, cos) = degrees.to_radians().sin_cos();
    let [one, two] = legs;
    for (tag, end) in (1..).zip([[one, 0.0, 0.0], [one + two * cos, two * sin, 0.0]]) {
        planner.line(end, feed, mode, tag).expect("a valid line");
    }
    planner.stop(Flags::NONE);
    std::iter::from_fn(|| planner.next_record()).count()
}

/// Rows of the table: degrees, leg, tolerance, optimum, time with a stop, share before the switch.
fn table() -> Vec<[f64; 6]> {
    let row = |line: &str| {
        let numbers: Vec<f64> = line.split(',').map(|number| number.parse().expect("a number")).collect();
        <[f64; 6]>::try_from(numbers).expect("six columns")
    };
    OPTIMA.lines().skip(1).map(row).collect()
}

fn slower_than_stopping(degrees: f64, legs: [f64; 2], feed: FeedRate, tolerance_mm: f64) -> Option<String> {
    let stop = periods(degrees, legs, feed, PathMode::ExactStop);
    let blend = periods(degrees, legs, feed, PathMode::blend(tolerance_mm));
    (blend > stop).then(|| format!("{degrees}°, {legs:?} mm, {tolerance_mm} mm: {blend} periods, {stop} stopping"))
}

/// No plan for a corner of the table is faster than the optimum, which the table gives to a part in 200.
#[test]
fn corners_are_never_slower_than_stopping_and_never_faster_than_possible() {
    let rows = table();
    assert_eq!(rows.len(), 56);
    for [degrees, leg, tolerance_mm, optimum, ..] in rows {
        let feed = FeedRate::PerSecond(100.0);
        assert_eq!(slower_than_stopping(degrees, [leg; 2], feed, tolerance_mm), None);
        let ours = periods(degrees, [leg; 2], feed, PathMode::blend(tolerance_mm)) as f64 * 1e-3;
        assert!(ours >= 0.995 * optimum, "{degrees}° {leg} mm {tolerance_mm} mm: {ours} s, optimum {optimum} s");
    }
}

#[test]
fn short_legs_are_never_slower_than_stopping() {
    for degrees in [5.0, 15.0, 30.0, 45.0, 60.0, 90.0, 120.0, 135.0, 170.0, 180.0] {
        for leg in [0.05, 0.1, 0.2, 0.5, 1.0, 2.0] {
            for tolerance_mm in [0.005, 0.01, 0.02, 0.05] {
                assert_eq!(slower_than_stopping(degrees, [leg; 2], FeedRate::PerSecond(100.0), tolerance_mm), None);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(200)))]

    #[test]
    fn no_corner_is_slower_than_stopping(
        degrees in 0.1..180.0f64, one in -1.3..1.5f64, two in -1.3..1.5f64, feed in 0.3..2.0f64,
            tolerance in -2.3..-1.0f64,
    ) {
        let power = |x: f64| 10f64.powf(x);
        let feed = FeedRate::PerSecond(power(feed));
        prop_assert_eq!(slower_than_stopping(degrees, [power(one), power(two)], feed, power(tolerance)), None);
    }
}

/// A few linear programs solved again, with other steps than the table's: its time is enough, and 1 % less is not.
#[test]
fn the_table_is_what_linear_programs_say() {
    let rows = table();
    for [degrees, leg, tolerance, seconds, stop, share] in rows.into_iter().step_by(11) {
        let legs = Legs { turn: degrees.to_radians(), leg, allowed: Allowed::BUILT_IN };
        assert!((legs.stopping().iter().sum::<f64>() - stop).abs() < 1e-6);
        let least = |seconds: f64, share: f64| legs.min_tolerance(Optimum { seconds, share }, 80);
        let name = format!("{degrees}°, {leg} mm, {tolerance} mm");
        let enough = least(1.003 * seconds, share).expect("the corner can be passed");
        assert!(enough <= tolerance, "{name}: {enough} mm in the table's time");
        for share in [share - 0.01, share, share + 0.01] {
            let short = least(0.99 * seconds, share).unwrap_or(f64::MAX);
            assert!(short > tolerance, "{name}: {short} mm in 1 % less");
        }
    }
}
