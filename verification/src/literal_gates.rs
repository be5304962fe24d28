//! The gates of GMC-4 … GMC-6 as the source defines them, searched until they fail, and ours searched in the same way.
//!
//! `literal` is the source's machine, `acknowledged` drives the gates of `retrace-core`; both send to the same `card`.
//! The search takes every step that any part may take next, whatever its speed, and breadth first, so that a failing
//! trace is a shortest one.
//!
//! Invariant: a search is a pure function of its bounds: the same steps in the same order, on every machine.

mod acknowledged;
mod card;
mod literal;
mod search;

use std::fmt;

pub use card::Failure;
use literal::{Empty, Literal};

/// A run that ends in a failure, one line per step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Trace {
    /// Program of the run.
    pub program: String,
    /// Steps, in order.
    pub steps: Vec<String>,
    /// Failure of the last step.
    pub failure: Failure,
}

impl fmt::Display for Trace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "Program: {}.", self.program)?;
        for (number, step) in (1..).zip(&self.steps) {
            writeln!(f, "{number}. {step}.")?;
        }
        writeln!(f, "Failure: {}.", self.failure)
    }
}

/// Result of a whole search.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Number of programs searched: records, markers at given places, delay.
    pub programs: usize,
    /// Number of states reached, all programs together.
    pub states: usize,
    /// Number of steps from one state to another.
    pub steps: usize,
    /// Number of states from which the end of the program cannot be reached.
    pub stuck: usize,
    /// The first failure, if there is one.
    pub failure: Option<Trace>,
}

impl Counts {
    fn add(&mut self, other: Self) {
        self.programs += other.programs;
        self.states += other.states;
        self.steps += other.steps;
        self.stuck += other.stuck;
        self.failure = self.failure.take().or(other.failure);
    }
}

/// The shortest failures of the literal gates where the flags B2 and C2 are sampled and at most one report is under
/// way, "empty" being read as an event: motion beside an instruction (B2 late), and an instruction beside motion (C2
/// late).
///
/// # Panics
/// Where the search no longer finds them.
#[must_use]
pub fn search_sampled() -> [Trace; 2] {
    [Failure::MotionTooEarly, Failure::InstructionTooEarly]
        .map(|failure| shortest(1, Empty::Event, failure).expect("sampled flags fail"))
}

/// The shortest failure of the literal gates where "buffer empty" is read as a level, with no delay at all.
///
/// # Panics
/// Where the search no longer finds it.
#[must_use]
pub fn search_level() -> Trace {
    shortest(0, Empty::Level, Failure::MotionTooEarly).expect("a level fails")
}

/// The literal gates with no delay and "empty" read as an event: the reading that the source presumably intended.
#[must_use]
pub fn search_intended(records: u8, markers: usize) -> Counts {
    let mut counts = Counts::default();
    for program in programs(records, markers) {
        counts.add(search::everything(&Literal::new(program, 0, Empty::Event)));
    }
    counts
}

/// The acknowledged gates of `retrace-core`, over every program of up to `records` records and `markers` markers, with
/// 0 to `delay` reports under way.
#[must_use]
pub fn search_acknowledged(records: u8, markers: usize, delay: usize) -> Counts {
    let mut counts = Counts::default();
    for program in programs(records, markers) {
        for delay in 0..=delay {
            counts.add(search::everything(&acknowledged::Acknowledged::new(program.clone(), delay)));
        }
    }
    counts
}

/// The shortest trace to `failure` over all small programs, the shorter program first.
fn shortest(delay: usize, empty: Empty, failure: Failure) -> Option<Trace> {
    programs(2, 2)
        .filter_map(|program| search::shortest(&Literal::new(program, delay, empty), failure))
        .min_by_key(|trace| trace.steps.len())
}

/// Records with markers between them: the records, counted from 0, before which the markers are, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Program {
    records: u8,
    markers: Vec<u8>,
}

impl fmt::Display for Program {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut words = Vec::new();
        for record in 0..=self.records {
            let here = (1..).zip(&self.markers).filter(|(_, marker)| **marker == record);
            words.extend(here.map(|(number, _)| format!("instruction {number}")));
            if record < self.records {
                words.push(format!("record {}", record + 1));
            }
        }
        f.write_str(&words.join(", "))
    }
}

/// Every program of at most so many records and markers, but the empty one, in order of size.
fn programs(records: u8, markers: usize) -> impl Iterator<Item = Program> {
    (0..=records).flat_map(move |records| {
        (0..=markers).flat_map(move |count| placed(records, count)).map(move |markers| Program { records, markers })
    })
}

/// Every way to place `count` markers before, between and behind so many records.
fn placed(records: u8, count: usize) -> Vec<Vec<u8>> {
    let mut ways = vec![Vec::new()];
    for _ in 0..count {
        ways = ways
            .into_iter()
            .flat_map(|places: Vec<u8>| {
                let from = places.last().copied().unwrap_or(0);
                (from..=records).map(move |marker| places.iter().copied().chain([marker]).collect())
            })
            .collect();
    }
    ways
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sampled_flags_still_fail_as_the_counterexamples_say() {
        let [motion, instruction] = search_sampled();
        let text = include_str!("../counterexamples/literal-gates-sampled.txt");
        assert!(text.ends_with(&format!("\n{motion}\n{instruction}")), "the search finds\n{motion}\n{instruction}");
    }

    #[test]
    fn the_level_still_fails_as_the_counterexample_says() {
        let trace = search_level();
        let text = include_str!("../counterexamples/literal-gates-level.txt");
        assert!(text.ends_with(&format!("\n{trace}")), "the search finds\n{trace}");
    }

    /// Shows that the failures above result from the delay and from the level, and from nothing else in the model.
    #[test]
    fn without_delay_and_without_the_level_the_literal_gates_hold() {
        let counts = search_intended(3, 2);
        println!("literal gates, no delay, event: {counts:?}");
        assert_eq!((counts.failure, counts.stuck), (None, 0));
    }

    #[test]
    fn the_acknowledged_gates_hold_under_every_delay() {
        let counts = search_acknowledged(4, 3, 3);
        println!("acknowledged gates, 4 records, 3 markers, 0 to 3 reports under places: {counts:?}");
        assert_eq!((counts.failure, counts.stuck), (None, 0));
        assert!(counts.states > 2_000_000, "{} states only", counts.states);
    }
}
