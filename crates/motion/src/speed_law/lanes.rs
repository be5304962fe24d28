//! Two numbers that are calculated with together: those at the start and at the end of a part.
//!
//! Invariant: every operation acts on each lane by itself.

use std::ops::{Add, AddAssign, Mul, Sub};

/// Two lanes; compilers make one instruction of an operation on both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Lanes(pub(super) [f64; 2]);

impl Lanes {
    #[inline(always)]
    pub(super) const fn both(x: f64) -> Self {
        Self([x, x])
    }

    #[inline(always)]
    pub(super) fn recip(self) -> Self {
        Self([1.0 / self.0[0], 1.0 / self.0[1]])
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Self([self.0[0].sqrt(), self.0[1].sqrt()])
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        Self([self.0[0].abs(), self.0[1].abs()])
    }

    /// Sum of both lanes.
    #[inline(always)]
    pub(super) fn sum(self) -> f64 {
        self.0[0] + self.0[1]
    }

    /// Larger of both lanes.
    #[inline(always)]
    pub(super) fn largest(self) -> f64 {
        if self.0[0] > self.0[1] { self.0[0] } else { self.0[1] }
    }
}

impl Add for Lanes {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
    }
}

impl Sub for Lanes {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self([self.0[0] - other.0[0], self.0[1] - other.0[1]])
    }
}

impl Mul for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self([self.0[0] * other.0[0], self.0[1] * other.0[1]])
    }
}

impl Mul<f64> for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self * Self::both(factor)
    }
}

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// Sum of three products with numbers.
#[inline(always)]
pub(super) fn dot(a: &[Lanes; 3], c: &[f64; 3]) -> Lanes {
    a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
}
