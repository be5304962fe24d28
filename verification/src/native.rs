//! The native engine: runs a harness over every choice where they can be enumerated, over drawn ones where they cannot,
//! or over the numbers of a counterexample.
//!
//! Invariant: the same seed draws the same numbers; a failure includes the numbers that replay it.

use crate::choice::{Choice, Property, bits_of};
use crate::region::Region;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// One harness.
#[derive(Clone, Copy, Debug)]
pub struct Harness {
    /// Its name, the same in every engine.
    pub name: &'static str,
    /// Its module.
    pub module: &'static str,
    /// One more than the largest number of turns of a loop in a proof.
    pub unwind: u32,
    /// Regions that must be reached.
    pub covers: &'static [Region],
    /// The property.
    pub property: Property<Native>,
}

/// The sources of this engine. They are one type, so that a property is compiled once.
#[derive(Clone, Debug)]
pub enum Native {
    /// Every choice, one after the other.
    Enumerate(Enumerate),
    /// Drawn choices.
    Draw(Draw),
    /// The numbers of a counterexample.
    Replay(Replay),
}

/// Calls the same function of whichever source it is.
macro_rules! of_source {
    ($native:ident.$call:ident($($argument:expr),*)) => {
        match $native {
            Native::Enumerate(source) => source.$call($($argument),*),
            Native::Draw(source) => source.$call($($argument),*),
            Native::Replay(source) => source.$call($($argument),*),
        }
    };
}

impl Choice for Native {
    fn word(&mut self) -> u32 {
        of_source!(self.word())
    }

    fn below(&mut self, n: u32) -> u32 {
        of_source!(self.below(n))
    }

    fn upto(&mut self, most: u32) -> u32 {
        of_source!(self.upto(most))
    }

    fn between(&mut self, low: i64, high: i64) -> i64 {
        of_source!(self.between(low, high))
    }

    fn assume(&mut self, holds: bool) -> Option<()> {
        holds.then_some(())
    }

    fn cover(&mut self, region: Region, reached: bool) {
        of_source!(self.cover(region, reached));
    }
}

/// Result of a native run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seen {
    /// Number of runs within the assumptions.
    pub runs: u64,
    /// Whether every value of every choice was taken. Otherwise some were only tried around their ends and drawn.
    pub complete: bool,
}

/// Reason why a native run is not a pass.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The property does not hold for these numbers.
    Refuted(Vec<u32>),
    /// No run was within the assumptions.
    Vacuous,
    /// No run within the assumptions reached this region.
    Unreached(Region),
    /// A run reached this region, which the harness does not list.
    Unlisted(Region),
}

impl Harness {
    /// Runs the property over every choice, up to `most` runs; where that is not enough, over as many drawn ones.
    ///
    /// # Errors
    /// [`Failure`], with the numbers that replay it.
    pub fn check(&self, most: u64, seed: u64) -> Result<Seen, Failure> {
        let (mut seen, mut reached) = (Seen { runs: 0, complete: false }, 0);
        let mut source = Native::Enumerate(Enumerate::default());
        for _ in 0..most {
            let holds = run(self.property, &mut source);
            let Native::Enumerate(choices) = &mut source else { break };
            let covered = std::mem::take(&mut choices.covered);
            match holds {
                Ok(true) => (seen.runs, reached) = (seen.runs + 1, reached | covered),
                Ok(false) => {}
                Err(()) => return Err(Failure::Refuted(choices.trace())),
            }
            if !choices.next() {
                seen.complete = !choices.abridged;
                break;
            }
        }
        let mut source = Native::Draw(Draw::new(seed));
        let drawn = if seen.complete { 0 } else { most };
        for _ in 0..drawn {
            let holds = run(self.property, &mut source);
            let Native::Draw(draw) = &mut source else { break };
            let (trace, covered) = (std::mem::take(&mut draw.trace), std::mem::take(&mut draw.covered));
            match holds {
                Ok(true) => (seen.runs, reached) = (seen.runs + 1, reached | covered),
                Ok(false) => {}
                Err(()) => return Err(Failure::Refuted(trace)),
            }
        }
        if seen.runs == 0 {
            return Err(Failure::Vacuous);
        }
        self.judge_regions(reached)?;
        Ok(seen)
    }

    fn judge_regions(&self, reached: u64) -> Result<(), Failure> {
        for &region in Region::ALL {
            match (self.covers.contains(&region), reached & region.bit() != 0) {
                (true, false) => return Err(Failure::Unreached(region)),
                (false, true) => return Err(Failure::Unlisted(region)),
                _ => {}
            }
        }
        Ok(())
    }

    /// Runs the property over the numbers of a counterexample; panics where it does not hold.
    pub fn replay(&self, numbers: Vec<u32>) -> Option<()> {
        (self.property)(&mut Native::Replay(Replay { numbers: numbers.into_iter() }))
    }
}

fn run(property: Property<Native>, choices: &mut Native) -> Result<bool, ()> {
    catch_unwind(AssertUnwindSafe(|| property(choices).is_some())).map_err(|_| ())
}

/// Words that are tried first: around 0, 2³¹ and the wrap.
const WORDS: [u32; 8] = [0, 1, 2, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFD, 0xFFFF_FFFE, 0xFFFF_FFFF];

/// Numbers that are tried besides the ends.
const NUMBERS: [i64; 11] =
    [0, 1, -1, 1 << 31, -(1 << 31), (1 << 31) - 1, 1 << 32, -(1 << 32), 0x5555_5555, (1 << 32) - 1, 3 << 30];

fn worth_trying(low: i64, high: i64) -> impl Iterator<Item = i64> {
    let ends = if low == high { vec![low] } else { vec![low, high] };
    let inner = NUMBERS.into_iter().filter(move |n| low < *n && *n < high);
    ends.into_iter().chain(inner)
}

/// Words that make a number of `low` … `high`: its distance from `low`, the upper half first where there is one.
fn words_of(value: i64, low: i64, high: i64) -> Vec<u32> {
    let (offset, range) = (value.wrapping_sub(low) as u64, high.wrapping_sub(low) as u64);
    if range >> 32 == 0 { vec![offset as u32] } else { vec![(offset >> 32) as u32, offset as u32] }
}

/// Every choice, one after the other, the last one first.
#[derive(Clone, Debug, Default)]
pub struct Enumerate {
    /// For each choice: which of how many, and the words that replay it.
    choices: Vec<(u32, u32, Vec<u32>)>,
    at: usize,
    /// Whether a choice offered only selected values.
    abridged: bool,
    /// Regions of this run.
    covered: u64,
}

impl Enumerate {
    fn next(&mut self) -> bool {
        self.at = 0;
        while let Some((which, of, _)) = self.choices.last_mut() {
            *which += 1;
            if which < of {
                return true;
            }
            self.choices.pop();
        }
        false
    }

    fn choose(&mut self, of: u32) -> usize {
        if self.at == self.choices.len() {
            self.choices.push((0, of, Vec::new()));
        }
        let (which, offered, _) = self.choices[self.at];
        assert_eq!(offered, of, "the property is not a function of its choices");
        self.at += 1;
        which as usize
    }

    fn note(&mut self, words: Vec<u32>) {
        self.choices[self.at - 1].2 = words;
    }

    fn trace(&self) -> Vec<u32> {
        self.choices[..self.at].iter().flat_map(|(_, _, words)| words.clone()).collect()
    }
}

impl Choice for Enumerate {
    fn word(&mut self) -> u32 {
        self.abridged = true;
        let value = WORDS[self.choose(WORDS.len() as u32)];
        self.note(vec![value]);
        value
    }

    fn below(&mut self, n: u32) -> u32 {
        let value = self.choose(n) as u32;
        self.note(vec![value]);
        value
    }

    fn upto(&mut self, most: u32) -> u32 {
        let mut offered: Vec<u32> =
            [0, 1, 2, most / 2, most.wrapping_sub(1), most].into_iter().filter(|n| *n <= most).collect();
        offered.sort_unstable();
        offered.dedup();
        self.abridged |= offered.len() as u64 <= u64::from(most);
        let value = offered[self.choose(offered.len() as u32)];
        self.note(vec![value]);
        value
    }

    fn between(&mut self, low: i64, high: i64) -> i64 {
        self.abridged |= high - low >= 16;
        let offered: Vec<i64> =
            if high - low < 16 { (low..=high).collect() } else { worth_trying(low, high).collect() };
        let value = offered[self.choose(offered.len() as u32)];
        self.note(words_of(value, low, high));
        value
    }

    fn assume(&mut self, holds: bool) -> Option<()> {
        holds.then_some(())
    }

    fn cover(&mut self, region: Region, reached: bool) {
        self.covered |= if reached { region.bit() } else { 0 };
    }
}

/// Drawn choices: half of them selected values, half of them any.
#[derive(Clone, Debug)]
pub struct Draw {
    state: u64,
    trace: Vec<u32>,
    /// Regions of this run, or of all since it was made.
    covered: u64,
}

impl Draw {
    /// Checks that a run with this source has been in each of these regions: a search that was not has shown less than
    /// it says.
    ///
    /// # Panics
    /// Where no run has been in one of them.
    pub fn assert_reached(&self, regions: &[Region]) {
        for region in regions {
            assert!(self.covered & region.bit() != 0, "no run reaches the region {}", region.name());
        }
    }

    /// A source that draws from `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self { state: seed ^ 0x9E37_79B9_7F4A_7C15, trace: Vec::new(), covered: 0 }
    }

    /// SplitMix64 (Steele, Lea, Flood 2014).
    fn number(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
}

impl Choice for Draw {
    fn word(&mut self) -> u32 {
        let number = self.number();
        let value = match number & 3 {
            0 => WORDS[(number >> 32) as usize % WORDS.len()],
            1 => (number >> 32) as u32 & 15,
            _ => (number >> 32) as u32,
        };
        self.trace.push(value);
        value
    }

    fn below(&mut self, n: u32) -> u32 {
        let value = (self.number() >> 32) as u32 % n;
        self.trace.push(value);
        value
    }

    fn upto(&mut self, most: u32) -> u32 {
        let number = self.number();
        let any = (number >> 32) as u32;
        let value = match number & 7 {
            0 => 0,
            1 => most,
            2 => any & 7,
            3 => most.wrapping_sub(any & 7),
            4 => any & ((1 << (number >> 8 & 31)) - 1),
            _ => any,
        };
        let value = if value <= most { value } else { ((u64::from(any) * u64::from(most)) >> 32) as u32 };
        self.trace.push(value);
        value
    }

    fn between(&mut self, low: i64, high: i64) -> i64 {
        let number = self.number();
        let value = if number & 1 == 0 {
            let offered = worth_trying(low, high).count();
            worth_trying(low, high).nth(number as usize / 2 % offered).unwrap_or(low)
        } else {
            low + (i128::from(number >> 1) % (i128::from(high) - i128::from(low) + 1)) as i64
        };
        self.trace.extend(words_of(value, low, high));
        value
    }

    fn assume(&mut self, holds: bool) -> Option<()> {
        holds.then_some(())
    }

    fn cover(&mut self, region: Region, reached: bool) {
        self.covered |= if reached { region.bit() } else { 0 };
    }
}

/// The numbers of a counterexample, in the order in which the property takes them; zeros behind them.
#[derive(Clone, Debug)]
pub struct Replay {
    numbers: std::vec::IntoIter<u32>,
}

impl Choice for Replay {
    fn word(&mut self) -> u32 {
        self.numbers.next().unwrap_or(0)
    }

    fn below(&mut self, n: u32) -> u32 {
        self.upto(n - 1)
    }

    fn upto(&mut self, most: u32) -> u32 {
        let value = self.word() & bits_of(u64::from(most)) as u32;
        assert!(value <= most, "the numbers are outside of what the property asks about");
        value
    }

    fn between(&mut self, low: i64, high: i64) -> i64 {
        let range = high.wrapping_sub(low) as u64;
        let upper = if range >> 32 == 0 { 0 } else { u64::from(self.word()) << 32 };
        let offset = (upper | u64::from(self.word())) & bits_of(range);
        assert!(offset <= range, "the numbers are outside of what the property asks about");
        low.wrapping_add(offset as i64)
    }

    fn assume(&mut self, holds: bool) -> Option<()> {
        holds.then_some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn product_is_small<C: Choice>(c: &mut C) -> Option<()> {
        let (a, b) = (c.below(7), c.between(-3, 4));
        c.assume(a > 1)?;
        assert!(i64::from(a) * b < 24);
        Some(())
    }

    fn sum_is_no_secret<C: Choice>(c: &mut C) -> Option<()> {
        let (a, b) = (c.word(), c.between(0, 1 << 40));
        assert!(i64::from(a) + b != 0x1_0000_0000);
        Some(())
    }

    fn nothing<C: Choice>(c: &mut C) -> Option<()> {
        let a = c.below(9);
        c.assume(a > 9)
    }

    #[test]
    fn a_property_that_does_not_hold_is_refuted_by_numbers_that_replay_it() {
        for harness in [
            Harness { name: "a", module: "", unwind: 1, covers: &[], property: product_is_small },
            Harness { name: "b", module: "", unwind: 1, covers: &[], property: sum_is_no_secret },
        ] {
            let Err(Failure::Refuted(numbers)) = harness.check(10_000, 1) else { panic!("not refuted") };
            assert!(catch_unwind(|| harness.replay(numbers)).is_err());
        }
    }

    #[test]
    fn a_property_that_asks_about_nothing_is_vacuous() {
        let harness = Harness { name: "c", module: "", unwind: 1, covers: &[], property: nothing };
        assert_eq!(harness.check(100, 1), Err(Failure::Vacuous));
    }

    fn any_word<C: Choice>(c: &mut C) -> Option<()> {
        let word = c.word();
        c.cover(Region::Empty, word == 0);
        c.cover(Region::Full, word == 12_345);
        c.assume(word < 12_345)
    }

    #[test]
    fn a_region_counts_where_a_run_within_the_assumptions_reaches_it() {
        let harness = |covers| Harness { name: "d", module: "", unwind: 1, covers, property: any_word };
        assert!(harness(&[Region::Empty]).check(100, 1).is_ok());
        let full = Err(Failure::Unreached(Region::Full));
        assert_eq!(harness(&[Region::Empty, Region::Full]).check(10_000, 1), full);
        assert_eq!(harness(&[]).check(100, 1), Err(Failure::Unlisted(Region::Empty)));
    }
}
