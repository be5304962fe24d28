//! The speed of one solve beside rsruckig's, and the count of equal durations, on the random cases of `tests/solver`.
//!
//! Invariant: all solvers get the same cases in turns of a few hundred, so that a busy machine slows all of them alike.
//!
//! `cargo run --release -p retrace-motion --example solver_speed [CASES]`

#[path = "../tests/solver/cases.rs"]
mod cases;
#[path = "../tests/solver/peer.rs"]
mod peer;
#[path = "../tests/solver/verdict.rs"]
mod verdict;

use cases::{Case, case};
use peer::Peer;
use retrace_motion::profile::{fastest, fastest_any_way};
use std::hint::black_box;
use std::time::Instant;
use verdict::{Tally, judge};

const TURN: u64 = 250;

fn main() {
    let count: u64 = std::env::args().nth(1).and_then(|given| given.parse().ok()).unwrap_or(100_000);
    let mut peer = Peer::new();
    let mut turns: [Vec<f64>; 4] = Default::default();
    for first in (0..count).step_by(TURN as usize) {
        let cases: Vec<Case> = (first..first + TURN).map(case).collect();
        let mut time = |row: usize, solve: &mut dyn FnMut(&Case) -> f64| {
            let start = Instant::now();
            for case in &cases {
                black_box(solve(black_box(case)));
            }
            turns[row].push(start.elapsed().as_secs_f64() * 1e9 / cases.len() as f64);
        };
        time(0, &mut |c| fastest_any_way(c.from, c.to, c.length, c.limits).map_or(0.0, |p| p.times[3]));
        time(1, &mut |c| {
            peer.set(c);
            peer.solve().unwrap_or(0.0)
        });
        time(2, &mut |c| peer.solve_bare(c).unwrap_or(0.0));
        let forward: Vec<Case> = cases.iter().map(forward).collect();
        let start = Instant::now();
        for c in &forward {
            let _ = black_box(fastest(c.from, c.to, c.length, black_box(c.limits)));
        }
        turns[3].push(start.elapsed().as_secs_f64() * 1e9 / forward.len() as f64);
    }
    let [ours, theirs, bare, ahead] = turns.map(|mut turn| {
        turn.sort_by(f64::total_cmp);
        turn[turn.len() / 2]
    });
    println!("{count} cases, medians over turns of {TURN}");
    println!("fastest_any_way                {ours:8.1} ns");
    println!("rsruckig, calculate            {theirs:8.1} ns  {:5.1} times ours", theirs / ours);
    println!("rsruckig, its solver alone     {bare:8.1} ns  {:5.1} times ours", bare / ours);
    println!("fastest, forward cases         {ahead:8.1} ns");
    let mut tally = Tally::default();
    for k in 0..count {
        tally.count(judge(&case(k), &mut peer));
    }
    println!("{tally}");
}

/// The case with its signs taken off, as look-ahead asks: speeds and distance are not negative.
fn forward(case: &Case) -> Case {
    let mut forward = *case;
    (forward.from.v, forward.to.v) = (case.from.v.abs(), case.to.v.abs());
    forward.length = case.length.abs();
    forward
}
