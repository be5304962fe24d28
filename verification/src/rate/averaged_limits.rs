//! What an axis requires of the commanded rate holds of its average.
//!
//! Invariant: the commanded rates are any that the inequality of the axis allows; nothing here asks the drive for them.

#[cfg(not(any(kani, verify_wasm)))]
use super::RATE;
use crate::choice::Choice;
use crate::harness::{built, cover, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row};
use retrace_core::Rate;
use retrace_core::rate::{FilterLengths, RateFilter};

/// For every commanded rate u and its change u′ in `|q″|u² + |q′||u′| ≤ A`, u being the faster rate of the two periods,
/// the rate r of the cursor and its change are within the same inequality: from any memory, for any figures of the
/// axis.
///
/// Rate one is `top` units commanded, and `N` times that where it is averaged, so that no mean is rounded.
pub(super) fn an_average_keeps_the_acceleration<const N: usize>(c: &mut impl Choice, top: i64) -> Option<()> {
    let mut law = built!(RateFilter::<N>::new(built!(FilterLengths::new(1, N as u16))));
    let (speed, bend, most) = (c.between(0, 7), c.between(0, 7), c.between(0, 15));
    // in units of 1/`one` of the rate
    let used = |from: i64, to: i64, one: i64| {
        let (faster, change) = if from < to { (to, to - from) } else { (from, from - to) };
        bend * faster * faster + speed * change * one
    };
    let mut last = c.between(0, top);
    let mut moved = law.step(Rate::from_units(N as i64 * last)).units();
    let (mut before, mut k) = (0, 0);
    while k < N {
        let next = c.between(0, top);
        c.assume(used(last, next, top) <= most * top * top)?;
        (before, moved) = (moved, law.step(Rate::from_units(N as i64 * next)).units());
        (last, k) = (next, k + 1);
    }
    let whole = N as i64 * top;
    cover!(c, Rising, before < moved && bend > 0);
    cover!(c, Falling, moved < before && bend > 0);
    cover!(c, Limited, before != moved && bend > 0 && used(before, moved, whole) == most * whole * whole);
    holds!(used(before, moved, whole) <= most * whole * whole);
    Some(())
}

/// For commanded rates u whose change is within `|q‴|h³ + (3|q″|h + 2|q′|/n)|u′| ≤ 2J`, h being the fastest rate in the
/// memory where the rate falls, and one where it rises: the rate r of the cursor is within `|q‴|r³ + 3|q″||r·r′| +
/// |q′||r″| ≤ 2J` in any three periods, r being that of the second, and r′ the larger change.
pub(super) fn an_average_keeps_the_jerk<const N: usize, const ALL: usize>(c: &mut impl Choice, top: i64) -> Option<()> {
    let n = N as i64;
    let mut law = built!(RateFilter::<N>::new(built!(FilterLengths::new(1, N as u16))));
    let (speed, bend, twist, most) = (c.between(0, 7), c.between(0, 3), c.between(0, 3), c.between(0, 15));
    c.assume(twist <= most)?;
    let mut rates = [0; ALL];
    let mut moved = [0; 3];
    let mut k = 0;
    while k < ALL {
        rates[k] = c.between(0, top);
        if k > 0 {
            let (from, to) = (rates[k - 1], rates[k]);
            let (mut highest, mut back) = (from, 2);
            while back <= N && back <= k {
                highest = if rates[k - back] > highest { rates[k - back] } else { highest };
                back += 1;
            }
            let (fastest, change) = if from < to { (top, to - from) } else { (highest, from - to) };
            let used = n * twist * fastest * fastest * fastest
                + change * (3 * n * bend * fastest * top + 2 * speed * top * top);
            c.assume(change == 0 || used <= n * most * top * top * top)?;
        }
        moved = [moved[1], moved[2], law.step(Rate::from_units(n * rates[k])).units()];
        k += 1;
    }
    let whole = n * top;
    let (before, after) = (moved[1] - moved[0], moved[2] - moved[1]);
    let change = if before.abs() > after.abs() { before.abs() } else { after.abs() };
    let rate = moved[1];
    let used =
        twist * rate * rate * rate + 3 * bend * rate * change * whole + speed * (after - before).abs() * whole * whole;
    cover!(c, Rising, before > 0 && bend > 0);
    cover!(c, Falling, before < 0 && bend > 0);
    holds!(used <= most * whole * whole * whole);
    Some(())
}

/// The row of the averages.
#[cfg(not(any(kani, verify_wasm)))]
pub(super) const ROW: Row = Row {
    name: "rate-limits",
    says: "What an axis allows of the commanded rate u holds of the rate r of the cursor, which is its average: \
        where every change u′ is within |q″|u² + |q′||u′| ≤ A, so are r and r′; where every change that is not zero \
        is within |q‴|h³ + (3|q″|h + 2|q′|/n)|u′| ≤ 2J, with h the fastest rate in the memory, or one where the rate \
        rises, the cursor is within |q‴|r³ + 3|q″||r·r′| + |q′||r″| ≤ 2J",
    requirement: "REV, Beyond the source, *Rate law*",
    bound: "any memory, and one period (two for the jerk) after it: averages of 3 and 5 periods for the \
        acceleration, rate one being 63 and 15 units; of 3 periods for the jerk, rate one being 7 units; |q′| up to \
        7, |q″| up to 7 (3 for the jerk), |q‴| up to 3, A and J up to 15",
    assumes: "rates of 0 … 1 in one direction; |q′|, |q″| and |q‴| are bounds for all records in question; u is the \
        faster rate of the two periods of a change; |q‴| ≤ J; targets are multiples of the length, so that no mean \
        is rounded (row rate-balance has the rounding)",
    suffices: "it is the step from the commanded rate to the cursor in the derivation of the law, on the real \
        filter. The acceleration follows for every length, as (A − |q″|u²)/|q′| is concave in u; that is an \
        argument, and the proof is of the lengths above. That the drive commands such rates is tested (rows \
        law-limits, drive-slope, and the inequalities of the slopes on drawn figures in \
        crates/core/src/drive/slope.rs), not proved: CBMC did not end a period of `Drive::step` in six minutes",
    harnesses: &["law_limits_3", "law_limits_5", "law_jerk_3"],
    searches: &[],
    models: &[],
    mutants: &[
        Mutant {
            name: "half of the oldest value stays in the sum",
            file: RATE,
            find: "self.sum += value - *oldest;",
            put: "self.sum += value - *oldest / 2;",
            killer: "law_limits_3",
        },
        Mutant {
            name: "a falling value counts twice",
            file: RATE,
            find: "self.sum += value - *oldest;",
            put: "self.sum += value - *oldest + (value - *oldest).min(0);",
            killer: "law_limits_5",
        },
        Mutant {
            name: "the newest value counts twice",
            file: RATE,
            find: "self.sum += value - *oldest;",
            put: "self.sum += 2 * value - *oldest;",
            killer: "law_jerk_3",
        },
    ],
};
