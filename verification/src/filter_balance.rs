//! The rate filter at real lengths: one period from any balance and any sum over the memory, so an induction over
//! periods.
//!
//! Invariant: the memory is given by its sum alone, which is all of it that a period's arithmetic reads.

#[cfg(not(any(kani, verify_wasm)))]
use self::real_lengths::filter_is_its_definition;
use crate::choice::{Choice, ONE};
use crate::harness::{cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search};
use retrace_core::rate::{FilterBalance, FilterLengths};
use retrace_core::{Distance, Rate};

#[cfg(not(any(kani, verify_wasm)))]
mod real_lengths;

/// Highest rate, in units of 2⁻³² records per period.
const TOP: i64 = 8 * ONE;
/// Longest average, in periods.
const LONGEST: i64 = FilterLengths::MAX_PERIODS as i64;

/// Product of numbers that are known to be small enough: without the compiler's check, whose 128 bits of product are
/// the larger part of a proof.
const fn product(a: i64, b: i64) -> i64 {
    a.wrapping_mul(b)
}

/// One period from any balance, for any sum that rates of up to eight may have, and any whole units `moved` of it: they
/// and the new remainder are the sum and the old one, and the lead changes by what is commanded and not run.
fn nothing_is_lost(c: &mut impl Choice) -> Option<()> {
    let weights = c.between(1, LONGEST * LONGEST);
    let lead = Distance::from_units(c.between(-TOP * LONGEST, TOP * LONGEST));
    let before = FilterBalance { lead, remainder: c.between(0, weights - 1) };
    let (sum, target) = (c.between(-TOP * weights, TOP * weights), c.between(-TOP, TOP));
    // Euclid's division; the other two harnesses show that the code's is
    let moved = c.between(-TOP, TOP);
    let rest = sum + before.remainder - product(moved, weights);
    c.assume(0 <= rest && rest < weights)?;
    let after = before.after_moving(Distance::from_units(moved), Rate::from_units(target), sum, weights);
    cover!(c, Forward, sum > 0 && moved > 0);
    cover!(c, Backward, sum < 0 && moved < 0);
    cover!(c, Limited, sum == TOP * weights);
    cover!(c, AtRest, sum == 0 && target == 0);
    holds!(product(moved, weights) + after.remainder == sum + before.remainder);
    holds!(0 <= after.remainder && after.remainder < weights);
    holds!(after.lead.units() - before.lead.units() == target - moved);
    Some(())
}

/// For a sum that is not negative the filter divides by Euclid's rule: what remains is in 0 … weights − 1.
fn divides_forward(c: &mut impl Choice) -> Option<()> {
    let weights = c.between(1, LONGEST);
    let before = FilterBalance { lead: Distance::ZERO, remainder: c.between(0, weights - 1) };
    let sum = c.between(0, TOP * weights);
    let (after, moved) = before.after_period(Rate::ZERO, sum, weights);
    let rest = sum + before.remainder - product(moved.units(), weights);
    cover!(c, AtRest, sum == 0);
    cover!(c, Forward, moved > Distance::ZERO);
    cover!(c, Limited, sum == TOP * weights);
    holds!(0 <= rest && rest < weights);
    holds!(after.remainder == rest);
    Some(())
}

/// A sum that is negative is divided as its magnitude is, and rounded away from zero: with [`divides_forward`], what
/// remains is in 0 … weights − 1 in this direction too.
fn divides_backward(c: &mut impl Choice) -> Option<()> {
    let weights = c.between(1, LONGEST);
    let magnitude = c.between(0, TOP * weights);
    let (_, moved) = FilterBalance::ZERO.after_period(Rate::ZERO, 0i64.wrapping_sub(magnitude), weights);
    let (forward, whole) = FilterBalance::ZERO.after_period(Rate::ZERO, magnitude, weights);
    cover!(c, AtRest, magnitude == 0);
    cover!(c, Backward, moved < Distance::ZERO && forward.remainder == 0);
    cover!(c, Split, forward.remainder != 0);
    cover!(c, Limited, magnitude == TOP * weights);
    holds!(moved.units() == -whole.units() - i64::from(forward.remainder != 0));
    Some(())
}

harnesses! {
    balance_kept, unwind 1, covers [Forward, Backward, Limited, AtRest] => |c| nothing_is_lost(c);
    balance_divides_forward, unwind 1, covers [AtRest, Forward, Limited] => |c| divides_forward(c);
    balance_divides_backward, unwind 1, covers [AtRest, Backward, Split, Limited] => |c| divides_backward(c);
}

#[cfg(not(any(kani, verify_wasm)))]
const RATE: &str = "crates/core/src/rate.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[Row {
    name: "rate-balance",
    says: "With averages as long as a card allows, at any rate up to 8 in either direction, a period loses nothing and \
        overflows nothing: what the cursor moves and the remainder are the sum over the memory, divided by Euclid's \
        rule, and the lead changes by what is commanded and not run",
    requirement: "REV-12; REV, Beyond the source, *Rate law*",
    bound: "one period from any lead, remainder, sum and target: weights n₁·n₂ up to 2²⁴ for what is kept, every \
        divisor up to 4 096 for the division; on the filter itself, every odd length up to 4 095 with drawn targets",
    assumes: "the sum is that of the memory: proved in row rate-rest for short averages, searched here for all",
    suffices: "it is an induction over periods. With n the weights, S the sum, t the target, m moved, r the remainder, \
        and P what the memory has not released yet: P′ = P + n·t − S by definition and m·n + r′ = S + r as proved, so \
        n·lead − r = P holds again. As 0 ≤ r < n, the lead has the sign of P and is zero with it, and so is r. From \
        n·low ≤ S ≤ n·high it follows that low ≤ m ≤ high, and for two periods n·(m₂ − m₁) is what enters the sum less \
        what leaves it, within 2n. The drive averages over 1 and n periods: its divisors are all proved. CBMC proves \
        the code's arithmetic, not these lines, whose products of two unknowns it does not decide; the search checks \
        them in exact numbers",
    harnesses: &["balance_kept", "balance_divides_forward", "balance_divides_backward"],
    searches: &[Search { name: "filter-lengths", run: filter_is_its_definition }],
    models: &[],
    mutants: &[
        Mutant {
            name: "the remainder is not carried over",
            file: RATE,
            find: "remainder: sum + self.remainder - moved.units() * weights",
            put: "remainder: sum - moved.units() * weights",
            killer: "balance_kept",
        },
        Mutant {
            name: "the lead is what is commanded",
            file: RATE,
            find: "self.lead.units() + target.units() - moved.units()",
            put: "self.lead.units() + target.units() - moved.units() / 2",
            killer: "balance_kept",
        },
        Mutant {
            name: "a run backward is rounded toward zero",
            file: RATE,
            find: "(sum + self.remainder).div_euclid(weights)",
            put: "((sum + self.remainder) / weights)",
            killer: "balance_divides_backward",
        },
        Mutant {
            name: "the sum is divided by less than all weights",
            file: RATE,
            find: "(sum + self.remainder).div_euclid(weights)",
            put: "(sum + self.remainder).div_euclid(if weights > 3000 { 3000 } else { weights })",
            killer: "balance_divides_forward",
        },
        Mutant {
            name: "a long memory is cut",
            file: RATE,
            find: "if self.at + 1 == self.length { 0 }",
            put: "if self.at + 1 == if self.length > 4000 { 4000 } else { self.length } { 0 }",
            killer: "filter-lengths",
        },
    ],
}];
