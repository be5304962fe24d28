//! The speed of one solve compared with rsruckig's, and the count of equal durations, on the random cases of
//! `tests/solver`.
//!
//! Invariant: all solvers get the same cases in turns of a few hundred, so that other load slows all of them alike.
//!
//! `cargo run --release -p retrace-motion --example solver_speed [CASES]`

#[path = "../tests/testsuite/solver/cases.rs"]
mod cases;
#[path = "../tests/testsuite/solver/outcome.rs"]
mod outcome;
#[path = "../tests/testsuite/solver/peer.rs"]
mod peer;

use cases::{Case, case};
use outcome::{Tally, compare};
use peer::Peer;
use retrace_motion::profile::{KinematicState, fastest, fastest_any_way};
use std::hint::black_box;
use std::time::Instant;

const TURN: u64 = 250;

/// Repetitions of one case when it is timed alone.
const AGAIN: u32 = 20;

fn main() {
    let count: u64 = std::env::args().nth(1).and_then(|given| given.parse().ok()).unwrap_or(100_000);
    let mut peer = Peer::new();
    let mut mixed: [Vec<f64>; 4] = Default::default();
    let mut alone: [Vec<f64>; 4] = Default::default();
    for first in (0..count).step_by(TURN as usize) {
        let cases: Vec<Case> = (first..first + TURN).map(case).collect();
        for (solver, times) in mixed.iter_mut().enumerate() {
            let start = Instant::now();
            for case in &cases {
                solve(solver, black_box(case), &mut peer);
            }
            times.push(start.elapsed().as_secs_f64() * 1e9 / cases.len() as f64);
        }
        for case in cases.iter().step_by(10) {
            for (solver, times) in alone.iter_mut().enumerate() {
                let start = Instant::now();
                for _ in 0..AGAIN {
                    solve(solver, black_box(case), &mut peer);
                }
                times.push(start.elapsed().as_secs_f64() * 1e9 / f64::from(AGAIN));
            }
        }
    }
    print_times(&format!("{count} cases one after the other, medians over turns of {TURN}"), mixed);
    print_times(&format!("each tenth case {AGAIN} times, medians over the cases"), alone);
    let mut tally = Tally::default();
    for k in 0..count {
        let outcome = compare(&case(k), &mut peer);
        assert!(outcome.is_sound(), "case {k}: {outcome:?}");
        tally.count(outcome);
    }
    println!("{tally}");
}

/// Solves a case by one of the four.
#[inline]
fn solve(solver: usize, case: &Case, peer: &mut Peer) {
    match solver {
        0 => {
            let _ = black_box(fastest_any_way(case.from, case.to, case.length, case.limits));
        }
        1 => {
            peer.set(case);
            let _ = black_box(peer.solve());
        }
        2 => {
            let _ = black_box(peer.solve_bare(case));
        }
        _ => {
            // Without its signs, as look-ahead requires: speeds and distance are not negative.
            let upright = |state: KinematicState| KinematicState { v: state.v.abs(), ..state };
            let _ = black_box(fastest(upright(case.from), upright(case.to), case.length.abs(), case.limits));
        }
    }
}

fn print_times(title: &str, times: [Vec<f64>; 4]) {
    let [ours, theirs, bare, ahead] = times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    });
    println!("{title}");
    println!("  fastest_any_way                {ours:8.1} ns");
    println!("  rsruckig, calculate            {theirs:8.1} ns  {:5.1} times ours", theirs / ours);
    println!("  rsruckig, its solver alone     {bare:8.1} ns  {:5.1} times ours", bare / ours);
    println!("  fastest, forward cases         {ahead:8.1} ns");
}
