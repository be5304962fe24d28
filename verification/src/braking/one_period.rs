//! One period of braking, from any state from which the cursor can brake: an induction over periods.
//!
//! Invariant: the rate is taken from the places of the cursor, and the distance to the end from the window.

use crate::choice::{Choice, ONE};
use crate::harness::{built, cover, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row};
use retrace_core::drive::{Braking, Cursor, DirectedWindow, RecordWindow};
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::rate::{FilterLengths, RateFilter};
use retrace_core::{Distance, Place, RapidCap, Rate, RecordIndex};

/// A machine that brakes in a few periods.
const STIFF: PulseLimits = PulseLimits { velocity: 100 << 32, acceleration: 30 << 32, jerk: 10 << 32 };

/// Records between two ends at which the path is not at rest.
#[derive(Clone, Copy, Debug)]
struct Records {
    low: RecordIndex,
    count: u32,
}

impl RecordWindow<1> for Records {
    fn low(&self) -> RecordIndex {
        self.low
    }
    fn high(&self) -> RecordIndex {
        self.low + self.count
    }
    fn rests_at(&self, _: RecordIndex) -> bool {
        false
    }
    fn cap(&self, _: RecordIndex) -> RapidCap {
        RapidCap::PLANNED
    }
    fn increments(&self, _: RecordIndex) -> [i16; 1] {
        [1]
    }
    fn is_rapid(&self, _: RecordIndex) -> bool {
        false
    }
}

/// For any rate up to one and any length of path in which its ramp fits: the rate that braking then allows is the one
/// that is commanded or does not fall by more than the slope that is legal anywhere, and its ramp fits into what it
/// leaves.
pub(super) fn what_is_allowed_can_be_braked<const N: usize, const GRAIN: u32>(
    c: &mut impl Choice,
    share: u16,
) -> Option<()> {
    let braking = built!(Braking::<N>::new(&built!(RateLimits::new(3, share, [STIFF]))));
    let rate = Rate::from_units(c.between(0, ONE >> GRAIN) << GRAIN);
    let commanded = Rate::from_units(c.between(0, ONE >> GRAIN) << GRAIN);
    let free = Distance::from_units(c.between(0, (10 * ONE) >> GRAIN) << GRAIN);
    c.assume(free >= braking.length(rate))?;
    let next = braking.max_rate_within(commanded, free);
    cover!(c, AtEnd, next > Rate::ZERO && next.over(1) == free);
    cover!(c, Limited, next < commanded && next < rate);
    cover!(c, Rising, next > rate);
    holds!(Rate::ZERO <= next && next <= commanded);
    holds!(free - next.over(1) >= braking.length(next));
    let least = rate - braking.slope(rate, 16) - Rate::from_units(4);
    holds!(next == commanded || next >= least);
    holds!(next > Rate::ZERO || commanded == Rate::ZERO || free == Distance::ZERO);
    Some(())
}

/// From any rate up to one whose ramp fits into what is left of the window, and for any rate that braking allows there
/// as [`what_is_allowed_can_be_braked`] has it: the cursor stays in the window, moves at that rate, and its ramp fits
/// again.
pub(super) fn the_cursor_keeps_its_ramp<const N: usize, const GRAIN: u32>(
    c: &mut impl Choice,
    share: u16,
    records: u32,
) -> Option<()> {
    let braking = built!(Braking::<N>::new(&built!(RateLimits::new(3, share, [STIFF]))));
    let any_rate = |c: &mut _| Rate::from_units(Choice::between(c, 0, ONE >> GRAIN) << GRAIN);
    let sign = if c.flag() { 1 } else { -1 };
    let (rate, commanded, allowed) = (any_rate(c), any_rate(c), any_rate(c));
    let window = Records { low: RecordIndex::new(c.word()), count: c.below(records + 1) };
    let (record, fraction) = (c.below(records + 1), c.upto(u32::MAX >> GRAIN) << GRAIN);
    c.assume(record < window.count || record == window.count && fraction == 0)?;
    let at = Place { record: window.low + record, fraction };
    let end = Place::start_of(if sign > 0 { window.high() } else { window.low });
    let left = |at: Place| if sign > 0 { at.distance_to(end) } else { end.distance_to(at) };
    let free = left(at);
    c.assume(free >= braking.length(rate))?;
    c.assume(allowed <= commanded && free - allowed.over(1) >= braking.length(allowed))?;
    let mut filter = built!(RateFilter::<1>::new(built!(FilterLengths::new(1, 1))));
    filter.step(if sign > 0 { rate } else { -rate });
    let mut cursor = Cursor::with_filter(filter);
    let to = cursor.advance(commanded, allowed, &DirectedWindow { at, sign, window: &window }).to;
    cover!(c, Forward, sign > 0 && allowed > Rate::ZERO);
    cover!(c, Backward, sign < 0 && allowed > Rate::ZERO);
    cover!(c, Wrapped, window.high().number() < window.low.number());
    cover!(c, AtEnd, allowed > Rate::ZERO && left(to) == Distance::ZERO);
    cover!(c, Limited, allowed < commanded && allowed < rate);
    holds!(free - left(to) == allowed.over(1));
    holds!(left(to) >= Distance::ZERO && left(to) >= braking.length(allowed));
    holds!(cursor.filter().target().abs() == allowed && cursor.filter().lead() == Distance::ZERO);
    Some(())
}

/// The row of one period of braking.
#[cfg(not(any(kani, verify_wasm)))]
pub(super) const ROW: Row = Row {
    name: "braking-period",
    says: "Braking is an induction over periods: from any rate up to 1 whose ramp fits into what is left of the \
        window, the rate that braking allows is the one that is commanded, or falls by no more than the slope that \
        is legal anywhere; it is not zero before the end while a rate is commanded; the cursor moves at it, stays in \
        the window, and the ramp fits again",
    requirement: "REV, Beyond the source, *Braking to a place*",
    bound: "one period from any state: rates, places and lengths of path in steps of a 4 096th, up to 10 records to \
        the end; machines that brake in 6 periods with a table of 4 intervals, and in 13 with one of 8 (a card has \
        32); for the cursor an average of one period, both directions, any numbers over the wrap",
    assumes: "no planned stop ahead, which needs no braking; the cursor moves at any rate of which the first two \
        harnesses prove that braking allows it",
    suffices: "the two lines of `Drive::step` that brake, in turn: `Braking::max_rate_within` with the first two \
        harnesses, `Cursor::advance` with the third. The rates of the next period are between the steps; the lengths \
        of the table are linear over each interval, and row drive-braking searches finer ones. With a longer average \
        the lead is subtracted from what is left, and the cursor comes to rest where the commanded place does (rows \
        rate-rest, drive-road)",
    harnesses: &["braking_allows_4", "braking_allows_8", "braking_cursor_4"],
    searches: &[],
    models: &[],
    mutants: &[
        Mutant {
            name: "a rate is kept until its own period ends the path",
            file: super::BRAKING,
            find: "} else if free >= rate.over(1) + self.length(rate) {",
            put: "} else if free >= rate.over(1) {",
            killer: "braking_allows_4",
        },
        Mutant {
            name: "a sixteenth of a record more is allowed than there is",
            file: super::BRAKING,
            find: "let over = free - Distance::from_units(1) - self.lengths[k] - start.over(1);",
            put: "let over = free + Distance::RECORD / 16 - self.lengths[k] - start.over(1);",
            killer: "braking_allows_8",
        },
        Mutant {
            name: "the cursor moves at what is commanded",
            file: "crates/core/src/drive/cursor.rs",
            find: "let allowed = if last_rest.is_some() { requested } else { within };",
            put: "let allowed = if last_rest.is_some() { within } else { requested };",
            killer: "braking_cursor_4",
        },
    ],
};
