//! The rate filter against its definition, in exact numbers, at every length that a card allows.
//!
//! Invariant: only a native run calls this, and nothing here asks the filter for a sum or a remainder.

use super::TOP;
use crate::choice::Choice;
use crate::ledger::Size;
use crate::native::Draw;
use retrace_core::rate::{FilterLengths, RateFilter};
use retrace_core::{Distance, Rate};
use std::collections::VecDeque;

/// Drawn targets of one sign through averages over one and `length` periods: in every period the rate is between the
/// least and the greatest remembered one, the lead is what the memory has not released, rounded up, and the rate
/// changes by what enters less what leaves, over the length, within two last bits; at the end nothing is left.
pub(super) fn filter_is_its_definition(size: Size) -> String {
    let mut draw = Draw::new(size.seed);
    let (step, mut lengths, mut periods) = (if size.full { 2 } else { 130 }, 0u32, 0u64);
    for length in (1..FilterLengths::MAX_PERIODS).step_by(step) {
        let mut run = Run::new(length, if draw.flag() { 1 } else { -1 });
        // a memory of anything, then targets that stay for a while
        for _ in 0..=length {
            run.step(draw.between(0, TOP));
        }
        for _ in 0..4 {
            let target = draw.between(0, TOP);
            for _ in 0..=draw.upto(u32::from(length) / 2) {
                run.step(target);
            }
            run.agree();
        }
        for _ in 0..length {
            run.step(0);
        }
        assert!(run.filter.at_rest() && run.filter.lead() == Distance::ZERO, "length {length}");
        (lengths, periods) = (lengths + 1, periods + run.periods);
    }
    format!("{lengths} lengths up to {}, {periods} periods", FilterLengths::MAX_PERIODS - 1)
}

/// A filter, and what is known of it by its definition.
struct Run {
    filter: Box<RateFilter<4096>>,
    sign: i64,
    /// Targets remembered, the newest last.
    memory: VecDeque<i128>,
    sum: i128,
    commanded: i128,
    moved: i128,
    /// Distance moved in the last period.
    last: i128,
    periods: u64,
}

impl Run {
    fn new(length: u16, sign: i64) -> Self {
        let lengths = FilterLengths::new(1, length).expect("odd");
        let memory = VecDeque::from(vec![0; usize::from(length)]);
        let filter = Box::new(RateFilter::new(lengths).expect("fits"));
        Self { filter, sign, memory, sum: 0, commanded: 0, moved: 0, last: 0, periods: 0 }
    }

    /// One period, with this target in the direction of the run.
    fn step(&mut self, target: i64) {
        let (target, length) = (self.sign * target, self.memory.len() as i128);
        let moved = i128::from(self.filter.step(Rate::from_units(target)).units());
        let entering = i128::from(target);
        let leaving = self.memory.pop_front().expect("a length is at least one");
        self.memory.push_back(entering);
        self.sum += entering - leaving;
        self.commanded += entering;
        self.moved += moved;
        let off = length * (moved - self.last) - (entering - leaving);
        assert!(off.abs() <= 2 * length, "length {length}: {off} more than what enters and leaves");
        // what the average is behind by is the rounding alone
        assert!((length * moved - self.sum).abs() < length, "length {length}: {moved} of {}", self.sum);
        let lead = i128::from(self.filter.lead().units());
        assert!(lead == self.commanded - self.moved, "length {length}: a lead of {lead}");
        assert!(self.filter.target().units() == target && self.filter.at_rest() == (self.sum == 0));
        (self.last, self.periods) = (moved, self.periods + 1);
    }

    /// Compares the filter with its whole memory.
    fn agree(&self) {
        let length = self.memory.len() as i128;
        // the newest target has been released once of `length` times, the oldest as often as it can be
        let pending: i128 = (0..).zip(&self.memory).map(|(weight, target)| weight * target).sum();
        let over = length * i128::from(self.filter.lead().units()) - pending;
        assert!((0..length).contains(&over), "length {length}: the lead is {over} above what is pending");
        let (low, high) = (self.memory.iter().min(), self.memory.iter().max());
        assert!(low <= Some(&self.last) && Some(&self.last) <= high, "length {length}: {} overshoots", self.last);
        let highest = self.memory.iter().map(|target| target.abs()).max();
        assert!(highest == Some(i128::from(self.filter.max_target().units())), "length {length}");
    }
}
