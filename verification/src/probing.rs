//! Probing: what the latch keeps, and the path that a probing move leaves (PRB-1, PRB-2, PRB-6).
//!
//! Invariant: the latch is compared with what was seen in its periods, kept here beside it.

use crate::choice::Choice;
use crate::harness::{built, cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row};
use retrace_card::{ProbeDrive, ProbeReading};
use retrace_core::playback::{emission, executed_increments};
use retrace_core::{Distance, Place, Record, RecordIndex};
use retrace_link::{ProbeArming, ProbeLatch, counts_at_edge};

/// The touch is between the counts at both ends of its period, whatever the increment and the part of the period, and
/// is the count at its end.
fn the_touch_is_in_its_period(c: &mut impl Choice) -> Option<()> {
    let most = i64::from(u16::MAX);
    let (count, increment) = (c.between(-(1 << 61), 1 << 61), c.between(-most, most));
    let at = |part: u16| counts_at_edge(&[count], &[increment as i32], part)[0];
    let (touch, before) = (at(c.upto(u32::from(u16::MAX)) as u16), count - increment);
    cover!(c, Forward, before < touch && touch < count);
    cover!(c, Backward, count < touch && touch < before);
    cover!(c, AtRest, increment == 0);
    let (low, high) = if increment < 0 { (count, before) } else { (before, count) };
    holds!(low <= touch && touch <= high);
    holds!(at(u16::MAX) == count);
    Some(())
}

/// The touch of a later edge in the same period is not before that of an earlier one.
fn touches_are_in_order(c: &mut impl Choice, most: i64) -> Option<()> {
    let (increment, part) = (c.between(-most, most), c.upto(u32::from(u16::MAX)));
    let earlier = c.upto(part);
    let at = |part: u32| counts_at_edge(&[0], &[increment as i32], part as u16)[0];
    let (first, second) = (at(earlier), at(part));
    cover!(c, Forward, first < second);
    cover!(c, Backward, second < first);
    cover!(c, AtRest, first == second && earlier < part);
    holds!(if increment < 0 { second <= first } else { first <= second });
    Some(())
}

/// Level and first change, and the pulses of one period. The pins may be the period before.
struct Seen {
    has_level: bool,
    change: Option<u16>,
    is_period_behind: bool,
    increment: i32,
}

impl Seen {
    fn any(c: &mut impl Choice) -> Self {
        let (has_level, is_captured) = (c.flag(), c.flag());
        let part = c.word() as u16;
        let (is_period_behind, increment) = (c.flag(), c.between(-7, 7) as i32);
        Self { has_level, change: is_captured.then_some(part), is_period_behind, increment }
    }

    fn edge(&self) -> bool {
        self.has_level || self.change.is_some()
    }
}

/// Only the first edge counts: it is kept until the level has stayed for the filter, or has been away for as long; what
/// was touched stays, whatever comes.
fn the_first_edge_counts<const PERIODS: u32>(c: &mut impl Choice) -> Option<()> {
    let (input, active, filter) = (c.below(16), c.flag(), c.below(3));
    let mut drive = ProbeDrive::<1>::new();
    let mut kept = None;
    let (mut with, mut without) = (0, 0);
    // count at its end and pulses of the last period, and of the one before
    let mut last = (0, 0);
    drive.arm(ProbeArming { input: input as u8, active, filter_periods: filter as u16 });
    let mut period = 0;
    while period < PERIODS {
        let before = drive.latch();
        let seen = Seen::any(c);
        let inputs = if seen.has_level == active { 1 << input } else { 0 };
        let reading = ProbeReading { first_change: seen.change, is_period_behind: seen.is_period_behind };
        let earlier = last;
        last = (earlier.0 + i64::from(seen.increment), seen.increment);
        drive.observe(inputs, reading, &[last.0], &[last.1]);
        let latch = drive.latch();
        if before == ProbeLatch::Armed && seen.edge() {
            let (count, increment) = if seen.is_period_behind { earlier } else { last };
            kept = Some(counts_at_edge(&[count], &[increment], seen.change.unwrap_or(u16::MAX)));
            (with, without) = (0, 0);
        }
        (with, without) = if seen.has_level { (with + 1, 0) } else { (0, without + 1) };
        match (before, latch) {
            (ProbeLatch::Idle, _) | (_, ProbeLatch::Idle) => holds!(false),
            (ProbeLatch::Touched(was), is) => holds!(is == ProbeLatch::Touched(was)),
            (ProbeLatch::Armed, ProbeLatch::Armed) => holds!(!seen.edge()),
            (ProbeLatch::Edge(_), ProbeLatch::Armed) => holds!(without > filter && filter > 0),
            (_, ProbeLatch::Edge(touch)) => holds!(kept == Some(touch) && with <= filter && without <= filter),
            (_, ProbeLatch::Touched(touch)) => holds!(kept == Some(touch) && (filter == 0 || with > filter)),
        }
        cover!(c, Held, matches!(latch, ProbeLatch::Edge(_)));
        cover!(c, Accepted, filter > 0 && matches!(latch, ProbeLatch::Touched(_)));
        cover!(c, Lost, matches!(before, ProbeLatch::Edge(_)) && latch == ProbeLatch::Armed);
        period += 1;
    }
    Some(())
}

/// A probing move becomes records of what was emitted in each of its periods: behind each of them, the sum of these
/// records is where the planned records had the machine, so that nothing that was executed changes when the rest is
/// cut off; and retraced, they return.
fn the_executed_path_is_the_planned_one<const PERIODS: usize>(c: &mut impl Choice) -> Option<()> {
    let first = RecordIndex::new(if c.flag() { 0 } else { u32::MAX });
    let planned: [Record<1>; 2] =
        core::array::from_fn(|_| Record { increments: [c.between(-3, 3) as i16], ..Record::default() });
    let record = |n: RecordIndex| planned.get(n.since(first) as usize);
    let start = Place::start_of(first);
    let (mut place, mut sum, mut period) = (start, 0, 0);
    let mut executed = [0; PERIODS];
    while period < PERIODS {
        let distance = Distance::from_units(c.between(0, 16) << 28);
        c.assume(start.distance_to(place) + distance <= Distance::records(2))?;
        let to = place.moved(distance);
        let [increment] = built!(executed_increments(place, to, record));
        executed[period] = increment;
        sum += i64::from(increment);
        place = to;
        holds!(emission(start, place, record) == Some([sum]));
        cover!(c, Split, place.fraction != 0 && increment != 0);
        cover!(c, Wrapped, place.record.number() == 0 && first.number() != 0);
        cover!(c, AtRest, distance == Distance::ZERO);
        period += 1;
    }
    cover!(c, AtEnd, start.distance_to(place) == Distance::records(2));
    let path = executed.map(|increment| Record::<1> { increments: [increment], ..Record::default() });
    let of = |n: RecordIndex| path.get(n.since(first) as usize);
    let end = start.moved(Distance::records(PERIODS as i64));
    holds!(emission(start, end, of) == Some([sum]) && emission(end, start, of) == Some([-sum]));
    Some(())
}

harnesses! {
    latch_touch, unwind 2, covers [Forward, Backward, AtRest] => |c| the_touch_is_in_its_period(c);
    latch_order, unwind 2, covers [Forward, Backward, AtRest] => |c| touches_are_in_order(c, 7);
    latch_first_edge, unwind 6, covers [Held, Accepted, Lost] => |c| the_first_edge_counts::<5>(c);
    ask_path, unwind 5, covers [Split, Wrapped, AtRest, AtEnd] =>
        |c| the_executed_path_is_the_planned_one::<3>(c);
}

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    Row {
        name: "latch",
        says: "A touch lies between the counts at both ends of its control period, for every increment and part of the \
            period; only the first edge counts, until the level has stayed or been away for the filter, and what was \
            touched stays",
        requirement: "PRB-1, PRB-2, SPN-26",
        bound: "any count within ±2⁶¹, any increment of ±65 535, any part; their order for \
            increments of up to 7 pulses and any two parts; five periods of any levels, captured \
            changes and increments of up to 7 pulses, with the pins at the counts or a period behind, any input, \
            either level awaited, filters of up to 2 periods",
        assumes: "nothing",
        suffices: "a period depends on the latch, the counters of the filter and what is seen alone, and five periods \
            reach an edge that is dropped and one that is kept",
        harnesses: &["latch_touch", "latch_order", "latch_first_edge"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "the touch is on the other side of the count",
                file: "crates/link/src/probe.rs",
                find: "*count -= if increment < 0 { -missing } else { missing };",
                put: "*count += if increment < 0 { -missing } else { missing };",
                killer: "latch_touch",
            },
            Mutant {
                name: "the pulses of the period after the edge",
                file: "crates/link/src/probe.rs",
                find: "counts_at_edge(&before, earlier, self.part)",
                put: "counts_at_edge(&before, increments, self.part)",
                killer: "latch_first_edge",
            },
            Mutant {
                name: "the last edge counts",
                file: "crates/card/src/probe_drive.rs",
                find: "if let State::Armed { earlier } = &mut self.state {",
                put: "if let State::Armed { .. } | State::Edge(_) = self.state { let earlier = &mut [0; A];",
                killer: "latch_first_edge",
            },
            Mutant {
                name: "the level stays a period less",
                file: "crates/card/src/probe_drive.rs",
                find: "if filter_periods == 0 || self.with_level > filter_periods {",
                put: "if filter_periods == 0 || self.with_level >= filter_periods {",
                killer: "latch_first_edge",
            },
            Mutant {
                name: "a bounce is counted as the level",
                file: "crates/card/src/probe_drive.rs",
                find: "(self.with_level, self.without_level) = (0, self.without_level.saturating_add(1));",
                put: "self.without_level = self.without_level.saturating_add(1);",
                killer: "latch_first_edge",
            },
        ],
    },
    Row {
        name: "ask-path",
        says: "A probing move becomes records of what was emitted in each of its periods: behind each of them their \
            sum is the position of the planned path at the place reached, and retraced they return",
        requirement: "PRB-6, PRB-15, SPN-26",
        bound: "three periods of any sixteenths of a record over two records of up to 3 pulses, from place 0 \
            and over the wrap",
        assumes: "an axis has no more pulses in a period than a record holds; else the answer is refused",
        suffices: "a period depends on the places at its ends alone, and sums over more records telescope (playback)",
        harnesses: &["ask_path"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "pulses that a record does not hold are cut off",
                file: "crates/core/src/playback.rs",
                find: "*increment = i16::try_from(pulses).ok()?;",
                put: "*increment = (pulses & 3) as i16;",
                killer: "ask_path",
            },
            Mutant {
                name: "the part of a record at the beginning of a period is emitted again",
                file: "crates/core/src/playback.rs",
                find: "within(from, -1, &mut sum)?;",
                put: "let _ = from.fraction;",
                killer: "ask_path",
            },
        ],
    },
];
