//! Speed of planning and of emission, on one core.
//!
//! Invariant: rounds go over all paths in turn, so that other load affects them alike; a figure is the median of its
//! rounds.

use std::hint::black_box;
use std::time::Instant;

use retrace_core::Flags;
use retrace_motion::{MachineLimits, Planner};

use crate::row::{Goal, Row, median};
use crate::test_paths::{self, TestPath};

const ROUNDS: usize = 5;

/// Rows of S2 to S5.
pub(crate) fn rows(full: bool) -> Vec<Row> {
    let blocks = 100_000;
    let paths = test_paths::all(blocks);
    let rounds = if full { 2 * ROUNDS + 1 } else { ROUNDS };
    let mut all: Vec<Vec<Round>> = vec![Vec::new(); paths.len()];
    let mut admitting: Vec<Admission> = paths.iter().map(|path| Admission::new(path.moves.len())).collect();
    for _ in 0..rounds {
        for ((path, all), admission) in paths.iter().zip(&mut all).zip(&mut admitting) {
            all.push(Round::of(path));
            admission.look(path);
        }
    }
    let mut rows = Vec::new();
    for (path, rounds) in paths.iter().zip(&all) {
        let figure = median(rounds.iter().map(|round| path.moves.len() as f64 / round.planning / 1e6).collect());
        let what = format!("planning with blends, {}, {blocks} blocks", path.name);
        let note = format!("{:.0} ns a block", 1e3 / figure);
        rows.push(Row { name: "S2", what, figure, unit: "million blocks/s", goal: Goal::AtLeast(1.0), note });
    }
    for (path, rounds) in paths.iter().zip(&all) {
        let over = |look_ahead: fn(&Round) -> f64| median(rounds.iter().map(look_ahead).collect());
        let (wide, narrow) = (over(|round| round.wide), over(|round| round.narrow));
        let what = format!("cost a block, window of 10 000 over window of 100, {}", path.name);
        let per_block = |seconds: f64| seconds / path.moves.len() as f64 * 1e9;
        let note = format!("{:.0} and {:.0} ns a block", per_block(wide), per_block(narrow));
        rows.push(Row { name: "S3", what, figure: wide / narrow, unit: "", goal: Goal::AtMost(1.2), note });
    }
    for (path, admission) in paths.iter().zip(&admitting) {
        rows.push(admission.row(path));
    }
    for (path, rounds) in paths.iter().zip(&all) {
        let figure = median(rounds.iter().map(|round| round.period).collect());
        let what = format!("emission, 3 axes, {}", path.name);
        let note = "planned ahead, then taken out".to_owned();
        rows.push(Row { name: "S5", what, figure, unit: "ns a period", goal: Goal::AtMost(50.0), note });
    }
    rows
}

/// Result of one round over a path.
#[derive(Clone, Copy, Debug)]
struct Round {
    /// Duration of planning the whole path, s: with the default look-ahead, and with windows of 10 000 and 100 blocks.
    planning: f64,
    wide: f64,
    narrow: f64,
    /// Nanoseconds per period.
    period: f64,
}

impl Round {
    fn of(path: &TestPath) -> Self {
        let (planning, period) = timed(path, TestPath::planner());
        let window = |blocks: usize| {
            let planner = Planner::with_look_ahead(MachineLimits::built_in(), [0.0; 3], blocks);
            timed(path, planner.expect("the built-in machine is valid")).0
        };
        // In turn, so that neither has the warmer caches.
        Self { planning, wide: window(10_000), narrow: window(100), period }
    }
}

/// Moves between two readings of the clock.
const CHUNK: usize = 1000;

/// Duration of planning the path in s, and of taking its records out in ns per period. Both in turn, a chunk of moves
/// and then the records that are committed, so that the use of memory is as in practice.
fn timed(path: &TestPath, mut planner: Planner<3>) -> (f64, f64) {
    let (mut planning, mut emission, mut records) = (0.0, 0.0, 0u64);
    let mut k = 0;
    while k <= path.moves.len() {
        let started = Instant::now();
        for _ in 0..CHUNK {
            if k < path.moves.len() {
                path.push(&mut planner, k);
            } else if k == path.moves.len() {
                planner.stop(Flags::NONE);
            }
            k += 1;
        }
        let planned = Instant::now();
        while let Some(record) = planner.next_record() {
            black_box(record);
            records += 1;
        }
        planning += (planned - started).as_secs_f64();
        emission += planned.elapsed().as_secs_f64();
    }
    (planning, emission / records.max(1) as f64 * 1e9)
}

/// Least time of admitting each block: the work for a block is equal in every round, interruptions are not.
#[derive(Clone, Debug)]
struct Admission {
    /// Nanoseconds of admitting each block.
    admitting: Vec<u32>,
    /// Nanoseconds of admitting each block and taking out the records that it releases.
    with_records: Vec<u32>,
}

impl Admission {
    fn new(blocks: usize) -> Self {
        Self { admitting: vec![u32::MAX; blocks], with_records: vec![u32::MAX; blocks] }
    }

    fn look(&mut self, path: &TestPath) {
        let mut planner = TestPath::planner();
        for k in 0..path.moves.len() {
            let started = Instant::now();
            path.push(&mut planner, k);
            let admitted = started.elapsed();
            while let Some(record) = planner.next_record() {
                black_box(record);
            }
            let all = started.elapsed();
            let least = |kept: &mut u32, took: std::time::Duration| {
                *kept = (*kept).min(u32::try_from(took.as_nanos()).unwrap_or(u32::MAX));
            };
            least(&mut self.admitting[k], admitted);
            least(&mut self.with_records[k], all);
        }
    }

    fn row(&self, path: &TestPath) -> Row {
        let at = |of: &[u32], share: f64| {
            let mut sorted = of.to_vec();
            sorted.sort_unstable();
            f64::from(sorted[((sorted.len() - 1) as f64 * share) as usize]) / 1e3
        };
        let figure = at(&self.admitting, 0.9999);
        let what = format!("admitting one block, p99.99, {}", path.name);
        let [p50, p99, most] = [0.5, 0.99, 1.0].map(|share| at(&self.admitting, share));
        let note = format!(
            "p50 {p50:.2}, p99 {p99:.1}, largest {most:.1}; with the records that it sets free p99.99 {:.1}",
            at(&self.with_records, 0.9999)
        );
        Row { name: "S4", what, figure, unit: "µs", goal: Goal::AtMost(100.0), note }
    }
}
