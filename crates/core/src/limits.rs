//! What the rate law is told of the machine: its axes in pulses and control periods (REV, *Rate law*).
//!
//! Invariant: limits that passed [`RateLimits::new`] keep every product of the law within 64 bits, and their average is long enough for
//! `|r″| ≤ 2A/(n·|q′|) ≤ 2J/|q′|` on every axis.

/// What one axis can do. All three in units of 2⁻³², rounded down, [`AxisLimits::LEAST`] to [`AxisLimits::MOST`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PulseLimits {
    /// Highest velocity, in pulses a control period.
    pub velocity: u64,
    /// Highest acceleration, in pulses a period².
    pub acceleration: u64,
    /// Highest jerk, in pulses a period³.
    pub jerk: u64,
}

impl PulseLimits {
    /// Lowest figure that is taken: 2⁻²⁴ pulses. Below it the units' own rounding would show.
    pub const LEAST: u64 = 1 << 8;
    /// Highest figure that is taken: 65 536 pulses. Whoever has more says this much; the law is as slow as is true for that.
    pub const MOST: u64 = 1 << 48;
}

/// Everything that the rate law needs to know of a machine with `A` axes. Plain numbers, so that a card can be told them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RateLimits<const A: usize> {
    average: u16,
    share: u16,
    axes: [PulseLimits; A],
}

impl<const A: usize> RateLimits<A> {
    /// The longest average there is, in periods.
    pub const LONGEST: u16 = 4095;

    /// Checked limits: the length n of the cursor's average in periods; the share α of acceleration and jerk that the plan uses, in
    /// 2⁻¹⁶; the axes. `None` where n is even (a steady rate then has a lead of half a unit), zero or above
    /// [`RateLimits::LONGEST`], α is zero, a figure is out of range, or an axis' acceleration is above n times its jerk.
    #[must_use]
    pub fn new(average: u16, share: u16, axes: [PulseLimits; A]) -> Option<Self> {
        let within = |figure| (PulseLimits::LEAST..=PulseLimits::MOST).contains(&figure);
        let fits = |axis: &PulseLimits| {
            let each = within(axis.velocity) && within(axis.acceleration) && within(axis.jerk);
            each && axis.acceleration <= axis.jerk * u64::from(average)
        };
        let valid = !average.is_multiple_of(2) && average <= Self::LONGEST && share > 0 && axes.iter().all(fits);
        valid.then_some(Self { average, share, axes })
    }

    /// Those of a machine that nobody has told of yet: any slope will do, and nothing may be played by them.
    #[must_use]
    pub const fn unknown() -> Self {
        let axis =
            PulseLimits { velocity: PulseLimits::LEAST, acceleration: PulseLimits::MOST, jerk: PulseLimits::MOST };
        Self { average: 1, share: 1, axes: [axis; A] }
    }

    /// Length n of the cursor's average, in periods; odd.
    #[must_use]
    pub const fn average(&self) -> u16 {
        self.average
    }

    /// Share α of acceleration and jerk that the plan uses, in 2⁻¹⁶.
    #[must_use]
    pub const fn share(&self) -> u16 {
        self.share
    }

    /// The axes, in the order of a record's increments.
    #[must_use]
    pub const fn axes(&self) -> &[PulseLimits; A] {
        &self.axes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AXIS: PulseLimits = PulseLimits { velocity: 100 << 32, acceleration: 1 << 32, jerk: (1 << 32) / 50 };

    #[test]
    fn limits_that_the_law_cannot_keep_are_refused() {
        let of = |average, share, axis| RateLimits::<1>::new(average, share, [axis]);
        assert!(of(51, 58_982, AXIS).is_some());
        // an even average, none, too long, too short for the jerk
        for average in [52, 0, 4097, 49] {
            assert_eq!(of(average, 58_982, AXIS), None);
        }
        assert_eq!(of(51, 0, AXIS), None);
        assert_eq!(of(51, 58_982, PulseLimits { velocity: 255, ..AXIS }), None);
        assert_eq!(of(51, 58_982, PulseLimits { acceleration: (1 << 48) + 1, jerk: 1 << 48, ..AXIS }), None);
    }
}
