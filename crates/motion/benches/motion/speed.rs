//! Speed of planning and of emission, on one core.
//!
//! Invariant: rounds go over all roads in turn, so that load from elsewhere meets them alike; a figure is the median of its
//! rounds.

use std::hint::black_box;
use std::time::Instant;

use retrace_core::Flags;
use retrace_motion::{MachineLimits, Planner};

use crate::roads::{self, Road};
use crate::row::{Goal, Row, median};

const ROUNDS: usize = 5;

/// S2 to S5.
pub(crate) fn rows(full: bool) -> Vec<Row> {
    let blocks = 100_000;
    let roads = roads::all(blocks);
    let rounds = if full { 2 * ROUNDS + 1 } else { ROUNDS };
    let mut all: Vec<Vec<Round>> = vec![Vec::new(); roads.len()];
    let mut admitting: Vec<Admission> = roads.iter().map(|road| Admission::new(road.ways.len())).collect();
    for _ in 0..rounds {
        for ((road, all), admission) in roads.iter().zip(&mut all).zip(&mut admitting) {
            all.push(Round::of(road));
            admission.look(road);
        }
    }
    let mut rows = Vec::new();
    for (road, rounds) in roads.iter().zip(&all) {
        let figure = median(rounds.iter().map(|round| road.ways.len() as f64 / round.planning / 1e6).collect());
        let what = format!("planning with blends, {}, {blocks} blocks", road.name);
        let note = format!("{:.0} ns a block", 1e3 / figure);
        rows.push(Row { name: "S2", what, figure, unit: "million blocks/s", goal: Goal::AtLeast(1.0), note });
    }
    for (road, rounds) in roads.iter().zip(&all) {
        let over = |look_ahead: fn(&Round) -> f64| median(rounds.iter().map(look_ahead).collect());
        let (wide, narrow) = (over(|round| round.wide), over(|round| round.narrow));
        let what = format!("cost a block, window of 10 000 over window of 100, {}", road.name);
        let per_block = |seconds: f64| seconds / road.ways.len() as f64 * 1e9;
        let note = format!("{:.0} and {:.0} ns a block", per_block(wide), per_block(narrow));
        rows.push(Row { name: "S3", what, figure: wide / narrow, unit: "", goal: Goal::AtMost(1.2), note });
    }
    for (road, admission) in roads.iter().zip(&admitting) {
        rows.push(admission.row(road));
    }
    for (road, rounds) in roads.iter().zip(&all) {
        let figure = median(rounds.iter().map(|round| round.period).collect());
        let what = format!("emission, 3 axes, {}", road.name);
        let note = "planned ahead, then taken out".to_owned();
        rows.push(Row { name: "S5", what, figure, unit: "ns a period", goal: Goal::AtMost(50.0), note });
    }
    rows
}

/// What one round over a road takes.
#[derive(Clone, Copy, Debug)]
struct Round {
    /// Seconds for the whole road: as the planner is, and with windows of 10 000 and 100 blocks.
    planning: f64,
    wide: f64,
    narrow: f64,
    /// Nanoseconds a period.
    period: f64,
}

impl Round {
    fn of(road: &Road) -> Self {
        let (planning, period) = timed(road, Road::planner());
        let window = |blocks: usize| {
            let planner = Planner::with_look_ahead(MachineLimits::built_in(), [0.0; 3], blocks);
            timed(road, planner.expect("the built-in machine is valid")).0
        };
        // In turn, so that neither has the warmer caches.
        Self { planning, wide: window(10_000), narrow: window(100), period }
    }
}

/// Moves between two looks at the clock.
const CHUNK: usize = 1000;

/// Seconds of planning the road, and nanoseconds a period of taking its records out. Both in turn, a chunk of moves and then the
/// records that are committed, so that memory stays as it is in use.
fn timed(road: &Road, mut planner: Planner<3>) -> (f64, f64) {
    let (mut planning, mut emission, mut records) = (0.0, 0.0, 0u64);
    let mut k = 0;
    while k <= road.ways.len() {
        let started = Instant::now();
        for _ in 0..CHUNK {
            if k < road.ways.len() {
                road.push(&mut planner, k);
            } else if k == road.ways.len() {
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

/// How long admitting each block takes at the least: the work for a block is the same in every round, interruptions are not.
#[derive(Clone, Debug)]
struct Admission {
    /// Nanoseconds of admitting each block.
    admitting: Vec<u32>,
    /// The same with taking out the records that it sets free.
    with_records: Vec<u32>,
}

impl Admission {
    fn new(blocks: usize) -> Self {
        Self { admitting: vec![u32::MAX; blocks], with_records: vec![u32::MAX; blocks] }
    }

    fn look(&mut self, road: &Road) {
        let mut planner = Road::planner();
        for k in 0..road.ways.len() {
            let started = Instant::now();
            road.push(&mut planner, k);
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

    fn row(&self, road: &Road) -> Row {
        let at = |of: &[u32], share: f64| {
            let mut sorted = of.to_vec();
            sorted.sort_unstable();
            f64::from(sorted[((sorted.len() - 1) as f64 * share) as usize]) / 1e3
        };
        let figure = at(&self.admitting, 0.9999);
        let what = format!("admitting one block, p99.99, {}", road.name);
        let [p50, p99, most] = [0.5, 0.99, 1.0].map(|share| at(&self.admitting, share));
        let note = format!(
            "p50 {p50:.2}, p99 {p99:.1}, largest {most:.1}; with the records that it sets free p99.99 {:.1}",
            at(&self.with_records, 0.9999)
        );
        Row { name: "S4", what, figure, unit: "µs", goal: Goal::AtMost(100.0), note }
    }
}
