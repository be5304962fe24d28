//! The rate filter and the wheel: rest exactly at the commanded place, no overshoot, and the bound on the change of the
//! rate.
//!
//! Invariant: every state of the filter that targets of one sign can lead to is reached by running it from rest over as
//! many targets as it remembers, because its remainder is determined by what it remembers.

use self::averaged_limits::{an_average_keeps_the_acceleration, an_average_keeps_the_jerk};
use crate::choice::{Choice, ONE};
use crate::harness::{built, cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
use retrace_core::rate::{FilterLengths, RateFilter};
use retrace_core::wheel::Wheel;
use retrace_core::{Distance, Rate};

mod averaged_limits;

/// Longest memory that is modelled.
const MEMORY: usize = 8;

/// A filter of these lengths in any state, and the targets that led to it, the newest first: `PERIODS` = N₁ + N₂ − 1 of
/// them.
fn any_law<const M: usize, const PERIODS: usize>(
    c: &mut impl Choice,
    first: u16,
    second: u16,
    top: i64,
) -> Option<(RateFilter<M>, [i64; PERIODS])> {
    let mut law = built!(RateFilter::new(built!(FilterLengths::new(first, second))));
    let mut targets = [0; PERIODS];
    let mut k = PERIODS;
    while k > 0 {
        k -= 1;
        targets[k] = c.between(0, top);
        law.step(Rate::from_units(targets[k]));
    }
    Some((law, targets))
}

/// Distance that the cursor has still to run for the remembered targets, the newest first, in units of 1/(N₁·N₂): each
/// of them as far as its weights have not been run yet.
fn pending<const PERIODS: usize>(targets: &[i64; PERIODS], weights: &[i64; 2 * MEMORY]) -> i64 {
    let (mut sum, mut k) = (0, 0);
    while k < PERIODS {
        let (mut share, mut n) = (0, k + 1);
        while n < PERIODS {
            share += weights[n];
            n += 1;
        }
        sum += share * targets[k];
        k += 1;
    }
    sum
}

/// The lead is the pending distance, rounded up to the last bit. So it is zero exactly where nothing is remembered, and
/// the cursor comes to rest at the commanded place. From any state, and again after any period.
fn lead_is_what_is_pending<const M: usize, const PERIODS: usize>(
    c: &mut impl Choice,
    first: u16,
    second: u16,
    top: i64,
) -> Option<()> {
    let (mut law, mut targets) = any_law::<M, PERIODS>(c, first, second, top)?;
    let (weights, unit) = (weights(first as usize, second as usize), i64::from(first) * i64::from(second));
    let over = unit * law.lead().units() - pending(&targets, &weights);
    holds!(0 <= over && over < unit);
    let (lead, target) = (law.lead(), c.between(0, top));
    cover!(c, AtRest, law.at_rest() && lead == Distance::ZERO);
    cover!(c, Rising, lead > Distance::ZERO && target == top);
    cover!(c, Falling, lead > Distance::ZERO && target == 0);
    let moved = law.step(Rate::from_units(target));
    holds!(law.lead() == lead + Rate::from_units(target).over(1) - moved && moved >= Distance::ZERO);
    let mut k = PERIODS - 1;
    while k > 0 {
        targets[k] = targets[k - 1];
        k -= 1;
    }
    targets[0] = target;
    let over = unit * law.lead().units() - pending(&targets, &weights);
    holds!(0 <= over && over < unit);
    Some(())
}

/// The rate is between the least and the greatest remembered target, up to the last bit; where they are all equal, it
/// is that target.
fn never_overshoots<const M: usize, const PERIODS: usize>(
    c: &mut impl Choice,
    first: u16,
    second: u16,
    top: i64,
) -> Option<()> {
    let (mut law, targets) = any_law::<M, PERIODS>(c, first, second, top)?;
    let (low, high, target) = (c.between(0, top), c.between(0, top), c.between(0, top));
    let (mut within, mut k) = (low <= target && target <= high, 0);
    while k + 1 < PERIODS {
        within &= low <= targets[k] && targets[k] <= high;
        k += 1;
    }
    c.assume(within)?;
    let moved = law.step(Rate::from_units(target)).units();
    cover!(c, AtRest, high == 0);
    cover!(c, Limited, 0 < low && high < top);
    cover!(c, Split, low < moved && moved < high);
    holds!(low <= moved + 1 && moved <= high + 1);
    Some(())
}

/// With nothing more commanded, the cursor is at rest after as many periods as the filter remembers, and the whole lead
/// is run.
fn comes_to_rest<const M: usize, const PERIODS: usize>(
    c: &mut impl Choice,
    first: u16,
    second: u16,
    top: i64,
) -> Option<()> {
    let (mut law, _) = any_law::<M, PERIODS>(c, first, second, top)?;
    let (lead, mut run, mut k) = (law.lead(), Distance::ZERO, 0);
    cover!(c, AtRest, lead == Distance::ZERO);
    cover!(c, Forward, lead > Distance::ZERO);
    while k < PERIODS {
        run += law.step(Rate::ZERO);
        k += 1;
    }
    holds!(run == lead && law.lead() == Distance::ZERO && law.at_rest() && law.step(Rate::ZERO) == Distance::ZERO);
    Some(())
}

/// Weights of the twice moving average, in units of 1/(N₁·N₂), the newest target first.
const fn weights(first: usize, second: usize) -> [i64; 2 * MEMORY] {
    let mut weights = [0; 2 * MEMORY];
    let mut i = 0;
    while i < first {
        let mut j = 0;
        while j < second {
            weights[i + j] += 1;
            j += 1;
        }
        i += 1;
    }
    weights
}

/// Rate and change of the rate of a plain step from 0 to 1 in its `k`-th period, in units of 1/(2·N₁·N₂): the rate in
/// the middle of the two periods, the change doubled.
const fn plain_step(weights: &[i64; 2 * MEMORY], k: usize) -> (i64, i64) {
    let (mut sum, mut n) = (0, 0);
    while n < k {
        sum += weights[n];
        n += 1;
    }
    (2 * sum + weights[k], 2 * weights[k])
}

/// For targets in 0 … 1 the change |r′| at a rate r is at most that of a plain step at that rate: under every line
/// through two neighbouring points of the plain step.
fn change_is_bounded<const M: usize, const PERIODS: usize>(
    c: &mut impl Choice,
    first: u16,
    second: u16,
    top: i64,
) -> Option<()> {
    let (mut law, _) = any_law::<M, PERIODS>(c, first, second, top)?;
    // the period before is one more step, so that both rates come from whole memories
    let before = law.step(Rate::from_units(c.between(0, top))).units();
    let after = law.step(Rate::from_units(c.between(0, top))).units();
    let weights = weights(first as usize, second as usize);
    let unit = i64::from(first) * i64::from(second);
    cover!(c, Rising, before < after);
    cover!(c, Falling, after < before);
    cover!(c, Limited, after == top);
    let mut k = 0;
    while k + 1 < PERIODS {
        let ((r0, d0), (r1, d1)) = (plain_step(&weights, k), plain_step(&weights, k + 1));
        // (|r′| − d0)·(r1 − r0) ≤ (r − r0)·(d1 − d0), with everything in units of 1/(2·unit); each rate is off by less
        // than a last bit
        let (rate, change) = (unit * (before + after), 2 * unit * (after - before).abs());
        let slack = unit * (4 * (r1 - r0) + 2 * (d1 - d0).abs());
        holds!((change - d0 * top) * (r1 - r0) <= (rate - r0 * top) * (d1 - d0) + slack);
        k += 1;
    }
    Some(())
}

/// The wheel's rate is the mean of the last periods, clamped to ±1: zero when the wheel has been at rest.
fn wheel_follows(c: &mut impl Choice) -> Option<()> {
    let (mut wheel, mut turns, mut k) = (Wheel::<4>::new(4, 8), [0; 5], 0);
    while k < 5 {
        turns[k] = c.increment();
        wheel.push_difference(turns[k]);
        k += 1;
    }
    let sum = i64::from(turns[1]) + i64::from(turns[2]) + i64::from(turns[3]) + i64::from(turns[4]);
    let held = if sum > 8 {
        8
    } else if sum < -8 {
        -8
    } else {
        sum
    };
    cover!(c, AtRest, held == 0 && turns[4] == 0);
    cover!(c, Forward, 0 < held && held < 8);
    cover!(c, Backward, -8 < held && held < 0);
    cover!(c, Limited, sum > 8);
    holds!(wheel.rate() == Rate::from_units(held << 29));
    Some(())
}

/// Largest target in last bits, where the proof compares sums: the filter is linear, and its rounding is in the last
/// bit.
const LAST_BITS: i64 = 15;

/// Highest rate.
const TOP: i64 = 8 * ONE;

harnesses! {
    law_pending_1_1, unwind 5, covers [AtRest] => |c| lead_is_what_is_pending::<1, 1>(c, 1, 1, TOP);
    law_pending_2_2, unwind 6, covers [AtRest, Rising, Falling] =>
        |c| lead_is_what_is_pending::<2, 3>(c, 2, 2, LAST_BITS);
    law_pending_1_3, unwind 6, covers [AtRest, Rising, Falling] =>
        |c| lead_is_what_is_pending::<3, 3>(c, 1, 3, LAST_BITS);
    law_pending_4_2, unwind 10, covers [AtRest, Rising, Falling] => |c| lead_is_what_is_pending::<4, 5>(c, 4, 2, 3);
    law_within_2_2, unwind 6, covers [AtRest, Limited, Split] => |c| never_overshoots::<2, 3>(c, 2, 2, LAST_BITS);
    law_within_4_2, unwind 10, covers [AtRest, Limited, Split] => |c| never_overshoots::<4, 5>(c, 4, 2, LAST_BITS);
    law_rests_2_2, unwind 6, covers [AtRest, Forward] => |c| comes_to_rest::<2, 3>(c, 2, 2, LAST_BITS);
    law_change_2_2, unwind 6, covers [Rising, Falling, Limited] => |c| change_is_bounded::<2, 3>(c, 2, 2, 63);
    law_change_4_2, unwind 10, covers [Rising, Falling, Limited] => |c| change_is_bounded::<4, 5>(c, 4, 2, 63);
    law_limits_3, unwind 5, covers [Rising, Falling, Limited] => |c| an_average_keeps_the_acceleration::<3>(c, 63);
    law_limits_5, unwind 7, covers [Rising, Falling, Limited] => |c| an_average_keeps_the_acceleration::<5>(c, 15);
    law_jerk_3, unwind 6, covers [Rising, Falling] => |c| an_average_keeps_the_jerk::<3, 5>(c, 7);
    wheel_mean, unwind 8, covers [AtRest, Forward, Backward, Limited] => |c| wheel_follows(c);
}

/// The bound on the change, for every pair of lengths up to eight and every memory of targets 0 and 1: a linear
/// inequality over targets in 0 … 1 holds everywhere if it holds at the corners.
#[cfg(not(any(kani, verify_wasm)))]
fn change_at_every_corner(_: Size) -> String {
    let mut corners = 0u64;
    for first in 1..=MEMORY {
        for second in (1..=MEMORY).filter(|second| (first + second).is_multiple_of(2)) {
            let (weights, periods) = (weights(first, second), first + second - 1);
            let steps: Vec<_> = (0..periods).map(|k| plain_step(&weights, k)).collect();
            for memory in 0u32..1 << (periods + 1) {
                let at = |shift: usize| {
                    (0..periods).filter(|n| memory >> (n + shift) & 1 == 1).map(|n| weights[n]).sum::<i64>()
                };
                let (after, before) = (at(0), at(1));
                let (rate, change) = (after + before, 2 * (after - before).abs());
                for pair in steps.windows(2) {
                    let ((r0, d0), (r1, d1)) = (pair[0], pair[1]);
                    assert!((change - d0) * (r1 - r0) <= (rate - r0) * (d1 - d0), "{first} {second} {memory:b}");
                }
                corners += 1;
            }
        }
    }
    format!("all {corners} corners of lengths 1 to {MEMORY}")
}

/// Long averages: any targets at any time, then rest at the commanded place.
#[cfg(not(any(kani, verify_wasm)))]
fn long_averages(size: Size) -> String {
    use crate::native::Draw;
    let mut draw = Draw::new(size.seed);
    let runs = if size.full { 400 } else { 20 };
    for _ in 0..runs {
        let first = 1 + draw.upto(FilterLengths::MAX_PERIODS.into()).min(4095) as u16;
        let second = (1 + draw.upto(FilterLengths::MAX_PERIODS.into()).min(4095) as u16) & !1 | first & 1;
        let Some(smoothing) = FilterLengths::new(first, second.max(2 - first % 2)) else { continue };
        let mut law = Box::new(RateFilter::<4096>::new(smoothing).expect("fits"));
        let (mut commanded, mut run) = (0i128, 0i128);
        for _ in 0..draw.upto(60) {
            let target = draw.between(0, 8 * ONE);
            for _ in 0..=draw.upto(2 * u32::from(smoothing.periods())) {
                commanded += i128::from(target);
                let moved = law.step(Rate::from_units(target)).units();
                run += i128::from(moved);
                assert!((0..=8 * ONE).contains(&moved) && i128::from(law.lead().units()) == commanded - run);
            }
        }
        for _ in 0..smoothing.periods() {
            run += i128::from(law.step(Rate::ZERO).units());
        }
        assert!(run == commanded && law.at_rest() && law.lead() == Distance::ZERO);
    }
    format!("{runs} drawn runs with averages of up to {} periods", FilterLengths::MAX_PERIODS)
}

#[cfg(not(any(kani, verify_wasm)))]
const RATE: &str = "crates/core/src/rate.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    averaged_limits::ROW,
    Row {
        name: "rate-rest",
        says: "The cursor comes to rest exactly at the commanded place and never beyond, nothing commanded is lost; \
            the rate never overshoots its targets and reaches one that is held",
        requirement: "REV-12; REV, Beyond the source, *Rate law*",
        bound: "averages of 1+1 (any targets up to rate 8), 1+3, 2+2 and 4+2 periods (targets of up to 15 last bits, \
            where the rounding is) from any state; drawn runs up to 4 096 periods and rate 8",
        assumes: "the targets in the memory have one sign (row drive-road: a change of direction passes through rest)",
        suffices: "every reachable state is covered, as the remainder is determined by the memory; sums of targets \
            are linear and have no size at which they change, up to the 2⁵⁹ that 64 bits hold; the code depends on \
            the lengths only by wrapping at them and by their product; row rate-balance has the arithmetic at every \
            length",
        harnesses: &[
            "law_pending_1_1",
            "law_pending_2_2",
            "law_pending_1_3",
            "law_pending_4_2",
            "law_within_2_2",
            "law_within_4_2",
            "law_rests_2_2",
        ],
        searches: &[Search { name: "law-long", run: long_averages }],
        models: &[],
        mutants: &[
            Mutant {
                name: "averages that are exact are refused",
                file: RATE,
                find: "let valid = lengths && (first + second).is_multiple_of(2);",
                put: "let valid = lengths && first.is_multiple_of(2);",
                killer: "law_pending_1_3",
            },
            Mutant {
                name: "the remainder is forgotten",
                file: RATE,
                find: "(sum + self.remainder).div_euclid(weights)",
                put: "sum.div_euclid(weights)",
                killer: "law_pending_1_3",
            },
            Mutant {
                name: "the second average is one period too long",
                file: RATE,
                find: "i64::from(self.lengths.first) * i64::from(self.lengths.second);",
                put: "i64::from(self.lengths.first) * i64::from(self.lengths.second + 1);",
                killer: "law_pending_2_2",
            },
            Mutant {
                name: "the oldest value stays in the sum",
                file: RATE,
                find: "self.sum += value - *oldest;",
                put: "self.sum += value - *oldest / 2;",
                killer: "law_within_2_2",
            },
            Mutant {
                name: "memory wraps one late",
                file: RATE,
                find: "if self.at + 1 == self.length { 0 }",
                put: "if self.at == self.length { 0 }",
                killer: "law-long",
            },
        ],
    },
    Row {
        name: "rate-change",
        says: "For any targets at any time, the change of the rate at a rate r is at most that of a plain step from 0 \
            to 1 at that rate",
        requirement: "REV, Beyond the source, *Rate law*",
        bound: "averages of 2+2 and 4+2 periods in fixed point, a full rate being 63 last bits; all lengths up to 8 \
            in exact numbers",
        assumes: "targets in 0 … 1: rapid retrace has caps of its own",
        suffices: "the weights of two averages rise, remain constant and fall for all lengths; the drive averages \
            over 1 and n periods, for which this means |r′| ≤ 1/n; slopes provide what the axes' limits require \
            beyond that (rows drive-slope, drive-braking)",
        harnesses: &["law_change_2_2", "law_change_4_2"],
        searches: &[Search { name: "law-corners", run: change_at_every_corner }],
        models: &[],
        mutants: &[Mutant {
            name: "the first average does nothing",
            file: RATE,
            find: "let sum = self.targets.push(target.units());",
            put: "let sum = self.targets.push(target.units()).min(0) + target.units() * i64::from(self.lengths.first);",
            killer: "law_change_2_2",
        }],
    },
    Row {
        name: "wheel-rest",
        says: "The handwheel's rate is within ±1 and zero when the wheel has been at rest for as long as its mean is",
        requirement: "REV-11, REV-12",
        bound: "a mean of 4 periods, any counts",
        assumes: "the wheel's counts in a period fit 16 bits",
        suffices: "the code depends on the length only by wrapping at it",
        harnesses: &["wheel_mean"],
        searches: &[],
        models: &[],
        mutants: &[Mutant {
            name: "the wheel's rate is not held at one",
            file: "crates/core/src/wheel.rs",
            find: "let sum = self.sum.clamp(-self.counts_at_one, self.counts_at_one);",
            put: "let sum = self.sum;",
            killer: "wheel_mean",
        }],
    },
];
