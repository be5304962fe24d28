//! Rate and distance along the recorded path.
//!
//! Invariant: both are fixed-point numbers with 32 fractional bits. A rate becomes a distance only by a number of
//! control
//! periods ([`Rate::over`], [`Distance::per_period`]).

use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

macro_rules! fixed_point {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(i64);

        impl $name {
            /// Zero.
            pub const ZERO: Self = Self(0);

            /// Returns the quantity of `units` · 2⁻³².
            #[must_use]
            pub const fn from_units(units: i64) -> Self {
                Self(units)
            }

            /// Returns the quantity in units of 2⁻³².
            #[must_use]
            pub const fn units(self) -> i64 {
                self.0
            }

            /// Returns the magnitude.
            #[must_use]
            pub const fn abs(self) -> Self {
                Self(self.0.abs())
            }

            /// Returns the direction: 1 forward, −1 backward, 0 for zero.
            #[must_use]
            pub const fn signum(self) -> i64 {
                self.0.signum()
            }
        }

        impl Add for $name {
            type Output = Self;
            fn add(self, other: Self) -> Self {
                Self(self.0 + other.0)
            }
        }

        impl AddAssign for $name {
            fn add_assign(&mut self, other: Self) {
                self.0 += other.0;
            }
        }

        impl Sub for $name {
            type Output = Self;
            fn sub(self, other: Self) -> Self {
                Self(self.0 - other.0)
            }
        }

        impl SubAssign for $name {
            fn sub_assign(&mut self, other: Self) {
                self.0 -= other.0;
            }
        }

        impl Neg for $name {
            type Output = Self;
            fn neg(self) -> Self {
                Self(-self.0)
            }
        }

        impl Mul<i64> for $name {
            type Output = Self;
            fn mul(self, factor: i64) -> Self {
                Self(self.0 * factor)
            }
        }

        /// Rounds toward zero.
        impl Div<i64> for $name {
            type Output = Self;
            fn div(self, divisor: i64) -> Self {
                Self(self.0 / divisor)
            }
        }
    };
}

fixed_point! {
    /// Rate along the recorded path, in records per control period: 1 as recorded, 0 at rest, −1 backward.
    ///
    /// Also the change of a rate per period.
    Rate
}

fixed_point! {
    /// Signed distance along the recorded path, in records.
    Distance
}

impl Rate {
    /// The rate as recorded: one record per control period.
    pub const ONE: Self = Self(1 << 32);
    /// Maximum rate, in either direction: eight records per control period.
    pub const MAX: Self = Self(8 << 32);

    /// Returns the rate of so many hundredths, rounded to a unit.
    #[must_use]
    pub const fn percent(percent: i64) -> Self {
        Self((percent * Self::ONE.0 + 50).div_euclid(100))
    }

    /// Returns the distance that this rate covers in `periods` control periods.
    #[must_use]
    pub const fn over(self, periods: i64) -> Distance {
        Distance(self.0 * periods)
    }
}

/// For displays; nothing in this crate calculates in floating point.
impl From<Rate> for f64 {
    fn from(rate: Rate) -> Self {
        rate.0 as Self / Rate::ONE.0 as Self
    }
}

impl Distance {
    /// One whole record.
    pub const RECORD: Self = Self(1 << 32);

    /// Returns the distance of `count` whole records; |count| must be below 2³¹.
    #[must_use]
    pub const fn records(count: i64) -> Self {
        Self(count << 32)
    }

    /// Returns the rate that covers this distance in one control period.
    #[must_use]
    pub const fn per_period(self) -> Rate {
        Rate(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_covers_a_distance_in_a_period() {
        assert_eq!(Rate::ONE.over(1), Distance::RECORD);
        assert_eq!((-Rate::ONE / 2).over(3), -(Distance::records(3) / 2));
        assert_eq!(Distance::records(-2).per_period(), Rate::ONE * -2);
        assert_eq!((Rate::from_units(-7) / 2).units(), -3);
        assert_eq!(f64::from(Rate::ONE / -4), -0.25);
        assert_eq!((Rate::percent(100), Rate::percent(-50)), (Rate::ONE, -Rate::ONE / 2));
    }
}
