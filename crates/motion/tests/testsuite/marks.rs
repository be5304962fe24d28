//! Marks within moves: they change nothing but the tags of the records.

use crate::common;
use crate::plan::mode;

use common::*;
use proptest::prelude::*;
use retrace_core::{Flags, Record};
use retrace_motion::{FeedRate, MachineLimits, MoveMark, PathMode, Planner};

/// Shares of the marks of each move, ascending.
fn shares() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(0.0..1.0f64, 0..6).prop_map(|mut shares| {
        shares.sort_by(f64::total_cmp);
        shares
    })
}

/// Plans moves with marks; the tags are numbers in the order of the moves and marks.
fn play_marked(limits: MachineLimits<3>, moves: &[Move], marks: &[Vec<f64>]) -> Run {
    let (mut planner, mut run, mut tag) = (Planner::new(limits, [0.0; 3]).expect("valid limits"), Run::default(), 0);
    let mut pull = |planner: &mut Planner<3>| {
        while let Some(record) = planner.next_record() {
            run.records.push(record);
            run.points.push(planner.set_point().position_mm);
        }
    };
    for (m, shares) in moves.iter().zip(marks) {
        tag += 1;
        let first = tag;
        let marks: Vec<MoveMark> =
            shares.iter().zip(first + 1..).map(|(&share, tag)| MoveMark { share, tag }).collect();
        tag += marks.len() as u32;
        match &m.path {
            Path::Line(end) => planner.marked_line(*end, m.feed, m.mode, first, &marks).expect("a valid line"),
            Path::Arc(arc) => planner.marked_arc(arc, m.feed, m.mode, first, &marks).expect("a valid arc"),
        }
        if m.stop {
            planner.stop(Flags::MARKER);
        }
        pull(&mut planner);
    }
    planner.stop(Flags::NONE);
    pull(&mut planner);
    run
}

/// Modes in which lines are merged, and are not.
fn any_mode() -> impl Strategy<Value = PathMode> {
    prop_oneof![mode(), Just(PathMode::Blend { tolerance_mm: 0.05, merge_mm: Some(0.0) })]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// The same records, except for their tags.
    #[test]
    fn a_path_does_not_depend_on_its_marks(
        steps in prop::collection::vec(step(), 1..20), marks in prop::collection::vec(shares(), 20), mode in any_mode(),
    ) {
        let limits = MachineLimits::built_in();
        let moves = program(&steps, mode);
        let (plain, marked) = (play(limits, &moves, usize::MAX), play_marked(limits, &moves, &marks));
        prop_assert_eq!(plain.points, marked.points);
        let untagged = |run: &[Record<3>]| run.iter().map(|record| Record { line: 0, ..*record }).collect::<Vec<_>>();
        prop_assert_eq!(untagged(&plain.records), untagged(&marked.records));
        prop_assert!(marked.records.windows(2).all(|pair| pair[0].line <= pair[1].line));
    }
}

/// The records behind a mark begin where it is, in lines that are merged, lines that are not, and arcs.
#[test]
fn a_mark_is_at_its_place() {
    let limits = MachineLimits::built_in();
    let arc = retrace_motion::Arc { plane: [0, 1], centre_mm: [0.0, 10.0], rotation: 1, end_mm: [0.0, 20.0, 0.0] };
    for mode in [PathMode::blend(0.05), PathMode::ExactPath, PathMode::ExactStop] {
        for path in [Path::Line([60.0, 0.0, 0.0]), Path::Arc(arc)] {
            let moves = [Move { path, feed: FeedRate::PerSecond(20.0), mode, stop: false }];
            let shares = [0.1, 0.25, 0.8];
            let run = play_marked(limits, &moves, &[shares.to_vec()]);
            for (share, tag) in shares.into_iter().zip(2..) {
                let first =
                    run.records.iter().position(|record: &Record<3>| record.line == tag).expect("marked records");
                let angle = std::f64::consts::PI * share;
                let [x, y] = match path {
                    Path::Line(end) => [share * end[0], 0.0],
                    Path::Arc(_) => [10.0 * angle.sin(), 10.0 - 10.0 * angle.cos()],
                };
                let apart = |n: usize| (run.points[n][0] - x).hypot(run.points[n][1] - y);
                assert!(apart(first - 1) <= 0.0201 && apart(first) <= 0.0201, "{mode:?} {path:?} {share}");
            }
        }
    }
}
