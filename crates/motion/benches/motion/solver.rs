//! One-dimensional profiles compared with rsruckig: durations (Q1) and speed (S1), on the random cases of
//! `tests/solver`.
//!
//! Invariant: the solvers get the same cases in turns of a few hundred, so that other load affects all of them alike.

#[path = "../../tests/testsuite/solver/cases.rs"]
mod cases;
#[path = "../../tests/testsuite/solver/outcome.rs"]
#[allow(dead_code)]
mod outcome;
#[path = "../../tests/testsuite/solver/peer.rs"]
#[allow(dead_code)] // the test uses the rest
mod peer;

use std::hint::black_box;
use std::time::Instant;

use cases::{Case, case};
use outcome::{Tally, compare};
use peer::Peer;
use retrace_motion::profile::fastest_any_way;

use crate::row::{Goal, Row, median};

/// Cases in a turn.
const TURN: u64 = 250;

/// Rows of Q1.
pub(crate) fn durations(full: bool) -> Vec<Row> {
    let count = if full { 1_000_000 } else { 200_000 };
    let (mut peer, mut tally, mut unsound) = (Peer::new(), Tally::default(), 0u32);
    for k in 0..count {
        let outcome = compare(&case(k), &mut peer);
        unsound += u32::from(!outcome.is_sound());
        tally.count(outcome);
    }
    let note =
        tally.to_string().lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" ")).collect::<Vec<_>>();
    let what = format!("1-D profiles of {count} that fail, are slower than rsruckig's or break a limit");
    let note = note.join("; ");
    vec![Row { name: "Q1", what, figure: unsound.into(), unit: "", goal: Goal::AtMost(0.0), note }]
}

/// Rows of S1.
pub(crate) fn speed(full: bool) -> Vec<Row> {
    let count = if full { 1_000_000 } else { 200_000 };
    let mut peer = Peer::new();
    let mut turns: [Vec<f64>; 3] = Default::default();
    for first in (0..count).step_by(TURN as usize) {
        let cases: Vec<Case> = (first..first + TURN).map(case).collect();
        let mut time = |row: usize, solve: &mut dyn FnMut(&Case) -> f64| {
            let started = Instant::now();
            for case in &cases {
                black_box(solve(black_box(case)));
            }
            turns[row].push(started.elapsed().as_secs_f64() * 1e9 / cases.len() as f64);
        };
        time(0, &mut |c| fastest_any_way(c.from, c.to, c.length, c.limits).map_or(0.0, |profile| profile.times[3]));
        time(1, &mut |c| {
            peer.set(c);
            peer.solve().unwrap_or(0.0)
        });
        time(2, &mut |c| peer.solve_bare(c).unwrap_or(0.0));
    }
    let [ours, theirs, bare] = turns.map(median);
    let row =
        |what: &str, figure, goal, note| Row { name: "S1", what: what.to_owned(), figure, unit: "×", goal, note };
    let note = format!("ours {ours:.0} ns, rsruckig {theirs:.0} ns; {count} cases, medians over turns of {TURN}");
    let alone = format!("{bare:.0} ns: neither checks its input nor fills a trajectory");
    vec![
        row("one 1-D solve, rsruckig's time over ours", theirs / ours, Goal::AtLeast(6.0), note),
        row("the same, rsruckig's solver alone", bare / ours, Goal::None, alone),
    ]
}
