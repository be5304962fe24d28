//! The handwheel: converts count differences to a rate (REV-11, REV-12).
//!
//! Invariant: the rate is the mean of the count differences of the last periods, saturated at ±1. After a wheel has
//! been at rest for that many periods, the rate is exactly zero.

use crate::Rate;

/// Moving mean of count differences over at most `M` periods.
///
/// # Examples
///
/// ```
/// use retrace_core::Rate;
/// use retrace_core::wheel::Wheel;
///
/// // the mean of four periods; 20 counts in that time are rate one
/// let mut wheel = Wheel::<8>::new(4, 20);
/// wheel.push_difference(-5);
/// assert_eq!(wheel.rate(), -Rate::ONE / 4);
/// (0..4).for_each(|_| wheel.push_difference(0));
/// assert_eq!(wheel.rate(), Rate::ZERO);
/// ```
#[derive(Clone, Debug)]
pub struct Wheel<const M: usize> {
    differences: [i16; M],
    at: usize,
    length: usize,
    sum: i32,
    counts_at_one: i32,
}

impl<const M: usize> Wheel<M> {
    /// Creates a wheel at rest. `periods` is the length of the mean, 1 … M; `counts_at_one` is the number of counts in
    /// that time that gives a rate of one, at least 1. Values out of range are clamped.
    #[must_use]
    pub fn new(periods: u16, counts_at_one: u16) -> Self {
        let length = (periods as usize).clamp(1, M);
        Self { differences: [0; M], at: 0, length, sum: 0, counts_at_one: i32::from(counts_at_one.max(1)) }
    }

    /// Adds one control period in which the wheel turned by `difference` counts.
    pub fn push_difference(&mut self, difference: i16) {
        self.sum += i32::from(difference) - i32::from(self.differences[self.at]);
        self.differences[self.at] = difference;
        self.at = if self.at + 1 == self.length { 0 } else { self.at + 1 };
    }

    /// Returns the rate that the wheel commands, −1 … 1.
    #[must_use]
    pub fn rate(&self) -> Rate {
        let sum = self.sum.clamp(-self.counts_at_one, self.counts_at_one);
        Rate::ONE * i64::from(sum) / i64::from(self.counts_at_one)
    }

    /// Clears all counts.
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
                wheel.push_difference(turns[k]);
                let sum: i64 = turns[(k + 1).saturating_sub(n)..=k].iter().map(|&t| i64::from(t)).sum();
                let sum = sum.clamp(-i64::from(one), i64::from(one));
                prop_assert_eq!(wheel.rate(), Rate::ONE * sum / i64::from(one));
            }
            // a reset wheel is a new one, whatever it has counted
            let mut reset = wheel.clone();
            reset.reset();
            let mut new = Wheel::<32>::new(periods, one);
            prop_assert_eq!(reset.rate(), Rate::ZERO);
            for &turn in &turns {
                reset.push_difference(turn);
                new.push_difference(turn);
                prop_assert_eq!(reset.rate(), new.rate());
            }
            for _ in 0..n { wheel.push_difference(0); }
            prop_assert_eq!(wheel.rate(), Rate::ZERO);
        }
    }
}
