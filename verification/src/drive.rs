//! The drive: the cursor in the record window, and playback's second difference (REV, *Rate law* and *Braking to a
//! place*).
//!
//! Invariant: a state is any that the cursor's own invariant allows: the commanded place is in the window, or a planned
//! stop is between the cursor and its end. The rate that the drive requests is any number: slopes observe the limits,
//! the cursor stays in the window.

use crate::choice::{Choice, ONE};
use crate::harness::{built, cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
use retrace_core::drive::{Braking, Cursor, DirectedWindow, RecordWindow};
use retrace_core::limits::{PulseLimits, RateLimits};
use retrace_core::playback::emission;
use retrace_core::rate::{FilterLengths, RateFilter};
use retrace_core::{Distance, Place, RapidCap, Rate, Record, RecordIndex};

/// Largest number of boundaries of a modelled window.
const BOUNDARIES: u32 = 6;

/// A short record window: bit n of `rests` says whether the path is at rest at the n-th boundary.
#[derive(Clone, Copy, Debug)]
struct ShortWindow {
    low: RecordIndex,
    records: u32,
    rests: u32,
}

impl RecordWindow<1> for ShortWindow {
    fn low(&self) -> RecordIndex {
        self.low
    }
    fn high(&self) -> RecordIndex {
        self.low + self.records
    }
    fn rests_at(&self, place: RecordIndex) -> bool {
        let n = place.since(self.low);
        n < BOUNDARIES && self.rests >> n & 1 == 1
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

/// Any rate from `least` grains up to one, a grain being 2ᴳᴿᴬᴵᴺ last bits.
fn any_rate<const GRAIN: u32>(c: &mut impl Choice, least: i64) -> Rate {
    Rate::from_units(c.between(least, ONE >> GRAIN) << GRAIN)
}

/// State of the cursor: a window, a place in it, the direction of motion, and the state of the rate filter.
///
/// Rates and places are multiples of `GRAIN`: the last bit, or a sixteenth of a record.
struct Scene<const M: usize, const GRAIN: u32> {
    cursor: Cursor<M>,
    window: ShortWindow,
    at: Place,
    sign: i64,
}

impl<const M: usize, const GRAIN: u32> Scene<M, GRAIN> {
    /// Any state with an average of `M` periods that the invariant allows, in a window of up to `records`.
    fn any(c: &mut impl Choice, records: u32) -> Option<Self> {
        let sign = if c.flag() { 1 } else { -1 };
        let mut law = built!(RateFilter::new(built!(FilterLengths::new(1, M as u16))));
        let mut k = 0;
        while k < M {
            let target = c.between(0, ONE >> GRAIN) << GRAIN;
            law.step(Rate::from_units(if sign < 0 { -target } else { target }));
            k += 1;
        }
        let window = ShortWindow {
            low: RecordIndex::new(c.word()),
            records: c.below(records + 1),
            rests: c.below(1 << (records + 1)),
        };
        let (record, fraction) = (c.below(records + 1), c.upto(u32::MAX >> GRAIN) << GRAIN);
        c.assume(record < window.records || record == window.records && fraction == 0)?;
        let at = Place { record: (window.low + record), fraction };
        let scene = Self { cursor: Cursor::with_filter(law), window, at, sign };
        c.assume(scene.legal(records))?;
        let end = if sign > 0 { window.high() } else { window.low };
        cover!(c, Forward, sign > 0);
        cover!(c, Backward, sign < 0);
        cover!(c, Wrapped, window.high().number() < window.low.number());
        cover!(c, AtEnd, at == Place::start_of(end));
        cover!(c, AtRest, scene.cursor.filter().at_rest());
        cover!(c, Split, fraction != 0);
        // the commanded place is beyond the end: the cursor runs out on a planned stop
        let beyond = Place::start_of(end).distance_to(at.moved(scene.cursor.filter().lead())).units();
        cover!(c, PlannedStop, if sign > 0 { beyond > 0 } else { beyond < 0 });
        Some(scene)
    }

    /// The cursor's invariant, written independently: distances in plain numbers from the beginning of the window.
    fn legal(&self, records: u32) -> bool {
        let at = Place::start_of(self.window.low).distance_to(self.at).units();
        let end = i64::from(self.window.records) << 32;
        let commanded = at + self.cursor.filter().lead().units();
        let mut stop_ahead = false;
        let mut n = 0;
        while n <= records {
            let stop = i64::from(n) << 32;
            let ahead = if self.sign > 0 { at < stop && stop <= end } else { stop < at };
            stop_ahead |= ahead && n <= self.window.records && self.window.rests >> n & 1 == 1;
            n += 1;
        }
        0 <= at && at <= end && (0 <= commanded && commanded <= end || stop_ahead)
    }
}

/// One period from any state, for any requested rate and any braking: the cursor stays in the window, the invariant
/// holds again, and the rate is neither against the direction of motion nor beyond what was requested or remembered.
fn stays_on_the_road<const M: usize, const GRAIN: u32>(c: &mut impl Choice, records: u32) -> Option<()> {
    let mut scene = Scene::<M, GRAIN>::any(c, records)?;
    let requested = any_rate::<GRAIN>(c, 0);
    let braked = any_rate::<GRAIN>(c, 0);
    let ahead_window = DirectedWindow { at: scene.at, sign: scene.sign, window: &scene.window };
    let step = scene.cursor.advance(requested, braked, &ahead_window);
    let rate = scene.at.distance_to(step.to).units();
    holds!(if scene.sign < 0 { rate <= 0 } else { rate >= 0 });
    holds!(-ONE - 1 <= rate && rate <= ONE + 1);
    scene.at = step.to;
    holds!(scene.legal(records));
    Some(())
}

/// A jump of the rate at a planned stop, for any requested rate and any braking, preserves the invariant.
fn starts_on_the_road<const M: usize, const GRAIN: u32>(c: &mut impl Choice, records: u32) -> Option<()> {
    let window = ShortWindow {
        low: RecordIndex::new(c.word()),
        records: c.below(records + 1),
        rests: c.below(1 << (records + 1)),
    };
    let sign = if c.flag() { 1 } else { -1 };
    let record = c.below(records + 1);
    c.assume(record <= window.records && window.rests >> record & 1 == 1)?;
    let at = Place::start_of(window.low + record);
    let mut cursor = Cursor::<M>::with_filter(built!(RateFilter::new(built!(FilterLengths::new(1, M as u16)))));
    let (braked, asked) = (any_rate::<GRAIN>(c, 0), any_rate::<GRAIN>(c, 0));
    let rate = cursor.start_from_rest(braked, asked, &DirectedWindow { at, sign, window: &window });
    cover!(c, Forward, sign > 0 && rate > Rate::ZERO);
    cover!(c, Backward, sign < 0 && rate > Rate::ZERO);
    cover!(c, Wrapped, window.high().number() < window.low.number());
    cover!(c, AtEnd, record == if sign > 0 { window.records } else { 0 });
    cover!(c, PlannedStop, window.rests >> record > 1);
    holds!(Rate::ZERO <= rate && rate <= Rate::ONE);
    holds!(Scene::<M, GRAIN> { cursor, window, at, sign }.legal(records));
    Some(())
}

/// With a rate requested and no braking before it is necessary, the cursor comes to rest exactly at the end of the
/// window and never beyond.
fn rests_on_the_end<const M: usize, const GRAIN: u32>(c: &mut impl Choice, records: u32, periods: u32) -> Option<()> {
    let mut scene = Scene::<M, GRAIN>::any(c, records)?;
    let mut k = 0;
    while k < periods {
        let ahead_window = DirectedWindow { at: scene.at, sign: scene.sign, window: &scene.window };
        scene.at = scene.cursor.advance(Rate::ONE, Rate::ONE, &ahead_window).to;
        k += 1;
    }
    let end = if scene.sign > 0 { scene.window.high() } else { scene.window.low };
    holds!(
        scene.at == Place::start_of(end)
            && scene.cursor.filter().at_rest()
            && scene.cursor.filter().lead() == Distance::ZERO
    );
    Some(())
}

/// While some rate is requested, and braking leaves some of it where records remain, the commanded place moves in every
/// period until it is at the end of the window, or the cursor has reached a planned stop further on; the cursor comes
/// to rest at the commanded place (row rate-rest).
fn presses_on<const M: usize, const GRAIN: u32>(c: &mut impl Choice, records: u32) -> Option<()> {
    let mut scene = Scene::<M, GRAIN>::any(c, records)?;
    let before = scene.at.moved(scene.cursor.filter().lead());
    let requested = any_rate::<GRAIN>(c, 1);
    let braked = any_rate::<GRAIN>(c, 1);
    let ahead_window = DirectedWindow { at: scene.at, sign: scene.sign, window: &scene.window };
    let to = scene.cursor.advance(requested, braked, &ahead_window).to;
    let after = to.moved(scene.cursor.filter().lead());
    let end = Place::start_of(if scene.sign > 0 { scene.window.high() } else { scene.window.low });
    let (moved, gone_on) = if scene.sign < 0 {
        (-scene.at.distance_to(to), -before.distance_to(after))
    } else {
        (scene.at.distance_to(to), before.distance_to(after))
    };
    let at_rest = scene.cursor.filter().at_rest();
    let on_a_stop = moved > Distance::ZERO && at_rest && to.fraction == 0 && scene.window.rests_at(to.record);
    cover!(c, Rising, gone_on > Distance::ZERO);
    cover!(c, Accepted, on_a_stop && after != end);
    holds!(after == end || gone_on > Distance::ZERO || on_a_stop);
    Some(())
}

/// A machine whose rate may change by about a hundredth per period.
const SOFT: PulseLimits = PulseLimits { velocity: 100 << 32, acceleration: 3 << 32, jerk: 1 << 32 };

/// Braking on a machine with that axis, the plan using a share of its limits.
fn braking(axis: PulseLimits, share: u16) -> Braking<8> {
    built!(Braking::new(&built!(RateLimits::new(3, share, [axis]))))
}

/// S(u) ≥ u⁻ + S(u⁻) for any rate u up to one, where u⁻ is u less the slope at it: a cursor that may continue at u and
/// brake then may also continue at u⁻ and brake then. Both roundings are in the last bits.
fn braking_covers_a_step_down(c: &mut impl Choice, braking: &Braking<8>) -> Option<()> {
    let rate = any_rate::<16>(c, 0);
    let slope = braking.slope(rate, 16);
    let less = if slope < rate { rate - slope } else { Rate::ZERO };
    cover!(c, AtRest, rate == Rate::ZERO);
    cover!(c, AtEnd, rate > Rate::ZERO && less == Rate::ZERO);
    cover!(c, Falling, less > Rate::ZERO);
    cover!(c, Limited, rate == Rate::ONE);
    holds!(braking.length(rate) + Distance::from_units(2) >= less.over(1) + braking.length(less));
    Some(())
}

/// A rate that braking allows can be braked from again, decreases by no more than the slope from a rate that could be,
/// and is not zero where records remain: for every rate in steps, with the length of its ramp and more remaining.
#[cfg(not(any(kani, verify_wasm)))]
fn braking_keeps_its_promise(size: Size) -> String {
    let (step, mut asked) = (if size.full { ONE >> 12 } else { ONE >> 9 }, 0u64);
    for share in [45_000, 60_000] {
        let limits = RateLimits::new(3, share, [SOFT]).expect("valid");
        let braking = Braking::<32>::new(&limits).expect("fast enough");
        for rate in (0..=ONE).step_by(step as usize).map(Rate::from_units) {
            for spare in (0..=ONE / 4).step_by(step as usize / 4).chain([1, 2, 3, ONE, 3 * ONE]) {
                // remaining length after the period at this rate
                let free = braking.length(rate) + Distance::from_units(spare);
                let now = braking.max_rate_within(Rate::ONE, free);
                let within = Rate::ZERO <= now && now <= Rate::ONE && now.over(1) + braking.length(now) <= free;
                assert!(within, "{now:?} of {free:?}");
                let least = rate - braking.slope(rate, 16) - Rate::from_units(3);
                assert!(now >= least, "{now:?} after {rate:?}, {free:?} left");
                assert!(now > Rate::ZERO || free == Distance::ZERO);
                asked += 1;
            }
        }
    }
    format!("{asked} rates and lengths of path")
}

/// A planned stop costs no period, for any braking to it: a cursor at one with rate one requested, with the next one
/// `records` further and any others between, is a record further after every period, and at rest there again.
fn planned_stops_are_free<const SIGN: i64>(c: &mut impl Choice, records: u32) -> Option<()> {
    let low = RecordIndex::new(c.word());
    let window = ShortWindow { low, records, rests: c.below(1 << (records - 1)) << 1 | 1 | 1 << records };
    let mut cursor = Cursor::<3>::with_filter(built!(RateFilter::new(built!(FilterLengths::new(1, 3)))));
    let mut at = if SIGN > 0 { window.low() } else { window.high() };
    cover!(c, Wrapped, window.high().number() < window.low.number());
    cover!(c, PlannedStop, window.rests & !(1 | 1 << records) != 0);
    let mut k = 0;
    while k < records {
        let next = at + (SIGN as u32);
        let ahead_window = DirectedWindow { at: Place::start_of(at), sign: SIGN, window: &window };
        if cursor.filter().at_rest() && window.rests_at(at) {
            cursor.start_from_rest(any_rate::<0>(c, 0), Rate::ONE, &ahead_window);
        }
        let step = cursor.advance(Rate::ONE, any_rate::<0>(c, 0), &ahead_window);
        holds!(step.to == Place::start_of(next) && !step.starved);
        at = next;
        k += 1;
    }
    holds!(cursor.filter().at_rest());
    Some(())
}

/// The second difference of the emitted pulses: with |q| ≤ V and |Δq| ≤ a for the records crossed, two neighbouring
/// periods of rates r₁ and r₂ differ by at most V·|r₂ − r₁| + a·min(r₁, r₂), and 2 pulses for the rounding of three
/// positions.
fn acceleration_is_bounded<const V: i64, const STEP: i64>(c: &mut impl Choice) -> Option<()> {
    let mut records = [Record::<1>::default(); 3];
    let (mut last, mut n) = (c.between(-V, V), 0);
    while n < 3 {
        records[n].increments[0] = last as i16;
        last += c.between(-STEP, STEP);
        c.assume(-V <= last && last <= V)?;
        n += 1;
    }
    let (first, r1, r2) = (c.upto(u32::MAX), c.between(0, ONE), c.between(0, ONE));
    let a = Place { record: RecordIndex::new(0), fraction: first };
    let (b, d) = (a.moved(Distance::from_units(r1)), a.moved(Distance::from_units(r1 + r2)));
    let pulses = |from, to| emission(from, to, |n| records.get(n.number() as usize)).map(|[sum]| sum);
    let (Some(before), Some(after)) = (pulses(a, b), pulses(b, d)) else { panic!("a record is missing") };
    cover!(c, Rising, r1 < r2 && after > before);
    cover!(c, Falling, r2 < r1 && after < before);
    cover!(c, Backward, after < 0);
    cover!(c, Split, first != 0);
    let change = if r1 < r2 { r2 - r1 } else { r1 - r2 };
    let least = if r1 < r2 { r1 } else { r2 };
    holds!(((after - before).abs() - 2) * ONE <= V * change + STEP * least);
    Some(())
}

harnesses! {
    drive_acceleration, unwind 5, covers [Rising, Falling, Backward, Split] => |c| acceleration_is_bounded::<7, 2>(c);
    drive_road_1, unwind 8, covers [Forward, Backward, Wrapped, AtEnd, AtRest, Split] =>
        |c| stays_on_the_road::<1, 0>(c, 2);
    drive_road_3, unwind 8, covers [Forward, Backward, Wrapped, AtEnd, AtRest, Split, PlannedStop] =>
        |c| stays_on_the_road::<3, 28>(c, 2);
    drive_starts_5, unwind 8, covers [Forward, Backward, Wrapped, AtEnd, PlannedStop] =>
        |c| starts_on_the_road::<5, 28>(c, 2);
    drive_rests_1, unwind 8, covers [Forward, Backward, Wrapped, AtEnd, AtRest, Split] =>
        |c| rests_on_the_end::<1, 28>(c, 2, 3);
    drive_presses_3, unwind 8, covers [
        Forward, Backward, Wrapped, AtEnd, AtRest, Split, PlannedStop, Rising, Accepted,
    ] => |c| presses_on::<3, 28>(c, 2);
    drive_stops_forward, unwind 8, covers [Wrapped, PlannedStop] => |c| planned_stops_are_free::<1>(c, 2);
    drive_stops_backward, unwind 8, covers [Wrapped, PlannedStop] => |c| planned_stops_are_free::<-1>(c, 2);
    braking_covers_soft, unwind 301, covers [AtRest, AtEnd, Falling, Limited] =>
        |c| braking_covers_a_step_down(c, &braking(SOFT, 45_000));
    braking_covers_tight, unwind 301, covers [AtRest, AtEnd, Falling, Limited] =>
        |c| braking_covers_a_step_down(c, &braking(SOFT, 60_000));
}

#[cfg(not(any(kani, verify_wasm)))]
const CURSOR: &str = "crates/core/src/drive/cursor.rs";
#[cfg(not(any(kani, verify_wasm)))]
const BRAKING: &str = "crates/core/src/drive/braking.rs";

#[cfg(not(any(kani, verify_wasm)))]
mod slopes;

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    Row {
        name: "drive-road",
        says: "For any requested rates and any braking, the cursor never leaves the record window, never runs against \
            its direction, and with a rate requested comes to rest exactly at the end of the window, fraction 0",
        requirement: "REV, Beyond the source, *Braking to a place*",
        bound: "one period from any state in windows of up to 2 records with any planned stops, any requested and \
            braked rates in 0 … 1: an average of 1 period to the last bit, of 3 in sixteenths of a record; a jump \
            from a planned stop with one of 5; to rest within 3 periods (1), the commanded place moving in every \
            period (3), in sixteenths",
        assumes: "the cursor's invariant, which a cursor at rest satisfies; the window may grow, and shrinks only \
            behind the commanded place (the card's window refuses anything else)",
        suffices: "one step from every state is an induction; slopes, braking and blending only choose the requested \
            and the braked rate, and all of them are covered; the cursor uses only the end of the window, its last \
            planned stop and its own place",
        harnesses: &["drive_road_1", "drive_road_3", "drive_starts_5", "drive_rests_1", "drive_presses_3"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "a filter that fits is refused",
                file: "crates/core/src/rate.rs",
                find: "if smoothing.first as usize > M || smoothing.second as usize > M {",
                put: "if smoothing.first as usize >= M || smoothing.second as usize > M {",
                killer: "drive_road_1",
            },
            Mutant {
                name: "the commanded place may run over the end",
                file: CURSOR,
                find: "requested.min(braking_limited).min(free.max(Distance::ZERO).per_period())",
                put: "requested.min(braking_limited).min(free.max(Distance::from_units(1)).per_period())",
                killer: "drive_road_1",
            },
            Mutant {
                name: "a planned stop is passed at rate",
                file: CURSOR,
                find: "&& signed(ahead.sign, to.distance_to(rest)) <= Distance::ZERO",
                put: "&& signed(ahead.sign, to.distance_to(rest)) < Distance::ZERO",
                killer: "drive_road_3",
            },
            Mutant {
                name: "a commanded place beyond the end is forgotten when the rate is lowered",
                file: CURSOR,
                find: "if within < requested || free < Distance::ZERO {",
                put: "if within < requested {",
                killer: "drive_road_3",
            },
            Mutant {
                name: "the rate jumps further than the window is long",
                file: CURSOR,
                find: "let rate = if rate.over(periods) <= ahead.distance_to_end()",
                put: "let rate = if rate.over(1) <= ahead.distance_to_end()",
                killer: "drive_starts_5",
            },
            Mutant {
                name: "the stop behind the cursor counts",
                file: "crates/core/src/drive/directed_window.rs",
                find: "if signed(self.sign, self.at.distance_to(here)) <= Distance::ZERO {",
                put: "if signed(self.sign, self.at.distance_to(here)) < Distance::ZERO {",
                killer: "drive_presses_3",
            },
            Mutant {
                name: "the cursor stops a last bit early",
                file: CURSOR,
                find: "let free = ahead.distance_to_end() - self.filter.lead().abs();",
                put: "let free = ahead.distance_to_end() - self.filter.lead().abs() - Distance::from_units(1);",
                killer: "drive_rests_1",
            },
        ],
    },
    Row {
        name: "drive-braking",
        says: "A commanded rate that can be braked before the end of the window can be braked by the slopes that are \
            legal anywhere on the machine, remains so while it follows them, and reaches the end",
        requirement: "REV, Beyond the source, *Braking to a place*",
        bound: "any rate up to 1 in steps of 2⁻¹⁶ for the step down; in steps of 2⁻¹² with the length of its ramp and \
            up to a quarter of a record more for what follows, searched, not proved; on two machines: 69 % and 92 % \
            of the limits used by the plan",
        assumes: "nothing",
        suffices: "the step covers every rate between, as lengths are linear over each interval of the rate, of which \
            there are 8 here and 32 in a drive; machines differ by the table alone, and drawn ones are tested in the \
            core's own tests",
        harnesses: &["braking_covers_soft", "braking_covers_tight"],
        searches: &[Search { name: "braking-keeps", run: braking_keeps_its_promise }],
        models: &[],
        mutants: &[
            Mutant {
                name: "a machine that brakes fast enough is refused",
                file: BRAKING,
                find: "if slope < MIN_SLOPE {",
                put: "if slope < MIN_SLOPE * 4096 {",
                killer: "braking_covers_tight",
            },
            Mutant {
                name: "a step down over the end of a stretch is not covered",
                file: BRAKING,
                find: "self.slopes[(k + 1).min(N - 1)]",
                put: "self.slopes[k.saturating_sub(1)]",
                killer: "braking_covers_tight",
            },
            Mutant {
                name: "the last two periods have no length",
                file: BRAKING,
                find: "if rate <= self.slopes[0] {",
                put: "if rate <= self.slopes[0] * 2 {",
                killer: "braking_covers_soft",
            },
            Mutant {
                name: "more is allowed than can be braked",
                file: BRAKING,
                find: "let over = free - Distance::from_units(1) - self.lengths[k] - start.over(1);",
                put: "let over = free + Distance::from_units(1 << 24) - self.lengths[k] - start.over(1);",
                killer: "braking-keeps",
            },
        ],
    },
    Row {
        name: "drive-slope",
        says: "A change of the commanded rate, times the speed of any record that the cursor reaches while it is in \
            the average, is within the axis' acceleration, or within the slope that is legal anywhere",
        requirement: "REV, Beyond the source, *Rate law*",
        bound: "drawn runs of 3 000 periods over drawn records, averages of 3 to 33 periods",
        assumes: "nothing of the records",
        suffices: "a sample; the limit monitor also checks every period of every run on planned records",
        harnesses: &[],
        searches: &[Search { name: "slopes-leave-room", run: slopes::slopes_leave_room }],
        models: &[],
        mutants: &[
            Mutant {
                name: "half the speed is seen",
                file: "crates/core/src/drive/bounds.rs",
                find: "self.first = self.first.max(over(0, 2).unsigned_abs());",
                put: "self.first = self.first.max(over(0, 1).unsigned_abs());",
                killer: "slopes-leave-room",
            },
            Mutant {
                name: "the survey ends at the commanded place",
                file: "crates/core/src/drive/mod.rs",
                find: "self.lead().abs() + rate.max(self.cursor.filter().max_target()).over((average + 1) / 2)",
                put: "self.lead().abs() + rate.over(0 * average)",
                killer: "slopes-leave-room",
            },
        ],
    },
    Row {
        name: "drive-stops",
        says: "A planned stop costs no period: the cursor runs into it at rate one and leaves it at rate one, in \
            either direction",
        requirement: "REV, Beyond the source, *Braking to a place*",
        bound: "2 records with a planned stop between or none, both directions, any braked rates",
        assumes: "the window ends in a planned stop",
        suffices: "from each planned stop on the drive is in the same state as at the start",
        harnesses: &["drive_stops_forward", "drive_stops_backward"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "every stop is braked to",
                file: CURSOR,
                find: "let last_rest = if within < requested || free < Distance::ZERO { ahead.last_planned_stop() } \
                    else { None };",
                put: "let last_rest = if ahead.sign == 0 { ahead.last_planned_stop() } else { None };",
                killer: "drive_stops_forward",
            },
            Mutant {
                name: "every start follows the law",
                file: CURSOR,
                find: "self.filter.set_steady(signed(ahead.sign, rate));",
                put: "self.filter.set_steady(signed(ahead.sign, rate * 0));",
                killer: "drive_stops_forward",
            },
        ],
    },
    Row {
        name: "drive-acceleration",
        says: "For every record sequence within V pulses a period and steps of a, neighbouring periods at rates r₁, \
            r₂ differ by at most V·|r₂ − r₁| + a·min(r₁, r₂) pulses, and 2 for rounding",
        requirement: "REV, Beyond the source, *Rate law* (velocity and acceleration hold always)",
        bound: "any three records with V = 7 and a = 2, any place on them, any two rates in 0 … 1",
        assumes: "the planner stays within its share: |q| ≤ V and |Δq| ≤ αA on every axis (checked on every run by \
            the limit monitor)",
        suffices: "two periods of |rate| ≤ 1 touch at most three records, and V and a only scale; with the slopes \
            (row drive-slope; core's test that playback stays within acceleration and jerk) it follows that A holds, \
            but for the rounding that the interface allows",
        harnesses: &["drive_acceleration"],
        searches: &[],
        models: &[],
        mutants: &[Mutant {
            name: "a record split at the wrong fraction",
            file: "crates/core/src/playback.rs",
            find: "unsigned_abs() * fraction as u64;",
            put: "unsigned_abs() * (fraction | 1 << 31) as u64;",
            killer: "drive_acceleration",
        }],
    },
];
