//! The drive: the cursor on the road, and playback's second difference (REV, *Rate law* and *Braking to a place*).
//!
//! Invariant: a state is any that the drive's own invariant allows: the commanded place is on the road, or a planned stop lies
//! between the cursor and its end.

use crate::choice::Choice;
use crate::harness::{harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row};
use retrace_core::drive::{Drive, Road};
use retrace_core::playback::emission;
use retrace_core::rate::{RateLaw, Smoothing};
use retrace_core::{ONE, Place, RapidCap, Record, Travel};

/// Most boundaries of a modelled road.
const BOUNDARIES: u32 = 6;

/// A short road: bit n of `rests` says that the path is at rest at the n-th boundary.
#[derive(Clone, Copy, Debug)]
struct Short {
    low: u32,
    records: u32,
    rests: u32,
}

impl Road for Short {
    fn low(&self) -> u32 {
        self.low
    }
    fn high(&self) -> u32 {
        self.low.wrapping_add(self.records)
    }
    fn rests_at(&self, place: u32) -> bool {
        let n = place.wrapping_sub(self.low);
        n < BOUNDARIES && self.rests >> n & 1 == 1
    }
    fn cap(&self, _: u32) -> RapidCap {
        RapidCap::PLANNED
    }
}

/// Where the drive may be: a road, a place on it, the way it runs, and the law's state.
///
/// Rates and places are multiples of `GRAIN`: the last bit, or a sixteenth of a record.
struct Scene<const M: usize, const GRAIN: u32> {
    drive: Drive<M>,
    road: Short,
    at: Place,
    sign: Travel,
}

impl<const M: usize, const GRAIN: u32> Scene<M, GRAIN> {
    /// Any state with two averages of `M` periods that the invariant allows, on a road of up to `records`.
    fn any<const PERIODS: usize>(c: &mut impl Choice, records: u32) -> Option<Self> {
        let sign = if c.flag() { 1 } else { -1 };
        let mut law = RateLaw::new(Smoothing::new(M as u16, M as u16)?)?;
        let mut k = 0;
        while k < PERIODS {
            let target = c.between(0, ONE >> GRAIN) << GRAIN;
            law.step(if sign < 0 { -target } else { target });
            k += 1;
        }
        let road = Short { low: c.word(), records: c.below(records + 1), rests: c.below(1 << (records + 1)) };
        let (record, fraction) = (c.below(records + 1), c.upto(u32::MAX >> GRAIN) << GRAIN);
        c.assume(record < road.records || record == road.records && fraction == 0)?;
        let at = Place { record: road.low.wrapping_add(record), fraction };
        let scene = Self { drive: Drive::with_law(law), road, at, sign };
        c.assume(scene.legal(records))?;
        Some(scene)
    }

    /// The drive's invariant, written anew: distances in plain numbers from the road's beginning.
    fn legal(&self, records: u32) -> bool {
        let at = Place::start_of(self.road.low).to(self.at);
        let end = Travel::from(self.road.records) << 32;
        let commanded = at + self.drive.lead();
        let mut stop_ahead = false;
        let mut n = 0;
        while n <= records {
            let stop = Travel::from(n) << 32;
            let ahead = if self.sign > 0 { at < stop && stop <= end } else { stop < at };
            stop_ahead |= ahead && n <= self.road.records && self.road.rests >> n & 1 == 1;
            n += 1;
        }
        0 <= at && at <= end && (0 <= commanded && commanded <= end || stop_ahead)
    }
}

/// One period from any state toward any rate: the cursor stays on the road, the invariant holds again, and the rate is neither
/// against the way it runs nor beyond what was asked or remembered.
fn stays_on_the_road<const M: usize, const PERIODS: usize, const GRAIN: u32>(
    c: &mut impl Choice,
    records: u32,
) -> Option<()> {
    let mut scene = Scene::<M, GRAIN>::any::<PERIODS>(c, records)?;
    let standing = scene.drive.at_rest();
    let target = c.between(-ONE >> GRAIN, ONE >> GRAIN) << GRAIN;
    let step = scene.drive.step(scene.at, target, &scene.road);
    let rate = scene.at.to(step.to);
    if standing && !scene.drive.at_rest() || rate != 0 {
        // from rest the way is the target's
        let way = if standing { target.signum() } else { scene.sign };
        holds!(if way < 0 { rate <= 0 } else { rate >= 0 });
        scene.sign = way;
    }
    holds!(-ONE - 1 <= rate && rate <= ONE + 1);
    scene.at = step.to;
    holds!(scene.legal(records));
    Some(())
}

/// With a target held, the cursor comes to rest exactly on the end of the road and never beyond.
fn rests_on_the_end<const M: usize, const PERIODS: usize, const GRAIN: u32>(
    c: &mut impl Choice,
    records: u32,
    periods: u32,
) -> Option<()> {
    let mut scene = Scene::<M, GRAIN>::any::<PERIODS>(c, records)?;
    let mut k = 0;
    while k < periods {
        scene.at = scene.drive.step(scene.at, if scene.sign < 0 { -ONE } else { ONE }, &scene.road).to;
        k += 1;
    }
    let end = if scene.sign > 0 { scene.road.high() } else { scene.road.low };
    holds!(scene.at == Place::start_of(end) && scene.drive.at_rest() && scene.drive.lead() == 0);
    Some(())
}

/// With a target held the commanded place goes on in every period until it stands on the end of the road, or the cursor has come to a
/// planned stop further on; the cursor rests where the commanded place stands (row rate-rest).
fn presses_on<const M: usize, const PERIODS: usize, const GRAIN: u32>(c: &mut impl Choice, records: u32) -> Option<()> {
    let mut scene = Scene::<M, GRAIN>::any::<PERIODS>(c, records)?;
    let before = scene.at.moved(scene.drive.lead());
    let to = scene.drive.step(scene.at, if scene.sign < 0 { -ONE } else { ONE }, &scene.road).to;
    let after = to.moved(scene.drive.lead());
    let end = Place::start_of(if scene.sign > 0 { scene.road.high() } else { scene.road.low });
    let (moved, gone_on) =
        if scene.sign < 0 { (-scene.at.to(to), -before.to(after)) } else { (scene.at.to(to), before.to(after)) };
    let on_a_stop = moved > 0 && scene.drive.at_rest() && to.fraction == 0 && scene.road.rests_at(to.record);
    holds!(after == end || gone_on > 0 || on_a_stop);
    Some(())
}

/// A planned stop costs no period: whoever stands on one and asks for rate one, with the next one `records` further and any others
/// between, is a record further after every period, and stands there again.
fn planned_stops_are_free<const SIGN: Travel>(c: &mut impl Choice, records: u32) -> Option<()> {
    let low = c.word();
    let road = Short { low, records, rests: c.below(1 << (records - 1)) << 1 | 1 | 1 << records };
    let mut drive = Drive::<2>::new(Smoothing::new(2, 2)?)?;
    let mut at = if SIGN > 0 { road.low() } else { road.high() };
    let mut k = 0;
    while k < records {
        let next = at.wrapping_add(SIGN as u32);
        let step = drive.step(Place::start_of(at), SIGN * ONE, &road);
        holds!(step.to == Place::start_of(next) && !step.short);
        at = next;
        k += 1;
    }
    holds!(drive.at_rest());
    Some(())
}

/// The second difference of what is emitted: with |q| ≤ V and |Δq| ≤ a for the records crossed, two neighbouring periods of rates r₁
/// and r₂ differ by at most V·|r₂ − r₁| + a·min(r₁, r₂), and 2 pulses for the rounding of three positions.
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
    let a = Place { record: 0, fraction: first };
    let (b, d) = (a.moved(r1), a.moved(r1 + r2));
    let pulses = |from, to| emission(from, to, |n| records.get(n as usize)).map(|[sum]| sum);
    let (Some(before), Some(after)) = (pulses(a, b), pulses(b, d)) else { panic!("a record is missing") };
    let change = if r1 < r2 { r2 - r1 } else { r1 - r2 };
    let least = if r1 < r2 { r1 } else { r2 };
    holds!(((after - before).abs() - 2) * ONE <= V * change + STEP * least);
    Some(())
}

harnesses! {
    drive_acceleration, unwind 4 => |c| acceleration_is_bounded::<7, 2>(c);
    [without kani]
    drive_road_1_1, unwind 7 => |c| stays_on_the_road::<1, 1, 0>(c, 2);
    drive_road_2_2, unwind 7 => |c| stays_on_the_road::<2, 3, 28>(c, 2);
    drive_rests_1_1, unwind 7 => |c| rests_on_the_end::<1, 1, 28>(c, 2, 3);
    drive_presses_2_2, unwind 7 => |c| presses_on::<2, 3, 28>(c, 2);
    drive_stops_forward, unwind 7 => |c| planned_stops_are_free::<1>(c, 2);
    drive_stops_backward, unwind 7 => |c| planned_stops_are_free::<-1>(c, 2);
}

#[cfg(not(any(kani, verify_wasm)))]
const DRIVE: &str = "crates/core/src/drive.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    Row {
        name: "drive-road",
        says: "Whatever is asked when, the cursor never leaves the road, never runs against its way, and with a target held comes to rest exactly on the road's end, fraction 0",
        requirement: "REV, Beyond the source, *Braking to a place*",
        bound: "one period from any state on roads of up to 2 records with any planned stops, any target in −1 … 1: averages of 1+1 periods to the last bit, 2+2 in sixteenths of a record; to rest within 3 periods (1+1), the commanded place going on in every period (2+2), in sixteenths",
        assumes: "the drive's invariant, which a drive at rest satisfies; the road may grow, and shrinks only behind the commanded place (the card's window refuses anything else)",
        suffices: "one step from every state is an induction; the drive looks at the road only through its end, its last planned stop and the place it is at",
        harnesses: &["drive_road_1_1", "drive_road_2_2", "drive_rests_1_1", "drive_presses_2_2"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "the commanded place waits at a boundary",
                file: DRIVE,
                find: "(ONE, passed) if way.sign > 0 => ONE - Travel::from(passed),",
                put: "(ONE, passed) if way.sign > 0 => (ONE >> 1) - Travel::from(passed >> 1 << 1).min(ONE >> 1),",
                killer: "drive_presses_2_2",
            },
            Mutant {
                name: "the commanded place may run over the end",
                file: DRIVE,
                find: "asked.min(free.max(0))",
                put: "asked.min(free.max(1))",
                killer: "drive_road_1_1",
            },
            Mutant {
                name: "a planned stop is passed at rate",
                file: DRIVE,
                find: "&& along(sign, to.to(rest)) <= 0",
                put: "&& along(sign, to.to(rest)) < 0",
                killer: "drive_road_2_2",
            },
            Mutant {
                name: "the stop behind the cursor counts",
                file: DRIVE,
                find: "if along(self.sign, self.at.to(here)) <= 0 {",
                put: "if along(self.sign, self.at.to(here)) < 0 {",
                killer: "drive_presses_2_2",
            },
            Mutant {
                name: "the cursor stops a last bit early",
                file: DRIVE,
                find: "let free = room - self.law.lead().abs();",
                put: "let free = room - self.law.lead().abs() - 1;",
                killer: "drive_rests_1_1",
            },
        ],
    },
    Row {
        name: "drive-stops",
        says: "A planned stop costs no period: the cursor runs into it at rate one and goes on from it at rate one, either way",
        requirement: "REV, Beyond the source, *Braking to a place*",
        bound: "2 records with a planned stop between or none, both ways",
        assumes: "the road ends in a planned stop",
        suffices: "from each planned stop on the drive is in the same state as at the start",
        harnesses: &["drive_stops_forward", "drive_stops_backward"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "every stop is braked to",
                file: DRIVE,
                find: "let last_rest = if asked > free { way.last_rest() } else { None };",
                put: "let last_rest = if asked > free && way.sign == 0 { way.last_rest() } else { None };",
                killer: "drive_stops_forward",
            },
            Mutant {
                name: "every start follows the law",
                file: DRIVE,
                find: "self.law.set_steady(along(way.sign, rate));",
                put: "self.law.set_steady(along(way.sign, rate) * 0);",
                killer: "drive_stops_forward",
            },
        ],
    },
    Row {
        name: "drive-acceleration",
        says: "For every record sequence within V pulses a period and steps of a, neighbouring periods at rates r₁, r₂ differ by at most V·|r₂ − r₁| + a·min(r₁, r₂) pulses, and 2 for rounding",
        requirement: "REV, Beyond the source, *Rate law* (velocity and acceleration hold always)",
        bound: "any three records with V = 7 and a = 2, any place on them, any two rates in 0 … 1",
        assumes: "the planner keeps its share: |q| ≤ V and |Δq| ≤ αA on every axis (checked on every run by the judge)",
        suffices: "two periods of |rate| ≤ 1 touch at most three records, and V and a only scale; with row rate-change and the controller's choice of lengths it follows that A holds, but for the rounding that the interface allows",
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
