//! The power of a beam (CUT-20): 0 unless the beam is on and pierces or moves, and within a step of the law.
//!
//! Invariant: the law is written here as in the requirements, without division.

use crate::choice::Choice;
use crate::harness::{cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row};
use retrace_card::beam_power::power_of;
use retrace_core::FeedShare;
use retrace_link::{BeamPower, LINEAR_POWER};

/// Steps of a feed share between two places in a [`FeedShare`], as bits.
const FRACTION_BITS: u32 = 32;

/// Any settings, S up to 2¹⁰ steps, any speed of up to four times the feed.
fn any_power(c: &mut impl Choice) -> Option<()> {
    let least = c.upto(u32::from(FeedShare::FEED.units())) as u16;
    let power = BeamPower { channel: 64, least: FeedShare::from_units(least), exponent: LINEAR_POWER };
    let (on, full) = (c.below(5) as i32 - 2, c.below(1 << 10) as i32 - 16);
    let speed = if c.flag() { c.below(1 << 17) } else { 0 };
    let share = u64::from(speed) << FRACTION_BITS | u64::from(c.below(2));
    let pierces = c.flag();
    let is = i64::from(power_of(power, on, full, if pierces { None } else { Some(share) }));
    let s = i64::from(full.max(0));
    holds!(0 <= is && is <= s);
    holds!(on != 0 || is == 0);
    holds!(pierces || share != 0 || is == 0);
    cover!(c, AtRest, on != 0 && share == 0 && !pierces && s > 0);
    cover!(c, Lit, is > 0 && !pierces);
    if on == 0 || share == 0 && !pierces {
        return Some(());
    }
    if pierces || on > 0 {
        holds!(is == s);
        return Some(());
    }
    // for the shares that are powers of two, which need no product: S, a half of it, a quarter …
    let share = speed.max(u32::from(least)).min(1 << 15);
    holds!(!share.is_power_of_two() || is == s >> (15 - share.trailing_zeros()));
    cover!(c, Limited, speed > 1 << 15);
    cover!(c, Rising, speed < u32::from(least));
    Some(())
}

harnesses! {
    beam_power_law, unwind 3, covers [AtRest, Lit, Limited, Rising] => |c| any_power(c);
}

#[cfg(not(any(kani, verify_wasm)))]
const POWER: &str = "crates/card/src/beam_power.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[Row {
    name: "beam-power",
    says: "The power of a beam is never above S; it is 0 with the beam off, and 0 at rest except in a pierce; with M3 \
        it is S; with M4 and the exponent 1, at a share of the feed that is a power of two, it is that share of S, \
        and at least the least one",
    requirement: "CUT-20",
    bound: "S below 2¹⁰ steps, values of the beam's output from −2 to 2, any least share, speeds below four times the \
        feed, the exponent 1; all values and exponents are drawn in the tests of the card",
    assumes: "that the share is that of the way of the period is tested against a definition (core, `playback`) and at \
        whole cards; not proved",
    suffices: "the function has no state",
    harnesses: &["beam_power_law"],
    searches: &[],
    models: &[],
    mutants: &[
        Mutant {
            name: "a beam has power at rest",
            file: POWER,
            find: "Some(0) => return 0,",
            put: "Some(0) => return full,",
            killer: "beam_power_law",
        },
        Mutant {
            name: "a beam that is off has power",
            file: POWER,
            find: "_ if on == 0 => return 0,",
            put: "Some(0) if on == 0 => return 0,",
            killer: "beam_power_law",
        },
        Mutant {
            name: "a fast beam has more than its power",
            file: POWER,
            find: "share.min(u64::from(FeedShare::FEED.units()))",
            put: "share.min(2 * u64::from(FeedShare::FEED.units()))",
            killer: "beam_power_law",
        },
        Mutant {
            name: "the least power is not kept",
            file: POWER,
            find: "share.max(u64::from(power.least.units()))",
            put: "share.max(u64::from(power.least.units()) / 2)",
            killer: "beam_power_law",
        },
    ],
}];
