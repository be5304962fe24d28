//! REV-1: records that are only counted are as many as those that are made.

use crate::cases::cases;
use crate::common;
use crate::plan::mode;

use common::*;
use proptest::prelude::*;
use retrace_core::Flags;
use retrace_motion::{MachineLimits, Planner};

/// Number of records that `take_out` takes out behind each move of a program, and behind its end.
fn counts(mut planner: Planner<3>, moves: &[Move], take_out: fn(&mut Planner<3>) -> u64) -> Vec<u64> {
    let mut counts = Vec::new();
    for (m, tag) in moves.iter().zip(1..) {
        match &m.path {
            Path::Line(end) => planner.line(*end, m.feed, m.mode, tag).expect("a valid line"),
            Path::Arc(arc) => planner.arc(arc, m.feed, m.mode, tag).expect("a valid arc"),
        }
        if m.stop {
            planner.stop(Flags::NONE);
        }
        counts.push(take_out(&mut planner));
    }
    planner.stop(Flags::NONE);
    counts.push(take_out(&mut planner));
    counts
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases(40)))]

    #[test]
    fn records_are_counted_without_being_made(
        steps in prop::collection::vec(step(), 1..40), mode in mode(), plan_mode in plan_mode(),
    ) {
        let planner = || {
            let planner = Planner::new(MachineLimits::built_in(), [0.0; 3]).expect("valid limits");
            planner.with_plan_mode(plan_mode)
        };
        let moves = program(&steps, mode);
        let made = counts(planner(), &moves, |planner| std::iter::from_fn(|| planner.next_record()).count() as u64);
        prop_assert_eq!(counts(planner(), &moves, Planner::count_records), made);
    }
}
