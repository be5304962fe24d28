//! Limits of the machine for the rate law: its axes, in pulses and control periods (REV, *Rate law*).
//!
//! Invariant: limits that passed [`RateLimits::new`] keep every product of the law within 64 bits, and their average is
//! long enough for `|r″| ≤ 2A/(n·|q′|) ≤ 2J/|q′|` on every axis.

/// Limits of one axis. All three are in units of 2⁻³², rounded down, [`PulseLimits::MIN`] to [`PulseLimits::MAX`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PulseLimits {
    /// Maximum velocity, in pulses per control period.
    pub velocity: u64,
    /// Maximum acceleration, in pulses per period².
    pub acceleration: u64,
    /// Maximum jerk, in pulses per period³.
    pub jerk: u64,
}

impl PulseLimits {
    /// Minimum of each limit: 2⁻²⁴ pulses. Below it the rounding of the units would show.
    pub const MIN: u64 = 1 << 8;
    /// Maximum of each limit: 65 536 pulses. A faster machine uses this value; the law is then as slow as this value
    /// requires.
    pub const MAX: u64 = 1 << 48;
}

/// Everything that the rate law needs to know about a machine with `A` axes. Plain numbers, so that they can be sent to
/// a card.
///
/// # Examples
///
/// ```
/// use retrace_core::limits::{PulseLimits, RateLimits};
///
/// // 100 pulses per period, 1 per period², 1/50 per period³
/// let axis = PulseLimits { velocity: 100 << 32, acceleration: 1 << 32, jerk: (1 << 32) / 50 };
/// assert!(RateLimits::new(51, 58_982, [axis]).is_some());
/// assert!(RateLimits::new(49, 58_982, [axis]).is_none(), "too short an average for this jerk");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct RateLimits<const A: usize> {
    average: u16,
    share: u16,
    axes: [PulseLimits; A],
}

impl<const A: usize> RateLimits<A> {
    /// Maximum length of the average, in periods.
    pub const MAX_AVERAGE: u16 = 4095;

    /// Checks and returns limits: the length n of the cursor's average in periods; the share α of acceleration and jerk
    /// that the plan uses, in units of 2⁻¹⁶; the axes.
    ///
    /// Returns `None` if n is even (a steady rate then has a lead of half a unit), zero or above
    /// [`RateLimits::MAX_AVERAGE`], α is zero, a limit is out of range, or the acceleration of an axis is above n times
    /// its jerk.
    #[must_use]
    pub fn new(average: u16, share: u16, axes: [PulseLimits; A]) -> Option<Self> {
        let within = |figure| (PulseLimits::MIN..=PulseLimits::MAX).contains(&figure);
        let fits = |axis: &PulseLimits| {
            let each = within(axis.velocity) && within(axis.acceleration) && within(axis.jerk);
            each && axis.acceleration <= axis.jerk * u64::from(average)
        };
        let valid = !average.is_multiple_of(2) && average <= Self::MAX_AVERAGE && share > 0 && axes.iter().all(fits);
        valid.then_some(Self { average, share, axes })
    }

    /// Returns the limits of a card that has received no settings yet: any slope is allowed, and nothing may be played
    /// with them.
    #[must_use]
    pub const fn unconfigured() -> Self {
        let axis = PulseLimits { velocity: PulseLimits::MIN, acceleration: PulseLimits::MAX, jerk: PulseLimits::MAX };
        Self { average: 1, share: 1, axes: [axis; A] }
    }

    /// Returns the length n of the cursor's average, in periods; odd.
    #[must_use]
    pub const fn average(&self) -> u16 {
        self.average
    }

    /// Returns the share α of acceleration and jerk that the plan uses, in units of 2⁻¹⁶.
    #[must_use]
    pub const fn share(&self) -> u16 {
        self.share
    }

    /// Returns the largest second difference that the plan requires of an axis.
    pub(crate) fn plan_acceleration(&self, axis: &PulseLimits) -> u64 {
        self.planned_share(axis.acceleration).min(2 * axis.velocity)
    }

    /// Returns the largest third difference that the plan requires of an axis.
    pub(crate) fn plan_jerk(&self, axis: &PulseLimits) -> u64 {
        self.planned_share(axis.jerk).min(4 * axis.velocity)
    }

    /// Returns the share of a limit that the plan uses, rounded up; a limit has at most 49 bits.
    fn planned_share(&self, limit: u64) -> u64 {
        let share = u64::from(self.share);
        (limit >> 16) * share + (((limit & 0xFFFF) * share) >> 16) + 1
    }

    /// Returns the limits of the axes, in the order of a record's increments.
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
        // an even average, zero, too long, too short for the jerk
        for average in [52, 0, 4097, 49] {
            assert_eq!(of(average, 58_982, AXIS), None);
        }
        assert_eq!(of(51, 0, AXIS), None);
        assert_eq!(of(51, 58_982, PulseLimits { velocity: 255, ..AXIS }), None);
        assert_eq!(of(51, 58_982, PulseLimits { acceleration: (1 << 48) + 1, jerk: 1 << 48, ..AXIS }), None);
    }

    /// What the plan may use is above the exact share of a limit, by at most a unit.
    #[test]
    fn a_planned_share_is_rounded_up() {
        for share in [1, 32_768, 58_982, u16::MAX] {
            let limits = RateLimits::<1>::new(51, share, [AXIS]).expect("valid");
            for limit in [0, 1, 0xFFFF, 0x1_0000, 0xFFFF_FFFF, (3 << 32) + 0xABCD, 1 << 48, (1 << 49) - 1] {
                let exact = u128::from(limit) * u128::from(share);
                let planned = u128::from(limits.planned_share(limit)) << 16;
                assert!(exact < planned && planned <= exact + (1 << 16), "{share} of {limit}: {planned} {exact}");
            }
        }
    }
}
