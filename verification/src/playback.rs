//! Playback: the position is a function of the place (design, idea 1; REV, *Exactness*).
//!
//! Invariant: records and places are arbitrary; a walk is any three places, because more follow by induction.

use crate::choice::{Choice, ONE};
use crate::harness::{cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search};
use retrace_core::playback::{emission, partial_increment};
use retrace_core::{Distance, Place, Record, RecordIndex};

/// `N` records of one axis, from place 0 or over the wrap.
struct Stretch<const N: usize> {
    first: RecordIndex,
    records: [Record<1>; N],
}

impl<const N: usize> Stretch<N> {
    /// Any records of up to `most` pulses in either direction.
    fn any(c: &mut impl Choice, most: i64) -> Self {
        let first = RecordIndex::new(if c.flag() { 0 } else { u32::MAX });
        let records =
            core::array::from_fn(|_| Record { increments: [c.between(-most, most) as i16], ..Record::default() });
        Self { first, records }
    }

    /// Any sixteenth of it, including its end.
    fn place(&self, c: &mut impl Choice) -> Place {
        let (record, fraction) = (c.below(N as u32), c.below(16) << 28);
        let end = c.flag();
        Place::start_of(self.first).moved(if end {
            Distance::records(N as i64)
        } else {
            Distance::from_units(i64::from(record) << 32 | i64::from(fraction))
        })
    }

    fn emission(&self, from: Place, to: Place) -> Option<i64> {
        let records = &self.records;
        emission(from, to, |n| records.get(n.since(self.first) as usize)).map(|[sum]| sum)
    }
}

/// A place moved forward and back is the same place; distances add up.
fn places_add_up(c: &mut impl Choice) -> Option<()> {
    let from = Place { record: RecordIndex::new(c.word()), fraction: c.word() };
    let most = (1i64 << 62) - 1;
    let (a, b) = (c.between(-most, most), c.between(-most, most));
    c.assume(-most <= a + b && a + b <= most)?;
    let (a, b) = (Distance::from_units(a), Distance::from_units(b));
    let to = from.moved(a);
    cover!(c, Forward, a > Distance::ZERO);
    cover!(c, Backward, a < Distance::ZERO);
    cover!(c, Wrapped, a > Distance::ZERO && to.record.number() < from.record.number());
    holds!(from.distance_to(to) == a && to.moved(-a) == from);
    holds!(to.moved(b) == from.moved(a + b));
    Some(())
}

/// A step of |rate| ≤ 1 contains at most one record boundary, and one of |rate| ≤ cap at most ⌈cap⌉.
fn crosses_few_boundaries(c: &mut impl Choice) -> Option<()> {
    let from = Place { record: RecordIndex::new(c.word()), fraction: c.word() };
    let cap = 1 + c.below(8);
    let step = c.between(-8 * ONE, 8 * ONE);
    c.assume(step.abs() <= i64::from(cap) << 32)?;
    let to = from.moved(Distance::from_units(step));
    cover!(c, AtRest, step == 0);
    cover!(c, Limited, step == i64::from(cap) << 32);
    cover!(c, Backward, step < 0);
    cover!(c, Wrapped, step > 0 && to.record.number() < from.record.number());
    let ahead = to.boundary_ahead().since(from.boundary_ahead()) as i32;
    holds!(ahead.unsigned_abs() <= cap);
    holds!((to.record.since(from.record) as i32).unsigned_abs() <= cap);
    Some(())
}

/// Motion from a to b and on to c emits what direct motion from a to c emits, and nothing in total after the return.
fn sums_telescope<const N: usize>(c: &mut impl Choice) -> Option<()> {
    let stretch = Stretch::<N>::any(c, 3);
    let (a, b, d) = (stretch.place(c), stretch.place(c), stretch.place(c));
    let (Some(first), Some(second), Some(whole)) =
        (stretch.emission(a, b), stretch.emission(b, d), stretch.emission(a, d))
    else {
        panic!("a record of the stretch is missing")
    };
    cover!(c, AtRest, a == b && b == d);
    cover!(c, Forward, whole > 0);
    cover!(c, Backward, whole < 0);
    cover!(c, Split, a.fraction != 0 && d.fraction != 0);
    cover!(c, Wrapped, d.record.number() < a.record.number() && a.distance_to(d) > Distance::ZERO);
    holds!(first + second == whole);
    holds!(a != d || whole == 0);
    Some(())
}

/// Motion over whole records emits these records.
fn whole_records_are_whole<const N: usize>(c: &mut impl Choice) -> Option<()> {
    let stretch = Stretch::<N>::any(c, i64::from(i16::MAX));
    let (from, records) = (c.below(N as u32), c.below(N as u32 + 1));
    c.assume(from + records <= N as u32)?;
    let place = |n: u32| Place::start_of(stretch.first + n);
    cover!(c, Empty, records == 0);
    cover!(c, Full, records == N as u32);
    cover!(c, Wrapped, records > 0 && stretch.first.number() != 0);
    let (mut sum, mut n) = (0, 0);
    while n < N {
        if from as usize <= n && n < (from + records) as usize {
            sum += i64::from(stretch.records[n].increments[0]);
        }
        n += 1;
    }
    holds!(stretch.emission(place(from), place(from + records)) == Some(sum));
    holds!(stretch.emission(place(from + records), place(from)) == Some(-sum));
    Some(())
}

/// The part of a record is its exact value rounded half away from zero, with the sign of the record.
fn part_is_rounded(c: &mut impl Choice, increment: i16, fraction: u32) -> Option<()> {
    let part = i64::from(partial_increment(increment, fraction));
    cover!(c, AtRest, part == 0 && increment != 0 && fraction != 0);
    cover!(c, Forward, part > 0);
    cover!(c, Backward, part < 0);
    cover!(c, Split, part > 0 && part < i64::from(increment));
    holds!(if increment < 0 { part <= 0 } else { part >= 0 });
    // in units of 2⁻³² pulses; the exact value is in [part − ½, part + ½)
    let (rounded, exact) = ((part.unsigned_abs()) << 32, u64::from(increment.unsigned_abs()) * u64::from(fraction));
    holds!(rounded <= exact + (1 << 31) && exact < rounded + (1 << 31));
    Some(())
}

/// The part of a record is never more than the record.
fn part_is_within(c: &mut impl Choice, most: i64) -> Option<()> {
    let (increment, fraction) = (c.between(-most, most) as i16, c.word());
    let (part, whole) = (i64::from(partial_increment(increment, fraction)), i64::from(increment));
    cover!(c, Full, whole != 0 && part == whole);
    cover!(c, Backward, part < 0);
    cover!(c, Split, 0 < part && part < whole);
    holds!(if whole < 0 { whole <= part } else { part <= whole });
    Some(())
}

/// The parts of a record never run backward: a larger fraction has at least as many pulses.
fn parts_are_in_order(c: &mut impl Choice, most: i64) -> Option<()> {
    let (increment, more) = (c.between(-most, most) as i16, c.word());
    let less = c.upto(more);
    let (less, more) = (partial_increment(increment, less), partial_increment(increment, more));
    cover!(c, AtRest, increment != 0 && less == more);
    cover!(c, Rising, less < more);
    cover!(c, Falling, more < less);
    holds!(if increment < 0 { more <= less } else { less <= more });
    Some(())
}

harnesses! {
    place_sums, unwind 2, covers [Forward, Backward, Wrapped] => |c| places_add_up(c);
    place_boundaries, unwind 2, covers [AtRest, Limited, Backward, Wrapped] => |c| crosses_few_boundaries(c);
    playback_telescopes, unwind 5, covers [AtRest, Forward, Backward, Split, Wrapped] => |c| sums_telescope::<2>(c);
    playback_whole, unwind 6, covers [Empty, Full, Wrapped] => |c| whole_records_are_whole::<3>(c);
    playback_part, unwind 2, covers [AtRest, Forward, Backward, Split] => |c| {
        let (increment, fraction) = (c.between(-63, 63) as i16, c.word());
        part_is_rounded(c, increment, fraction)
    };
    playback_within, unwind 2, covers [Full, Backward, Split] => |c| part_is_within(c, 7);
    playback_order, unwind 2, covers [AtRest, Rising, Falling] => |c| parts_are_in_order(c, 7);
}

/// Every increment at fractions around every half of a pulse, in exact numbers.
#[cfg(not(any(kani, verify_wasm)))]
fn every_increment(size: crate::ledger::Size) -> String {
    let mut draw = crate::native::Draw::new(size.seed);
    let rounds = if size.full { 400 } else { 20 };
    let mut reached = crate::native::Draw::new(size.seed);
    for increment in i16::MIN..=i16::MAX {
        for _ in 0..rounds {
            let fraction = draw.word();
            let least = u64::from(increment.unsigned_abs()).max(1);
            // the fraction just below and at a place where the rounding changes
            let turn = ((u64::from(fraction) % least * 2 + 1) << 31).div_ceil(least) as u32;
            for fraction in [fraction, turn, turn.wrapping_sub(1)] {
                assert!(part_is_rounded(&mut reached, increment, fraction).is_some());
                assert!(i32::from(increment).abs() >= partial_increment(increment, fraction).abs());
            }
        }
    }
    format!("every i16 increment at {} fractions each, around the turns of the rounding too", 3 * rounds)
}

/// Long walks: any rates over the longest possible history, compared with sums in 128 bits.
#[cfg(not(any(kani, verify_wasm)))]
fn max_history(size: crate::ledger::Size) -> String {
    let extreme: [Record<1>; 2] = [i16::MIN, i16::MAX].map(|n| Record { increments: [n], ..Record::default() });
    let records = if size.full { 1 << 30 } else { 1 << 24 };
    for (which, record) in extreme.iter().enumerate() {
        let start = Place::start_of(RecordIndex::new(u32::MAX - 7));
        let (from, to) = (start, start.moved(Distance::records(records)));
        let want = i128::from(record.increments[0]) * i128::from(records);
        let forward = emission(from, to, |_| Some(record)).expect("every record is there")[0];
        let backward = emission(to, from, |_| Some(&extreme[which])).expect("every record is there")[0];
        assert_eq!((i128::from(forward), i128::from(backward)), (want, -want));
    }
    format!("{records} records of ±32 767, forward and back")
}

#[cfg(not(any(kani, verify_wasm)))]
const PLAYBACK: &str = "crates/core/src/playback.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    Row {
        name: "playback-places",
        says: "Places moved forward and back are the same, distances add up over the wrap, and a period passes at \
            most one record boundary at |rate| ≤ 1 and at most ⌈cap⌉ in rapid retrace",
        requirement: "REV, Beyond the source, *Exactness* and *Rapid retrace*",
        bound: "none: any place, any distance below 2³⁰ records",
        assumes: "places on one path are less than 2³¹ records apart (a ring has at most 2³⁰ cells)",
        suffices: "nothing is bounded",
        harnesses: &["place_sums", "place_boundaries"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "the carry of the fraction is lost",
                file: "crates/core/src/place.rs",
                find: "self.record.0.wrapping_add((sum >> 32) as u32)",
                put: "self.record.0.wrapping_add((distance.units() >> 32) as u32)",
                killer: "place_sums",
            },
            Mutant {
                name: "the boundary ahead is one too far",
                file: "crates/core/src/place.rs",
                find: "RecordIndex(self.record.0.wrapping_add(1))",
                put: "RecordIndex(self.record.0.wrapping_add(2))",
                killer: "place_boundaries",
            },
        ],
    },
    Row {
        name: "playback-sums",
        says: "A period emits P(x′) − P(x): the sums of any walk telescope, a cursor that returns to a place has \
            emitted zero in total, and the sum over a record is the record",
        requirement: "REV, Beyond the source, *Exactness*",
        bound: "any three places on 2 records of up to 3 pulses, in sixteenths; any i16 increments for whole records, \
            on 3; from place 0 and over the wrap",
        assumes: "the records between the places exist; where one is missing nothing is emitted (row drive-road)",
        suffices: "a walk of more places is a sum of such triples; emission adds parts and records, whatever their \
            size, one by one and each axis by itself",
        harnesses: &["playback_telescopes", "playback_whole"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "the part at the beginning is not taken off",
                file: PLAYBACK,
                find: "within(from, -1, &mut sum)?;",
                put: "within(from, if from.record == to.record { -1 } else { 0 }, &mut sum)?;",
                killer: "playback_telescopes",
            },
            Mutant {
                name: "a record is left out on the way back",
                file: PLAYBACK,
                find: "} else { (to.record, -1) };",
                put: "} else { (to.record + 1, -1) };",
                killer: "playback_whole",
            },
        ],
    },
    Row {
        name: "playback-parts",
        says: "The part of a record is rounded half away from zero, never more than the record, and grows with the \
            fraction; nothing overflows for any increments over any history",
        requirement: "REV, Beyond the source, *Exactness*",
        bound: "rounding up to 63 pulses at any fraction; order, and no more than the record, up to 7 pulses at any \
            fraction; natively every increment around the turns of its rounding; the longest history is run",
        assumes: "a history has at most 2³⁰ records",
        suffices: "a part is one product, one sum and one shift, in 64 bits, where 2¹⁵·2³² + 2³¹ fits; 2³⁰ records of \
            2¹⁵ pulses are 2⁴⁵",
        harnesses: &["playback_part", "playback_within", "playback_order"],
        searches: &[
            Search { name: "playback-every", run: every_increment },
            Search { name: "playback-longest", run: max_history },
        ],
        models: &[],
        mutants: &[
            Mutant {
                name: "the part grows and falls",
                file: PLAYBACK,
                find: "let rounded = ((product + (1 << 31)) >> 32) as i32;",
                put: "let rounded = (((product + (1 << 31)) >> 32) ^ ((product >> 33) & 1)) as i32;",
                killer: "playback_order",
            },
            Mutant {
                name: "halves are cut off",
                file: PLAYBACK,
                find: "((product + (1 << 31)) >> 32) as i32",
                put: "(product >> 32) as i32",
                killer: "playback_part",
            },
            Mutant {
                name: "large increments are cut off",
                file: PLAYBACK,
                find: "(increment as i64).unsigned_abs()",
                put: "(increment as i64 & 0x1F).unsigned_abs()",
                killer: "playback_part",
            },
            Mutant {
                name: "sums of 32 bits",
                file: PLAYBACK,
                find: "*s += sign * i64::from(i);",
                put: "*s = (*s as i32).wrapping_add((sign * i64::from(i)) as i32) as i64;",
                killer: "playback-longest",
            },
        ],
    },
];
