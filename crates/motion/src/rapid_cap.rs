//! The rapid-retrace cap of a record: how much faster than planned it may be retraced (REV, *Rate law*).
//!
//! Invariant: at its cap r, bounds of r·|v|, r²·|a| and r³·|j| of every axis in the record are within what the plan may
//! use. A cap may be lower than it could be, never higher.

use retrace_core::RapidCap;

use crate::curve::Derivatives;

/// Largest shares of the axis limits that motion along a piece uses: for each kind of motion along the path the largest
/// share of any axis. Where it is not the same axis for all of them, this is slightly too much.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SpeedCap {
    /// By speed, of the velocity; by acceleration, of the acceleration; by jerk, of the jerk.
    direct: [f64; 3],
    /// By v², of the acceleration; by v·a, of the jerk.
    bent: [f64; 2],
    /// By v³, of the jerk.
    twisted: f64,
}

/// Shares of velocity, acceleration and jerk.
pub(crate) type Shares = [f64; 3];

impl SpeedCap {
    pub(crate) const NONE: Self = Self { direct: [0.0; 3], bent: [0.0; 2], twisted: 0.0 };

    /// Demand of a piece with these `bounds`; `per_most` are the reciprocals of the axis limits.
    pub(crate) fn of<const A: usize>(bounds: &Derivatives<A>, per_most: &Derivatives<A>) -> Self {
        let mut all = Self::NONE;
        for i in 0..A {
            let (first, second, third) = (bounds.first[i], bounds.second[i], bounds.third[i]);
            let (per_v, per_a, per_j) = (per_most.first[i], per_most.second[i], per_most.third[i]);
            let own = Self {
                direct: [first * per_v, first * per_a, first * per_j],
                bent: [second * per_a, 3.0 * second * per_j],
                twisted: third * per_j,
            };
            all.raise(&own);
        }
        all
    }

    /// Raises each share to that of `other`.
    #[inline]
    pub(crate) fn raise(&mut self, other: &Self) {
        for (all, own) in self.direct.iter_mut().zip(other.direct) {
            *all = larger(*all, own);
        }
        for (all, own) in self.bent.iter_mut().zip(other.bent) {
            *all = larger(*all, own);
        }
        self.twisted = larger(self.twisted, other.twisted);
    }

    /// Shares that motion along the path uses at this speed, acceleration and jerk, none negative.
    #[inline]
    pub(crate) fn shares(&self, v: f64, a: f64, j: f64) -> Shares {
        let ([by_v, by_a, by_j], [by_vv, by_va]) = (self.direct, self.bent);
        [by_v * v, by_a * a + by_vv * v * v, by_j * j + v * (by_va * a + self.twisted * v * v)]
    }
}

/// Largest shares of any axis by its own motion.
#[inline]
pub(crate) fn shares_of<const A: usize>(by_time: &Derivatives<A>, per_most: &Derivatives<A>) -> Shares {
    let mut all = [0.0; 3];
    for i in 0..A {
        all = larger_of(
            all,
            [
                by_time.first[i].abs() * per_most.first[i],
                by_time.second[i].abs() * per_most.second[i],
                by_time.third[i].abs() * per_most.third[i],
            ],
        );
    }
    all
}

/// The larger of two numbers. One instruction, unlike `f64::max`, which checks for NaN.
#[inline]
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// The larger share of each kind.
#[inline]
pub(crate) fn larger_of(a: Shares, b: Shares) -> Shares {
    std::array::from_fn(|k| larger(a[k], b[k]))
}

/// Largest cap for a record that uses these shares; `near` is a guess, best the cap of the record before.
#[inline]
pub(crate) fn cap(shares: Shares, near: RapidCap) -> RapidCap {
    let n = near.get();
    if !allows(shares, RapidCap::PLANNED.get() + 1) {
        return RapidCap::PLANNED;
    }
    if allows(shares, n) && (n == RapidCap::MAX.get() || !allows(shares, n + 1)) {
        return near;
    }
    search(shares)
}

/// Largest cap, above that of a record as planned.
fn search(shares: Shares) -> RapidCap {
    let (mut low, mut high) = (RapidCap::PLANNED.get() + 1, RapidCap::MAX.get() + 1);
    while high - low > 1 {
        let middle = low.midpoint(high);
        if allows(shares, middle) { low = middle } else { high = middle }
    }
    RapidCap::sixteenths(low)
}

/// Whether `shares` permit retracing at `n` sixteenths.
#[inline]
fn allows([v, a, j]: Shares, n: u8) -> bool {
    // A little more, for rounding.
    let rate = (1.0 + 1e-9) / 16.0 * f64::from(n);
    let squared = rate * rate;
    v * rate <= 1.0 && a * squared <= 1.0 && j * squared * rate <= 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The cap is the largest that all shares allow, for any guess.
        #[test]
        fn a_cap_is_the_largest_that_is_allowed(sizes in [-4.0..0.1f64, -7.0..0.1f64, -10.0..0.1f64],
            near in 0u8..=255) {
            let shares = sizes.map(|x| 10f64.powf(x));
            let rate = shares[0].recip().min(shares[1].recip().sqrt()).min(shares[2].recip().cbrt());
            let found = f64::from(cap(shares, RapidCap::sixteenths(near)).get()) / 16.0;
            prop_assert!(found <= rate || found == 1.0);
            prop_assert!(found == 8.0 || found + 1.0 / 16.0 > rate * (1.0 - 1e-8), "{} of {}", found, rate);
        }

        /// The demand of a piece bounds the shares of each of its axes alone.
        #[test]
        fn a_demand_bounds_every_axis(
            bounds in [[0.0..2.0f64, 0.0..2.0f64, 0.0..2.0f64], [0.0..2.0f64, 0.0..2.0f64, 0.0..2.0f64],
                       [0.0..2.0f64, 0.0..2.0f64, 0.0..2.0f64]],
            motion in [0.0..9.0f64, 0.0..9.0f64, 0.0..9.0f64],
        ) {
            let [first, second, third] = bounds;
            let ([v, a, j], bounds) = (motion, Derivatives { first, second, third });
            let per_most = Derivatives { first: [0.1, 0.2, 0.3], second: [0.01, 0.05, 0.02],
                third: [1e-3, 3e-3, 2e-3] };
            let all = SpeedCap::of(&bounds, &per_most).shares(v, a, j);
            for i in 0..3 {
                let own = Derivatives {
                    first: [first[i] * v],
                    second: [first[i] * a + second[i] * v * v],
                    third: [first[i] * j + 3.0 * second[i] * v * a + third[i] * v * v * v],
                };
                let per = Derivatives { first: [per_most.first[i]], second: [per_most.second[i]],
                    third: [per_most.third[i]] };
                for (own, all) in shares_of(&own, &per).into_iter().zip(all) {
                    prop_assert!(own <= all * (1.0 + 1e-12));
                }
            }
        }
    }
}
