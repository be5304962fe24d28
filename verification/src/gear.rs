//! Gearing: the place as a function of the spindle's angle, the limits of a geared period, and its start (SPN-26).
//!
//! Invariant: a turn has a power of two of units wherever a proof divides by it, so that the solver ends; other ratios
//! are compared with 128 bits natively.

use crate::choice::Choice;
use crate::harness::{built, cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search, Size};
use retrace_core::gear::{COUNTER_STEP_LIMIT, Gear, GearLimits, GearRatio, extended_count};
use retrace_core::{Distance, Rate};

/// Units of angle in a turn of the ratio of the proofs: 256 counts.
const TURN: i64 = 1 << 16;

/// A ratio of 48 records in 256 counts.
fn ratio() -> Option<GearRatio> {
    GearRatio::new(256, 48)
}

const LIMITS: GearLimits = GearLimits {
    rate: Rate::from_units((1 << 32) + (1 << 28)),
    near_end: Distance::ZERO,
    tolerance: Distance::from_units(1 << 31),
};

/// A counter of 16 bits shows the true count over every wrap, for steps below the limit; else the error is raised.
fn the_counter_wraps(c: &mut impl Choice) -> Option<()> {
    let count = (u64::from(c.word()) << 32 | u64::from(c.word())) as i64;
    c.assume(count > i64::MIN / 2 && count < i64::MAX / 2)?;
    let step = c.between(-(1 << 15), (1 << 15) - 1);
    let counter = (count + step) as u16;
    let is_small = step > -i64::from(COUNTER_STEP_LIMIT) && step < i64::from(COUNTER_STEP_LIMIT);
    cover!(c, Wrapped, is_small && (count as u16).wrapping_add(step as u16) < count as u16 && step > 0);
    cover!(c, Backward, is_small && step < 0);
    cover!(c, Refused, !is_small);
    let shown = extended_count(count, counter);
    holds!(if is_small { shown == Some(count + step) } else { shown.is_none() });
    Some(())
}

/// The place is a function of the angle: monotone, whole at whole turns, and the quotient rounded down.
fn the_place_is_the_quotient(c: &mut impl Choice) -> Option<()> {
    let ratio = built!(ratio());
    let angle = c.between(-(1 << 40), 1 << 40);
    let distance = ratio.distance(angle).units();
    cover!(c, Backward, angle < 0);
    cover!(c, Split, distance & 0xFFFF_FFFF != 0);
    // 48 records in 2¹⁶ units: 48 · 2¹⁶ units of distance in a unit of angle, which is whole
    holds!(distance == angle * (48 << 16));
    let next = ratio.distance(angle + 1).units();
    holds!(distance <= next);
    Some(())
}

/// The stretch of the proofs: it begins at the angle 0 of a turn.
fn engaged(c: &mut impl Choice, length: u32) -> Option<(Gear, i64)> {
    let from = c.between(-300, -1);
    let gear = built!(Gear::engage(built!(ratio()), (length, false), LIMITS, 0, [from, 1000]));
    let anchor = gear.anchor();
    Some((gear, anchor))
}

/// Limits, lag, records held and anchor of one period behind the start.
fn a_period(c: &mut impl Choice, gear: &mut Gear, angle: i64, last: Distance, is_free: bool) -> Option<Distance> {
    let length = 100;
    let change = Rate::from_units(c.between(1, 1 << 30));
    let held = c.below(length + 1);
    let at = gear.at();
    c.assume(at <= Distance::records(i64::from(held)))?;
    let anchor = gear.anchor();
    let step = gear.run_period(angle, [0, held], change);
    let moved = step.moved;
    holds!(gear.anchor() == anchor && gear.at() == at + moved);
    holds!(gear.at() >= Distance::ZERO && gear.at() <= Distance::records(i64::from(held)));
    holds!(moved.abs() <= LIMITS.rate.over(1));
    let wanted = built!(ratio()).distance(angle - anchor);
    let end = Distance::records(i64::from(length));
    let wanted = if wanted < Distance::ZERO {
        Distance::ZERO
    } else if wanted > end {
        end
    } else {
        wanted
    };
    holds!(step.lag == wanted - gear.at());
    holds!(step.is_lost == (step.lag.abs() > LIMITS.tolerance));
    // At an end of the stretch, or of what is held, the cursor rests whatever its speed was.
    let is_at_end = gear.at() == Distance::ZERO || gear.at() == end || gear.at() == Distance::records(i64::from(held));
    holds!(is_free || is_at_end || (moved - last).abs() <= change.over(1));
    cover!(c, Limited, step.lag != Distance::ZERO);
    cover!(c, Refused, step.is_lost);
    cover!(c, Backward, moved < Distance::ZERO);
    cover!(c, AtEnd, is_at_end);
    Some(moved)
}

/// The first periods of a stretch: whatever the angle and the records held do, the limits are kept, a lag beyond the
/// tolerance is told in its period, and the anchor stays.
fn limits_hold<const PERIODS: u32>(c: &mut impl Choice) -> Option<()> {
    let (mut gear, anchor) = engaged(c, 100)?;
    let (mut last, mut period) = (Distance::ZERO, 0);
    while period < PERIODS {
        let angle = anchor + c.between(-(1 << 18), 1 << 18);
        last = a_period(c, &mut gear, angle, last, period < 2)?;
        period += 1;
    }
    Some(())
}

/// Gearing begins at its angle, in the period that contains it, and emits no more than the angle of that period.
fn it_begins_at_its_angle(c: &mut impl Choice) -> Option<()> {
    let at_end = c.flag();
    let start = c.between(0, TURN - 1);
    let (from, passed) = (c.between(-(1 << 36), 1 << 36), c.between(0, 3 * TURN));
    let to = if at_end { from - passed } else { from + passed };
    let ratio = built!(ratio());
    let end = ratio.angle_of(Distance::records(96));
    let phase = start + if at_end { end } else { 0 };
    let ahead = (if at_end { from - phase } else { phase - from }) & (TURN - 1);
    let ahead = if ahead == 0 { TURN } else { ahead };
    cover!(c, AtEnd, at_end);
    let gear = Gear::engage(ratio, (96, at_end), LIMITS, start, [from, to]);
    cover!(c, Accepted, gear.is_some());
    cover!(c, Refused, gear.is_none());
    holds!(gear.is_some() == (ahead <= passed));
    let Some(mut gear) = gear else { return Some(()) };
    holds!((gear.anchor() - start) & (TURN - 1) == 0);
    let before = gear.at();
    holds!(before == if at_end { Distance::records(96) } else { Distance::ZERO });
    let moved = gear.run_period(to, [0, 96], Rate::ONE).moved;
    let most = ratio.distance(passed);
    holds!(if at_end { moved <= Distance::ZERO && -most <= moved } else { Distance::ZERO <= moved && moved <= most });
    Some(())
}

/// In, through the turn and out: at every place the cursor was moved by the distance to it, whatever the angles were,
/// and by nothing where the beginning is passed backward, which ends the tap; there the angle is before it.
fn a_tap_returns<const PERIODS: u32>(c: &mut impl Choice) -> Option<()> {
    let (mut gear, anchor) = engaged(c, 100)?;
    let (mut sum, mut deepest, mut period) = (Distance::ZERO, Distance::ZERO, 0);
    while period < PERIODS {
        let angle = anchor + c.between(-(1 << 13), 1 << 13);
        let step = gear.run_period(angle, [0, 100], Rate::ONE);
        sum += step.moved;
        holds!(sum == gear.at());
        cover!(c, Backward, step.moved < Distance::ZERO);
        cover!(c, AtEnd, gear.has_passed_beginning() && deepest > Distance::ZERO);
        if gear.has_passed_beginning() {
            holds!(sum == Distance::ZERO && angle < anchor);
            return Some(());
        }
        deepest = if sum > deepest { sum } else { deepest };
        period += 1;
    }
    Some(())
}

harnesses! {
    gear_tap, unwind 5, covers [Backward, AtEnd] => |c| a_tap_returns::<4>(c);
    gear_counter, unwind 2, covers [Wrapped, Backward, Refused] => |c| the_counter_wraps(c);
    gear_place, unwind 2, covers [Backward, Split] => |c| the_place_is_the_quotient(c);
    gear_limits, unwind 5, covers [Limited, Refused, AtEnd, Backward] => |c| limits_hold::<4>(c);
    gear_begins, unwind 3, covers [AtEnd, Accepted, Refused] => |c| it_begins_at_its_angle(c);
}

/// Drawn ratios and angles, compared with the quotient in 128 bits; and walks of angles that return emit zero.
#[cfg(not(any(kani, verify_wasm)))]
fn any_ratio(size: Size) -> String {
    let mut draw = crate::native::Draw::new(size.seed);
    let runs = if size.full { 3_000_000 } else { 300_000 };
    for _ in 0..runs {
        let (counts, records) = (1 + draw.below(1 << 17), 1 + draw.below(65_535));
        let Some(ratio) = GearRatio::new(counts, records as u16) else { panic!("{counts} {records}") };
        let angle = draw.between(-(1 << 38), 1 << 38);
        let exact = ((i128::from(angle) * i128::from(records)) << 32).div_euclid(i128::from(ratio.turn()));
        let most = i128::from((1i64 << 30) / i64::from(records) * i64::from(records)) << 32;
        assert_eq!(i128::from(ratio.distance(angle).units()), exact.clamp(-most, most), "{counts} {records} {angle}");
        let length = Distance::records(i64::from(draw.below(1 << 20)));
        let reached = ratio.angle_of(length);
        assert!(ratio.distance(reached) >= length && ratio.distance(reached - 1) < length, "{counts} {records}");
    }
    format!("{runs} drawn ratios, angles and lengths")
}

/// Long walks of any ratio: a walk that returns to an angle has emitted zero since.
#[cfg(not(any(kani, verify_wasm)))]
fn walks_return(size: Size) -> String {
    let mut draw = crate::native::Draw::new(size.seed);
    let runs = if size.full { 20_000 } else { 2_000 };
    let mut lost = 0u32;
    for _ in 0..runs {
        let (counts, records) = (4 + draw.below(1 << 13), 2 + draw.below(2000));
        let Some(ratio) = GearRatio::new(counts, records as u16) else { panic!("{counts} {records}") };
        let turn = ratio.turn();
        let limits = GearLimits { rate: Rate::ONE, near_end: Distance::ZERO, tolerance: Distance::RECORD };
        let length = 100 + draw.below(3000);
        let Some(mut gear) = Gear::engage(ratio, (length, false), limits, 0, [-1, turn]) else {
            panic!("a whole turn")
        };
        let (mut angle, mut sum) = (gear.anchor(), Distance::ZERO);
        let change = Rate::from_units(draw.between(1 << 24, 1 << 30));
        for _ in 0..300 {
            angle += draw.between(-turn / 40, turn / 20);
            let step = gear.run_period(angle, [0, length], change);
            sum += step.moved;
            lost += u32::from(step.is_lost);
        }
        // Back, and at rest until it is caught up.
        for _ in 0..60_000 {
            let step = gear.run_period(gear.anchor(), [0, length], change);
            sum += step.moved;
            if step.lag == Distance::ZERO && step.moved == Distance::ZERO {
                break;
            }
        }
        assert_eq!((gear.at(), sum), (Distance::ZERO, Distance::ZERO), "{counts} {records}");
    }
    assert!(lost > 0);
    format!("{runs} walks of 300 angles, {lost} periods with a lag beyond the tolerance")
}

/// Taps over drawn records: in, through the turn and out with any lag, the axes are at every place where the records
/// have them, the same on both ways, and where it began in the end.
#[cfg(not(any(kani, verify_wasm)))]
fn taps_return(size: Size) -> String {
    use retrace_core::playback::emission;
    use retrace_core::{Place, Record, RecordIndex};
    let mut draw = crate::native::Draw::new(size.seed);
    let runs = if size.full { 20_000 } else { 2_000 };
    let mut pulses = 0u64;
    for run in 0..runs {
        let (counts, records) = (4 + draw.below(1 << 13), 2 + draw.below(200));
        let Some(ratio) = GearRatio::new(counts, records as u16) else { panic!("{counts} {records}") };
        let turn = ratio.turn();
        let limits = GearLimits { rate: Rate::ONE, near_end: Distance::ZERO, tolerance: Distance::RECORD };
        let length = 20 + draw.below(200);
        let path: Vec<Record<1>> =
            (0..length).map(|_| Record { increments: [draw.between(-40, 40) as i16], ..Record::default() }).collect();
        let start = Place::start_of(RecordIndex::new(if run % 2 == 0 { 0 } else { u32::MAX - 10 }));
        let pulses_to = |from: Place, to: Place| {
            let sum = emission(from, to, |n| path.get(n.since(start.record) as usize));
            sum.map_or_else(|| panic!("{counts} {records}: beyond the records"), |[sum]| sum)
        };
        let Some(mut gear) = Gear::engage(ratio, (length, false), limits, 0, [-1, turn]) else {
            panic!("a whole turn")
        };
        let (mut count, mut place) = (0, start);
        let deepest = ratio.angle_of(Distance::records(i64::from(length / 2)));
        let change = Rate::from_units(draw.between(1 << 26, 1 << 31));
        // Half a record per period on the way in and out, with jitter; then at rest before the beginning.
        let half = (turn / i64::from(2 * records)).max(1);
        let periods = deepest / half;
        for period in 0..2 * periods + 4_000 {
            let way = if period < periods { period } else { (2 * periods - period).max(-1) };
            let angle = gear.anchor() + way * half + if way < 0 { -turn } else { draw.between(-half, half) };
            let step = gear.run_period(angle, [0, length], change);
            let to = place.moved(step.moved);
            let emitted = pulses_to(place, to);
            (count, place) = (count + emitted, to);
            pulses += emitted.unsigned_abs();
            assert_eq!(count, pulses_to(start, place), "{counts} {records}");
        }
        assert!(gear.has_passed_beginning() && count == 0 && place == start, "{counts} {records}: {place:?} {count}");
    }
    format!("{runs} taps, {pulses} pulses in and out")
}

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    Row {
        name: "gear-place",
        says: "In a geared stretch the place is a function of angle, anchor, counts and records in a turn alone: \
            monotone, exact over any number of turns, and a walk of angles that returns has emitted zero",
        requirement: "SPN-11, SPN-26",
        bound: "any angle within ±2⁴⁰ units at 48 records in 256 counts; natively drawn ratios up to 2¹⁷ counts and \
            2¹⁶ records, and walks",
        assumes: "nothing",
        suffices: "the ratio enters by divisions, which the hardware makes",
        harnesses: &["gear_place"],
        searches: &[Search { name: "gear-ratios", run: any_ratio }, Search { name: "gear-walks", run: walks_return }],
        models: &[],
        mutants: &[
            Mutant {
                name: "the share of a turn loses its fraction",
                file: "crates/core/src/gear.rs",
                find: "records) << 32) + (rest << 32) / turn)",
                put: "records) << 32) + (rest / turn << 32))",
                killer: "gear_place",
            },
            Mutant {
                name: "a turn backward is cut short",
                file: "crates/core/src/gear.rs",
                find: "let turns = angle.div_euclid(turn);",
                put: "let turns = angle / turn;",
                killer: "gear_place",
            },
            Mutant {
                name: "the angle of a place falls short of it",
                file: "crates/core/src/gear.rs",
                find: "while self.distance(angle).units() < distance.units() {",
                put: "while self.distance(angle + 1).units() < distance.units() {",
                killer: "gear-ratios",
            },
        ],
    },
    Row {
        name: "gear-wrap",
        says: "Extended counts of the encoder equal the true ones over every wrap of its counter, for steps below a \
            quarter of its range; a larger step raises the error",
        requirement: "SPN-2, SPN-26",
        bound: "any count within ±2⁶², any step of 16 bits",
        assumes: "the true step is within 16 bits, which a sample a millisecond makes so up to 32 million counts a \
            second",
        suffices: "one sample is the step of all",
        harnesses: &["gear_counter"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "the step is not signed",
                file: "crates/core/src/gear.rs",
                find: "Some(count.wrapping_add(step as i64))",
                put: "Some(count.wrapping_add(step as u16 as i64))",
                killer: "gear_counter",
            },
            Mutant {
                name: "a step in doubt is taken",
                file: "crates/core/src/gear.rs",
                find: "if step.unsigned_abs() < COUNTER_STEP_LIMIT {",
                put: "if step.unsigned_abs() <= COUNTER_STEP_LIMIT {",
                killer: "gear_counter",
            },
        ],
    },
    Row {
        name: "gear-limit",
        says: "In a geared stretch no rate and no change of it is beyond the limits, the cursor never leaves the \
            records that are held, the lag is the distance to the place of the angle, beyond the tolerance it is told \
            in that period, and the anchor is constant",
        requirement: "SPN-15, SPN-26 (gear-limit, gear-road)",
        bound: "four periods from the start with any angles within ±2¹⁸ units, any records held and any limit of \
            change, at 48 records in 256 counts; natively as many walks as gear-place",
        assumes: "the records held reach up to the cursor",
        suffices: "a period depends on place, last distance and last angle alone, and four periods reach lag, reversal \
            and both ends",
        harnesses: &["gear_limits"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "the limit of change is not applied",
                file: "crates/core/src/gear.rs",
                find: "let moved = within_change(wanted).clamp(-most, most);",
                put: "let moved = wanted.clamp(-most, most);",
                killer: "gear_limits",
            },
            Mutant {
                name: "the cursor passes the end of the records that are held",
                file: "crates/core/src/gear.rs",
                find: "let to = self.within(self.at + moved).min(high.max(self.at)).max(low.min(self.at));",
                put: "let to = self.within(self.at + moved).max(low.min(self.at));",
                killer: "gear_limits",
            },
            Mutant {
                name: "a lag is told a period late",
                file: "crates/core/src/gear.rs",
                find: "is_lost: lag.abs() > self.limits.tolerance }",
                put: "is_lost: (lag + self.moved).abs() > self.limits.tolerance }",
                killer: "gear_limits",
            },
        ],
    },
    Row {
        name: "gear-start",
        says: "Gearing begins at rest, at an end of the stretch and at its angle of a turn, in the period that \
            contains that angle, and its first period emits no more than the angle of that period",
        requirement: "SPN-14, SPN-26",
        bound: "any start angle, any period of up to three turns within ±2³⁶ units, forward and from the end backward, \
            at 48 records in 256 counts",
        assumes: "nothing",
        suffices: "the angle enters modulo a turn",
        harnesses: &["gear_begins"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "it begins a turn early",
                file: "crates/core/src/gear.rs",
                find: "let engaged = if at_end { from - ahead } else { from + ahead };",
                put: "let engaged = if at_end { from - ahead } else { from + ahead - ratio.turn };",
                killer: "gear_begins",
            },
            Mutant {
                name: "the angle at the beginning of the period counts",
                file: "crates/core/src/gear.rs",
                find: "let ahead = if ahead == 0 { ratio.turn } else { ahead };",
                put: "",
                killer: "gear_begins",
            },
        ],
    },
    Row {
        name: "gear-tap",
        says: "In, through the turn and out of a tap the cursor was moved at every place by the distance to it, \
            whatever angles led there, and by nothing where the beginning is passed backward; so the axes are at the \
            same counts at a place on both ways, and where they began in the end",
        requirement: "SPN-19, SPN-26 (gear-tap)",
        bound: "four periods with any angles within ±2¹³ units, six records, at 48 records in 256 counts; natively \
            drawn taps over drawn records, up to 200 of them",
        assumes: "counts are a function of the place (playback-sums)",
        suffices: "the sum changes by what the cursor moves in a period, and four periods reach the way in, the turn, \
            the way out and the beginning",
        harnesses: &["gear_tap"],
        searches: &[Search { name: "gear-taps", run: taps_return }],
        models: &[],
        mutants: &[
            Mutant {
                name: "what is emitted is not what was moved at the beginning of the stretch",
                file: "crates/core/src/gear.rs",
                find: "self.moved = to - self.at;\n        self.at = to;\n        self.stepped()",
                put: "self.moved = moved;\n        self.at = to;\n        self.stepped()",
                killer: "gear_tap",
            },
            Mutant {
                name: "a tap is over where it begins",
                file: "crates/core/src/gear.rs",
                find: "self.at == Distance::ZERO && self.due < Distance::ZERO",
                put: "self.at == Distance::ZERO",
                killer: "gear_tap",
            },
        ],
    },
];
