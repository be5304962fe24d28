//! The handwheel: count differences become a rate (REV-11, REV-12).
//!
//! Invariant: the rate is the mean of the count differences of the last periods, saturated at ±1; a wheel at rest for as many
//! periods gives a rate of exactly zero.

use crate::{ONE, Travel};

/// A moving mean of count differences over at most `M` periods.
#[derive(Clone, Debug)]
pub struct Wheel<const M: usize> {
    differences: [i16; M],
    at: usize,
    length: usize,
    sum: i32,
    counts_at_one: i32,
}

impl<const M: usize> Wheel<M> {
    /// `periods`: length of the mean, 1 … M; `counts_at_one`: counts in that time that make a rate of one, at least 1. Values
    /// out of range are brought into it.
    #[must_use]
    pub fn new(periods: u16, counts_at_one: u16) -> Self {
        let length = (periods as usize).clamp(1, M);
        Self { differences: [0; M], at: 0, length, sum: 0, counts_at_one: i32::from(counts_at_one.max(1)) }
    }

    /// One control period in which the wheel turned by `difference` counts.
    pub fn turn(&mut self, difference: i16) {
        self.sum += i32::from(difference) - i32::from(self.differences[self.at]);
        self.differences[self.at] = difference;
        self.at = if self.at + 1 == self.length { 0 } else { self.at + 1 };
    }

    /// The rate that the wheel asks for, −1 … 1.
    #[must_use]
    pub fn rate(&self) -> Travel {
        let sum = self.sum.clamp(-self.counts_at_one, self.counts_at_one);
        Travel::from(sum) * ONE / Travel::from(self.counts_at_one)
    }

    /// Forgets all counts.
    pub fn reset(&mut self) {
        self.differences = [0; M];
        self.sum = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn is_the_saturated_mean_and_rests_when_the_wheel_does(
            periods in 1u16..32, one in 1u16..50, turns in prop::collection::vec(-20i16..20, 1..100),
        ) {
            let mut wheel = Wheel::<32>::new(periods, one);
            let n = usize::from(periods);
            for k in 0..turns.len() {
                wheel.turn(turns[k]);
                let sum: i64 = turns[(k + 1).saturating_sub(n)..=k].iter().map(|&t| i64::from(t)).sum();
                let sum = sum.clamp(-i64::from(one), i64::from(one));
                prop_assert_eq!(wheel.rate(), sum * ONE / i64::from(one));
            }
            for _ in 0..n { wheel.turn(0); }
            prop_assert_eq!(wheel.rate(), 0);
        }
    }
}
