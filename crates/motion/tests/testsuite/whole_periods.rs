//! SMO-9: where motion ends it has taken whole periods, so the last record before rest is a whole one.

use crate::common;

use common::*;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use retrace_core::Flags;
use retrace_motion::{MachineLimits, PathMode, PlanMode, Planner};

/// How a run ends.
#[derive(Clone, Copy, Debug)]
struct LastPart {
    /// Time from the last set-point before the stop to rest, in periods, from speed and acceleration there.
    periods: f64,
    /// Periods since the stop before.
    since: usize,
}

impl LastPart {
    /// Emission adds periods up, so that each of them may add a rounding of some 10⁻¹¹ of a period in runs of minutes.
    fn is_whole(self) -> bool {
        (self.periods - 1.0).abs() < 1e-9 + 1e-11 * self.since as f64
    }
}

/// All stops but those whose last phase is shorter than a period: there speed and acceleration do not determine it.
fn last_parts(plan_mode: PlanMode, moves: &[Move], max_blocks: Option<usize>) -> Vec<LastPart> {
    let limits = MachineLimits::built_in();
    let mut planner = match max_blocks {
        None => Planner::<3>::new(limits, [0.0; 3]),
        Some(blocks) => Planner::with_look_ahead(limits, [0.0; 3], blocks),
    }
    .expect("valid limits")
    .with_plan_mode(plan_mode);
    let (mut parts, mut before, mut since) = (Vec::new(), *planner.set_point(), 0);
    let mut pull = |planner: &mut Planner<3>| {
        while let Some(record) = planner.next_record() {
            since += 1;
            let braking = before.acceleration_mm_s2 < 0.0 && before.velocity_mm_s > 0.0 && before.jerk_mm_s3 > 0.0;
            if record.flags.contains(Flags::REST) && braking {
                let by_jerk = -before.acceleration_mm_s2 / before.jerk_mm_s3;
                let by_speed = -2.0 * before.velocity_mm_s / before.acceleration_mm_s2;
                if (by_jerk - by_speed).abs() < 1e-6 * by_speed {
                    parts.push(LastPart { periods: by_speed / limits.period_s, since });
                }
            }
            if record.flags.contains(Flags::REST) {
                since = 0;
            }
            before = *planner.set_point();
        }
    };
    for (m, tag) in moves.iter().zip(1..) {
        match &m.path {
            Path::Line(end) => planner.line(*end, m.feed, m.mode, tag).expect("a valid line"),
            Path::Arc(arc) => planner.arc(arc, m.feed, m.mode, tag).expect("a valid arc"),
        }
        if m.stop {
            planner.stop(Flags::NONE);
        }
        pull(&mut planner);
    }
    planner.stop(Flags::NONE);
    pull(&mut planner);
    parts
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    /// Runs from rest to rest.
    #[test]
    fn every_full_stop_ends_a_whole_period(steps in prop::collection::vec(step(), 1..30), plan_mode in plan_mode()) {
        for part in last_parts(plan_mode, &program(&steps, PathMode::ExactStop), None) {
            prop_assert!(part.is_whole(), "{:?}", part);
        }
    }
}

/// Runs that were committed in part, or begin in a glide, can only be filled where a span can be lengthened.
#[test]
fn most_stops_behind_committed_motion_end_a_whole_period() {
    let mut parts = Vec::new();
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    for _ in 0..60 {
        let steps = prop::collection::vec(step(), 1..60).new_tree(&mut runner).expect("steps").current();
        for mode in [PathMode::ExactPath, PathMode::blend(0.05)] {
            for plan_mode in [PlanMode::Fast, PlanMode::Best] {
                parts.extend(last_parts(plan_mode, &program(&steps, mode), Some(6)));
                parts.extend(last_parts(plan_mode, &program(&steps, mode), None));
            }
        }
    }
    let whole = parts.iter().filter(|part| part.is_whole()).count();
    println!("{whole} of {} stops fill their last period", parts.len());
    assert!(parts.len() > 200 && whole * 10 > parts.len() * 9, "{whole} of {}", parts.len());
}
