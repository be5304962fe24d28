//! The table of braking: its slopes, the lengths of its ramps, and the rate that a distance allows (REV, *Braking to a
//! place*).
//!
//! Invariant: the largest rate and the legal slope are defined here by their inequalities, not by the table.

use self::one_period::{the_cursor_keeps_its_ramp, what_is_allowed_can_be_braked};
use crate::choice::{Choice, ONE};
use crate::harness::{built, cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
use retrace_core::drive::Braking;
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::{Distance, Rate};

mod one_period;

/// A machine whose rate may change by about a hundredth per period.
const SOFT: PulseLimits = PulseLimits { velocity: 100 << 32, acceleration: 3 << 32, jerk: 1 << 32 };

/// Braking on that machine, the plan using a share of its limits.
fn braking(share: u16) -> Braking<8> {
    built!(Braking::new(&built!(RateLimits::new(3, share, [SOFT]))))
}

/// The period before a ramp is in its length, unless the next rate ends in one period: S(u) ≥ u + S(u⁻), where u⁻ is u
/// less the slope at it. This is a whole slope more than braking needs, so that no rounding of the table can use it up.
fn ramps_have_a_slope_to_spare(c: &mut impl Choice, braking: &Braking<8>) -> Option<()> {
    let rate = Rate::from_units(c.between(0, ONE >> 16) << 16);
    let slope = braking.slope(rate, 16);
    c.assume(rate > slope)?;
    let less = rate - slope;
    c.assume(less > braking.slope(Rate::from_units(1), 16))?;
    cover!(c, Limited, rate == Rate::ONE);
    cover!(c, Falling, rate < Rate::ONE);
    holds!(braking.length(rate) + Distance::from_units(2) >= rate.over(1) + braking.length(less));
    Some(())
}

harnesses! {
    braking_spare_soft, unwind 301, covers [Limited, Falling] => |c| ramps_have_a_slope_to_spare(c, &braking(45_000));
    braking_spare_tight, unwind 301, covers [Limited, Falling] => |c| ramps_have_a_slope_to_spare(c, &braking(60_000));
    braking_allows_8, unwind 20, covers [AtEnd, Limited, Rising] =>
        |c| what_is_allowed_can_be_braked::<8, 20>(c, 52_000);
    braking_allows_4, unwind 20, covers [AtEnd, Limited, Rising] =>
        |c| what_is_allowed_can_be_braked::<4, 20>(c, 20_000);
    braking_cursor_4, unwind 20, covers [Forward, Backward, Wrapped, AtEnd, Limited] =>
        |c| the_cursor_keeps_its_ramp::<4, 20>(c, 52_000, 10);
}

/// The rate that a distance allows can be braked from within it, and four last bits more cannot; without any distance
/// it is zero: for every distance in steps, up to what the ramp from rate one needs.
#[cfg(not(any(kani, verify_wasm)))]
fn the_largest_rate_is_allowed(size: Size) -> String {
    let (step, mut asked) = (if size.full { ONE >> 10 } else { ONE >> 7 }, 0u64);
    for braking in [braking(45_000), braking(60_000)] {
        let whole = braking.length(Rate::ONE) + Distance::records(3);
        for units in (-ONE..=whole.units()).step_by(step as usize) {
            for free in [units, units + 1, units + step / 3].map(Distance::from_units) {
                let rate = braking.max_rate_within(Rate::ONE, free);
                assert!(Rate::ZERO <= rate && rate <= Rate::ONE, "{rate:?} within {free:?}");
                let fits = |rate: Rate| rate.over(1) + braking.length(rate) <= free;
                assert!(
                    if free > Distance::ZERO { fits(rate) } else { rate == Rate::ZERO },
                    "{rate:?} within {free:?}"
                );
                let more = rate + Rate::from_units(4);
                assert!(more > Rate::ONE || !fits(more), "{rate:?} within {free:?}");
                asked += 1;
            }
        }
    }
    format!("{asked} lengths of path")
}

/// The slopes are legal for records that use all that the plan may, and the steepest that are: the inequalities of
/// acceleration and jerk in whole numbers, for drawn machines.
#[cfg(not(any(kani, verify_wasm)))]
fn slopes_are_legal(size: Size) -> String {
    let mut draw = crate::native::Draw::new(size.seed);
    let (runs, mut machines) = (if size.full { 200_000 } else { 20_000 }, 0u32);
    for _ in 0..runs {
        let velocity = (1u64 << (8 + draw.below(40))) + u64::from(draw.word() >> draw.below(32));
        let acceleration = (velocity / (1 + u64::from(draw.word() >> (18 + draw.below(14))))).max(1 << 8);
        let average = 2 * draw.below(100) as u16 + 1;
        let jerk = (acceleration / (1 + u64::from(draw.below(average.into())))).max(1 << 8);
        let (share, axis) = (1 + draw.below(60_000) as u16, PulseLimits { velocity, acceleration, jerk });
        let Some(limits) = RateLimits::new(average, share, [axis]) else { continue };
        let Some(braking) = Braking::<32>::new(&limits) else { continue };
        for k in 1..=32 {
            let slope = i128::from(braking.slope(Rate::ONE / 32 * k, 16).units());
            let [v, a, j, n, share] = [velocity, acceleration, jerk, average.into(), share.into()].map(i128::from);
            // V·f + αA·u² ≤ A and f·(3αA + 2V/n) ≤ (2 − α)J, times all denominators
            let accelerated = |f: i128| ((v * f) << 26) + ((share * a * i128::from(k * k)) << 32);
            let jerked = |f: i128| f * (3 * share * a * n + ((2 * v) << 16));
            let (most_accelerated, most_jerked) = (a << 58, (((2 << 16) - share) * j * n) << 32);
            let legal = |f: i128| accelerated(f) <= most_accelerated && jerked(f) <= most_jerked;
            assert!(legal(slope), "{slope} at {k}/32: {limits:?}");
            let rounding = 8 + slope / (1 << 20) + 64 * (1 << 32) / v.min(j << 10);
            let clipped = slope >= i128::from(ONE / 32);
            assert!(clipped || !legal(slope + rounding), "{slope} and {rounding} at {k}/32: {limits:?}");
        }
        machines += 1;
    }
    format!("{machines} drawn machines")
}

#[cfg(not(any(kani, verify_wasm)))]
const BRAKING: &str = "crates/core/src/drive/braking.rs";
#[cfg(not(any(kani, verify_wasm)))]
const SLOPE: &str = "crates/core/src/drive/slope.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    one_period::ROW,
    Row {
        name: "braking-table",
        says: "The slopes of braking are the steepest that are legal anywhere on the machine, the length of a ramp \
            includes a whole slope more than it needs, and the rate that a distance allows is the largest that can \
            be braked in it",
        requirement: "REV, Beyond the source, *Braking to a place*",
        bound: "any rate up to 1 in steps of 2⁻¹⁶ for the slope to spare; distances in steps of 2⁻¹⁰ up to the ramp \
            from rate 1 and 3 records for the largest rate, searched, not proved; on two machines with 8 intervals; \
            the slopes on drawn machines with velocities of 2⁻²⁴ to 2¹⁶ pulses",
        assumes: "nothing",
        suffices: "lengths are linear over each interval; the slopes are one formula of the limits",
        harnesses: &["braking_spare_soft", "braking_spare_tight"],
        searches: &[
            Search { name: "largest-rate", run: the_largest_rate_is_allowed },
            Search { name: "slopes-legal", run: slopes_are_legal },
        ],
        models: &[],
        mutants: &[
            Mutant {
                name: "the growth of the ramp is rounded down",
                file: BRAKING,
                find: "(SIXTEENTHS * end + slope - 1).div_euclid(slope)",
                put: "(SIXTEENTHS * end).div_euclid(slope)",
                killer: "braking_spare_tight",
            },
            Mutant {
                name: "the largest rate is negative beyond the end",
                file: BRAKING,
                find: "return one_period.clamp(Rate::ZERO, Rate::ONE);",
                put: "return one_period.min(Rate::ONE);",
                killer: "largest-rate",
            },
            Mutant {
                name: "a tenth of a record is not used",
                file: BRAKING,
                find: "let over = free - Distance::from_units(1) - self.lengths[k] - start.over(1);",
                put: "let over = free - Distance::RECORD / 10 - self.lengths[k] - start.over(1);",
                killer: "largest-rate",
            },
            Mutant {
                name: "the divisor of a ratio is rounded down",
                file: SLOPE,
                find: "(denominator >> (32 - shift)) + 1",
                put: "(denominator >> (32 - shift))",
                killer: "slopes-legal",
            },
            Mutant {
                name: "a scaled figure is rounded down",
                file: SLOPE,
                find: "product.div_ceil(1 << 10)",
                put: "product / (1 << 10)",
                killer: "slopes-legal",
            },
        ],
    },
];
