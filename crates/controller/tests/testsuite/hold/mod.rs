//! Planned paths, and a card that plays them under the limit monitor.

use proptest::prelude::*;
use retrace_config::MachineConfig;
use retrace_controller::{LimitMonitor, MonitorLimits};
use retrace_core::{Flags, Place, Rate, Record, RecordIndex};
use retrace_hal_sim::{Clock, SimCard};
use retrace_link::{CardStatus, HostCommand, MotionCard};
use retrace_motion::{Arc, FeedRate, PathMode, Planner};

/// The fastest feed.
pub(crate) const FEED_MM_S: f64 = 100.0;

/// Approximate maximum number of records of a path.
const LONGEST: usize = 1 << 15;

/// A programmed move: its end, its centre if it is an arc, and its parameters.
#[derive(Clone, Debug)]
pub(crate) struct Move {
    end: [f64; 3],
    centre: Option<[f64; 2]>,
    turns: i32,
    feed: f64,
    mode: PathMode,
}

/// A straight run of two seconds.
pub(crate) fn line(feed: f64) -> Vec<Move> {
    vec![Move { end: [feed * 2.0, 0.0, 0.0], centre: None, turns: 1, feed, mode: PathMode::ExactStop }]
}

/// Two seconds and more on the circle on which this feed takes all of the acceleration that the plan may use.
pub(crate) fn circle(feed: f64) -> Vec<Move> {
    // or, where that is tighter, all of the jerk
    let radius = (feed * feed / 899.0).max((feed.powi(3) / 17_900.0).sqrt());
    let turns = 1 + (2.0 * feed / (std::f64::consts::TAU * radius)) as i32;
    vec![Move { end: [0.0; 3], centre: Some([radius, 0.0]), turns, feed, mode: PathMode::ExactStop }]
}

/// Any path of lines and arcs, sharp corners and slight ones, chains and long moves.
pub(crate) fn paths() -> impl Strategy<Value = Vec<Move>> {
    let way = prop_oneof![(-60.0..60.0f64, -60.0..60.0f64), (-3.0..3.0f64, -3.0..3.0f64)];
    let feed = prop_oneof![Just(FEED_MM_S), 12.0..FEED_MM_S];
    let one = (
        way,
        -2.0..2.0f64,
        feed,
        any::<bool>(),
        prop_oneof![3 => Just(None), 1 => Just(Some(0.5)), 1 => Just(Some(0.05))],
        0u8..6,
    );
    prop::collection::vec(one, 1..8).prop_map(|moves| {
        let (mut at, mut path) = ([0.0; 3], Vec::new());
        for ((x, y), z, feed, round, tolerance, stop) in moves {
            let mode = match (stop, tolerance) {
                (0, _) => PathMode::ExactStop,
                (_, None) => PathMode::ExactPath,
                (_, Some(tolerance_mm)) => PathMode::blend(tolerance_mm),
            };
            let end = [at[0] + x, at[1] + y, at[2] + z];
            let centre = (round && x.hypot(y) > 0.2).then(|| [at[0] + x / 2.0, at[1] + y / 2.0]);
            path.push(Move { end, centre, turns: 1, feed, mode });
            at = end;
        }
        path
    })
}

/// The path's records, from the planner for the built-in machine.
pub(crate) fn records(path: &[Move]) -> Vec<Record<3>> {
    let machine = MachineConfig::built_in().expect("valid");
    let mut planner = Planner::new(machine.limits(), [0.0; 3]).expect("valid");
    let mut records = Vec::new();
    for (k, m) in path.iter().enumerate() {
        if records.len() > LONGEST / 4 {
            break;
        }
        let (feed, tag) = (FeedRate::PerSecond(m.feed), k as u32 + 1);
        match m.centre {
            None => planner.line(m.end, feed, m.mode, tag).expect("a valid line"),
            Some(centre_mm) => {
                let arc = Arc { plane: [0, 1], centre_mm, end_mm: m.end, rotation: m.turns };
                planner.arc(&arc, feed, m.mode, tag).expect("a valid arc");
            }
        }
        records.extend(std::iter::from_fn(|| planner.next_record()));
    }
    planner.stop(Flags::NONE);
    records.extend(std::iter::from_fn(|| planner.next_record()));
    assert!(records.len() < LONGEST, "{} records", records.len());
    records
}

/// Measurements of a hold.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stop {
    /// The rate at which it began.
    pub from: Rate,
    /// Periods from the command to rest.
    pub periods: u32,
    /// The period with the first lower rate; 0 where it was at rest.
    pub first_slower: u32,
    /// Length of path that was run, in mm.
    pub length_mm: f64,
}

/// A card that plays a path, and its limit monitor.
pub(crate) struct Played {
    card: SimCard<3>,
    monitor: Box<LimitMonitor<3>>,
    records: Vec<Record<3>>,
    log: Vec<(Place, Rate, [i32; 3])>,
    asked: Rate,
}

impl Played {
    pub(crate) fn of(records: Vec<Record<3>>) -> Self {
        let machine = MachineConfig::built_in().expect("valid");
        let axis = |i: usize| {
            let a = &machine.axes[i];
            MonitorLimits {
                pulses_per_mm: a.pulses_per_mm,
                velocity_mm_s: a.max_velocity_mm_per_s,
                acceleration_mm_s2: a.max_acceleration_mm_per_s2,
                jerk_mm_s3: a.max_jerk_mm_per_s3,
            }
        };
        let limits = machine.rate_limits().expect("checked");
        let card = SimCard::new(RecordIndex::new(0), limits, Clock::Virtual).expect("fits");
        let monitor = Box::new(LimitMonitor::new(&std::array::from_fn(axis), machine.period_s()));
        Self { card, monitor, records, log: Vec::new(), asked: Rate::ZERO }
    }

    fn status(&self) -> &CardStatus<3> {
        self.card.status()
    }

    /// Slides the card's window as far as possible in the requested direction.
    fn feed(&mut self) {
        loop {
            let (low, high) = (self.status().low.number(), self.status().high.number() as usize);
            let word = if self.asked >= Rate::ZERO && high < self.records.len() {
                HostCommand::Ahead { place: RecordIndex::new(high as u32), record: self.records[high] }
            } else if self.asked < Rate::ZERO && low > 0 {
                let n = low as usize - 1;
                let rests = n == 0 || self.records[n - 1].flags.contains(Flags::REST);
                HostCommand::Behind { place: RecordIndex::new(n as u32), record: self.records[n], rests }
            } else {
                return;
            };
            if self.card.send(word).is_err() {
                return;
            }
        }
    }

    fn period(&mut self) {
        self.feed();
        let status = *self.card.run_period().expect("no fault");
        self.monitor.push(&status.increments, status.rate);
        self.log.push((status.place, status.rate, status.increments));
    }

    /// Requests a rate for this number of periods.
    pub(crate) fn ask(&mut self, target: Rate, periods: u32) {
        self.card.send(HostCommand::rate(target)).expect("a rate");
        self.asked = target;
        (0..periods).for_each(|_| self.period());
    }

    /// Requests a rate until the card rests at an end of the path.
    pub(crate) fn ask_until_rest(&mut self, target: Rate) {
        let end = if target < Rate::ZERO { 0 } else { self.records.len() as u32 };
        self.ask(target, 0);
        for _ in 0..4 * LONGEST {
            if self.status().at_rest && self.status().place == Place::start_of(RecordIndex::new(end)) {
                return;
            }
            self.period();
        }
        panic!("never at the end");
    }

    /// Runs as recorded to the middle of the path. Returns the speed there, in mm/s.
    pub(crate) fn run_to_speed(&mut self) -> f64 {
        self.ask(Rate::ONE, self.records.len() as u32 / 2);
        let last = self.log.iter().rev().take(20);
        last.map(|(.., pulses)| length(pulses)).sum::<f64>() / 20.0
    }

    /// Runs as recorded, directly or in both directions, to a share of the path.
    pub(crate) fn run_to_share(&mut self, share: f64, backward: bool) {
        let place = (share * self.records.len() as f64) as u32;
        if backward {
            self.ask_until_rest(Rate::ONE);
            self.ask(-Rate::ONE, self.records.len() as u32 - place);
        } else {
            self.ask(Rate::ONE, place);
        }
    }

    /// Holds until rest.
    pub(crate) fn hold(&mut self) -> Stop {
        let (from, asked) = (self.status().rate, self.asked);
        let begin = self.log.len();
        self.ask(Rate::ZERO, 0);
        while !self.status().at_rest {
            self.period();
            assert!(self.log.len() - begin < 5000, "never at rest");
        }
        let run = &self.log[begin..];
        // where the rate was still rising, that has to end first
        let steady = from == asked;
        let slower = run.iter().position(|(_, rate, _)| rate.abs() < from.abs());
        let first_slower = if steady { slower.map_or(0, |n| n as u32 + 1) } else { 0 };
        let length_mm = run.iter().map(|(.., pulses)| length(pulses) / 1000.0).sum();
        Stop { from, periods: run.len() as u32, first_slower, length_mm }
    }

    pub(crate) fn at_end(&self) -> bool {
        self.status().place == Place::start_of(RecordIndex::new(self.records.len() as u32))
    }

    /// Violations that the limit monitor has found so far.
    pub(crate) fn violations(&self) -> Option<String> {
        if !self.status().at_rest {
            // the rest that the monitor assumes behind the end would come too early
            return (self.monitor.violations() > 0).then(|| "in motion".to_string());
        }
        let limit_report = self.monitor.clone().finish();
        (limit_report.violations > 0).then(|| format!("{} {:?}", limit_report.violations, limit_report.first))
    }

    /// Final result of the limit monitor, and the counts.
    pub(crate) fn finish(self) -> [i64; 3] {
        assert_eq!(self.violations(), None);
        self.status().counts
    }
}

/// Length of a record along the path, in pulses.
fn length(pulses: &[i32; 3]) -> f64 {
    pulses.iter().map(|&p| f64::from(p) * f64::from(p)).sum::<f64>().sqrt()
}
