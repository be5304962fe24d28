//! Limits of a machine, and the part of them that a plan may use.
//!
//! Invariant: limits that passed [`MachineLimits::validate`] are finite and positive, and no axis at its full velocity
//! makes more pulses in a control period than a record holds.

use crate::error::LimitError;

/// Highest feed override as a factor: 200 %.
pub const MAX_OVERRIDE: f64 = 2.0;

/// Limits of a machine with `A` axes. An axis unit is a millimetre, or a degree for a rotary axis.
///
/// [`MachineLimits::validate`] checks the ranges given below.
///
/// # Examples
///
/// ```
/// use retrace_motion::{LimitError, MachineLimits};
/// let limits = MachineLimits::<3> { period_s: 0.002, ..MachineLimits::built_in() };
/// assert_eq!(limits.validate(), Ok(()));
/// let limits = MachineLimits::<3> { reserve: 0.95, ..limits };
/// assert_eq!(limits.validate(), Err(LimitError::Reserve { value: 0.95 }));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MachineLimits<const A: usize> {
    /// Highest velocity of each axis, axis units/s; above 0, and at most 32 766 pulses in a control period.
    pub velocity_mm_s: [f64; A],
    /// Highest acceleration of each axis, axis units/s²; above 0.
    pub acceleration_mm_s2: [f64; A],
    /// Highest jerk of each axis, axis units/s³; above 0.
    pub jerk_mm_s3: [f64; A],
    /// Pulses per axis unit; above 0.
    pub pulses_per_mm: [f64; A],
    /// Highest speed along the path, mm/s, above 0. Rapid moves have this speed too.
    pub path_velocity_mm_s: f64,
    /// Share of the acceleration and jerk of each axis that the plan leaves to the rate law (REV, *Rate law*), 0 … 0.9.
    pub reserve: f64,
    /// Control period *T*, s; above 0, at most 1.
    pub period_s: f64,
    /// Whether each record has its speed as a share of the programmed feed, which the power of a beam follows (CUT-20).
    pub feed_shares: bool,
}

impl<const A: usize> MachineLimits<A> {
    /// Limits of the built-in machine, the reference for every published figure.
    #[must_use]
    pub const fn built_in() -> Self {
        Self {
            velocity_mm_s: [100.0; A],
            acceleration_mm_s2: [1000.0; A],
            jerk_mm_s3: [20_000.0; A],
            pulses_per_mm: [1000.0; A],
            path_velocity_mm_s: 100.0,
            reserve: 0.10,
            period_s: 0.001,
            feed_shares: false,
        }
    }

    /// Share α of acceleration and jerk that the plan may use: 1 − `reserve`, 0.1 … 1.
    #[must_use]
    pub fn alpha(&self) -> f64 {
        1.0 - self.reserve
    }

    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// [`LimitError`] names the first number that is out of its range, and its axis.
    pub fn validate(&self) -> Result<(), LimitError> {
        let positive = |x: f64| x.is_finite() && x > 0.0;
        for axis in 0..A {
            for (quantity, value) in [
                ("velocity", self.velocity_mm_s[axis]),
                ("acceleration", self.acceleration_mm_s2[axis]),
                ("jerk", self.jerk_mm_s3[axis]),
                ("pulses per mm", self.pulses_per_mm[axis]),
            ] {
                if !positive(value) {
                    return Err(LimitError::NotPositive { axis, quantity, value });
                }
            }
            let pulses = self.velocity_mm_s[axis] * self.period_s * self.pulses_per_mm[axis];
            if pulses > f64::from(i16::MAX - 1) {
                return Err(LimitError::TooManyPulses { axis, pulses });
            }
        }
        if !positive(self.path_velocity_mm_s) {
            return Err(LimitError::PathVelocity { value: self.path_velocity_mm_s });
        }
        if !(0.0..=0.9).contains(&self.reserve) {
            return Err(LimitError::Reserve { value: self.reserve });
        }
        if !positive(self.period_s) || self.period_s > 1.0 {
            return Err(LimitError::Period { value: self.period_s });
        }
        Ok(())
    }

    /// Limits that the plan itself observes.
    pub(crate) fn planned(&self) -> AxisLimits<A> {
        AxisLimits {
            v: self.velocity_mm_s,
            a: self.acceleration_mm_s2.map(|a| a * self.alpha()),
            j: self.jerk_mm_s3.map(|j| j * self.alpha()),
            path_v: self.path_velocity_mm_s,
            period: self.period_s,
        }
    }
}

/// Limits that the plan may use: mm/s, mm/s² and mm/s³ for each axis, mm/s along the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct AxisLimits<const A: usize> {
    pub(crate) v: [f64; A],
    pub(crate) a: [f64; A],
    pub(crate) j: [f64; A],
    pub(crate) path_v: f64,
    /// Control period, s.
    pub(crate) period: f64,
}

impl<const A: usize> AxisLimits<A> {
    /// Velocity, acceleration and jerk of axis `i` as bits, for an order of axes.
    pub(crate) fn limits_of(&self, i: usize) -> [u64; 3] {
        [self.v[i], self.a[i], self.j[i]].map(f64::to_bits)
    }

    /// These limits with those of each axis replaced.
    pub(crate) fn with(&self, limits: impl Fn(usize) -> [u64; 3]) -> Self {
        let part = |k: usize| std::array::from_fn(|i| f64::from_bits(limits(i)[k]));
        Self { v: part(0), a: part(1), j: part(2), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_machine_is_valid_and_every_number_is_looked_at() {
        let good = MachineLimits::<3>::built_in();
        assert_eq!(good.validate(), Ok(()));
        let refused = |change: fn(&mut MachineLimits<3>)| {
            let mut bad = good;
            change(&mut bad);
            bad.validate().unwrap_err().number()
        };
        assert_eq!(refused(|l| l.velocity_mm_s[1] = f64::NAN), "E4101");
        assert_eq!(refused(|l| l.acceleration_mm_s2[2] = 0.0), "E4101");
        assert_eq!(refused(|l| l.jerk_mm_s3[0] = -1.0), "E4101");
        assert_eq!(refused(|l| l.pulses_per_mm[0] = f64::INFINITY), "E4101");
        assert_eq!(refused(|l| l.pulses_per_mm[0] = 400_000.0), "E4102");
        assert_eq!(refused(|l| l.path_velocity_mm_s = 0.0), "E4103");
        assert_eq!(refused(|l| l.reserve = 0.95), "E4104");
        assert_eq!(refused(|l| l.period_s = 0.0), "E4105");
    }
}
