//! The card's window: what the card accepts takes away no record that the cursor is in or cannot avoid reaching.
//!
//! Invariant: a state is any window, as its records and ends: the card's own operations make it, and the harness checks
//! that it is the one that it asked for. What is needed is defined here by distances, not by the card.

use crate::choice::Choice;
use crate::harness::{cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row};
use retrace_card::CardWindow;
use retrace_core::drive::RecordWindow;
use retrace_core::{Distance, Flags, Place, Record, RecordIndex};
use retrace_link::CommandRefusal;

/// Records of a modelled window.
const RECORDS: usize = 4;
/// Records within which the card replaces none: a quarter of the window.
const NEAR: i64 = RECORDS as i64 / 4;

/// A window as it should be: its first record, how many there are, and of each of them a number that tells it apart and
/// whether the path rests at its end. `rests` has a bit for each boundary.
#[derive(Clone, Copy)]
struct Expected {
    low: RecordIndex,
    len: u32,
    lines: [u32; RECORDS],
    rests: u32,
}

impl Expected {
    fn any(c: &mut impl Choice) -> Self {
        let low = RecordIndex::new(c.word());
        let len = c.below(RECORDS as u32 + 1);
        // records differ in what a record may be, so that one in the place of another is noticed
        let first = c.below(1 << 8);
        let mut lines = [0; RECORDS];
        let mut n = 0;
        while n < RECORDS {
            lines[n] = first + n as u32;
            n += 1;
        }
        Self { low, len, lines, rests: c.below(1 << (RECORDS + 1)) }
    }

    fn record(&self, n: u32) -> Record<1> {
        let flags = if self.rests >> (n + 1) & 1 == 1 { Flags::REST } else { Flags::NONE };
        Record { line: self.lines[n as usize], flags, ..Record::ZERO }
    }

    /// Makes it with the card's operations.
    fn make(&self) -> Option<CardWindow<1, RECORDS>> {
        let mut window = CardWindow::new(RecordIndex::new(0));
        window.restart(self.low, self.rests & 1 == 1);
        let mut n = 0;
        while n < self.len {
            let made = window.push_ahead(self.low + n, self.record(n), Place::start_of(self.low));
            holds!(made.is_ok());
            n += 1;
        }
        holds!(self.agrees(&window, 0, self.len));
        holds!(window.low() == self.low && window.high() == self.low + self.len);
        Some(window)
    }

    /// Whether the window has the records `from` to `to` of this one, and knows whether the path rests at their ends.
    fn agrees(&self, window: &CardWindow<1, RECORDS>, from: u32, to: u32) -> bool {
        let (mut agrees, mut n) = (true, 0);
        while n < RECORDS as u32 {
            if from <= n && n < to {
                agrees &= window.record(self.low + n) == Some(&self.record(n));
                agrees &= window.rests_at(self.low + n) == (self.rests >> n & 1 == 1);
            }
            n += 1;
        }
        agrees && window.rests_at(self.low + to) == (self.rests >> to & 1 == 1)
    }
}

/// What may be asked of the window.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Change {
    Ahead,
    Behind,
    Trim,
    Forget,
}

/// One change of any window, with the cursor at any place of it and any distance that it cannot avoid to run, in either
/// direction: what is accepted leaves every record between the two places, and the record under the cursor, as it was;
/// what is refused leaves all of them; and what leaves the road that is needed is not refused for it.
fn road_is_left(c: &mut impl Choice, change: Change) -> Option<()> {
    let expected = Expected::any(c);
    let mut window = expected.make()?;
    // distances from the beginning of the window
    let end = i64::from(expected.len) << 32;
    let at = c.between(0, (RECORDS as i64) << 32);
    let bound = c.between(-1 << 32, (RECORDS as i64 + 1) << 32);
    c.assume(at <= end)?;
    // a planned stop may lie between the cursor and an end that it cannot avoid reaching
    let is_ahead = matches!(change, Change::Behind | Change::Trim);
    c.assume(if is_ahead { bound >= at } else { bound <= at })?;
    let bound_place = Place::start_of(expected.low).moved(Distance::from_units(bound));
    let (low_needed, high_needed) = if is_ahead { (at, bound) } else { (bound, at) };
    let asked = i64::from(c.below(RECORDS as u32 + 3)) - 1;
    let place = expected.low + (asked as u32);
    // a record behind ends where the path rests or not, as it is known there
    let ends_at_rest = change == Change::Behind && expected.rests & 1 == 1;
    let flags = if ends_at_rest { Flags::REST } else { Flags::NONE };
    let (new, rests) = (Record { line: 1 << 16, flags, ..Record::ZERO }, c.flag());
    let result = match change {
        Change::Ahead => window.push_ahead(place, new, bound_place),
        Change::Behind => window.push_behind(place, new, rests, bound_place),
        Change::Trim => window.trim(place, bound_place),
        Change::Forget => window.forget(place, bound_place),
    };
    let (low, high) = (window.low(), window.high());
    cover!(c, Accepted, result.is_ok());
    cover!(c, Refused, matches!(result, Err(CommandRefusal::InMotion | CommandRefusal::Full)));
    cover!(c, Full, result.is_ok() && expected.len as usize == RECORDS);
    cover!(c, Wrapped, result.is_ok() && (expected.low + expected.len).number() < expected.low.number());
    if result.is_err() {
        holds!(low == expected.low && high == expected.low + expected.len);
        holds!(expected.agrees(&window, 0, expected.len));
    }
    // the records of before that are held, as distances
    let from = i64::from(expected.low.records_to(low));
    let to = i64::from(expected.low.records_to(high));
    let len = i64::from(expected.len);
    let (first, last) = (if from < 0 { 0 } else { from }, if to > len { len } else { to });
    holds!(first <= last && to - from <= RECORDS as i64);
    holds!(expected.agrees(&window, first as u32, last as u32));
    // of the road that was held, nothing is taken away that is needed
    let low_held = if low_needed > 0 { low_needed } else { 0 };
    let high_held = if high_needed < end { high_needed } else { end };
    holds!(first << 32 <= low_held && high_held <= last << 32);
    // and a refusal has a reason: the number, or road that is needed
    let wanted_end = asked << 32;
    match (change, result) {
        (Change::Ahead, Ok(())) => holds!(asked == len && to == asked + 1),
        (Change::Behind, Ok(())) => holds!(asked == -1 && from == -1 && window.rests_at(low) == rests),
        (Change::Trim, Ok(())) => holds!(0 <= asked && to == asked),
        (Change::Forget, Ok(())) => holds!(asked <= len && from == asked),
        (Change::Trim, Err(CommandRefusal::InMotion)) => holds!(wanted_end < high_needed),
        (Change::Forget, Err(CommandRefusal::InMotion)) => holds!(low_needed < wanted_end),
        (Change::Ahead, Err(CommandRefusal::Full)) => holds!(low_needed < (NEAR + 1) << 32),
        (Change::Behind, Err(CommandRefusal::Full)) => holds!(end < high_needed + ((NEAR + 1) << 32)),
        (Change::Trim, Err(_)) => holds!(asked < 0 || asked > len),
        (Change::Forget, Err(_)) => holds!(asked < 0 || asked > len),
        (Change::Ahead, Err(_)) => holds!(asked != len),
        (Change::Behind, Err(_)) => holds!(asked != -1),
    }
    Some(())
}

harnesses! {
    window_ahead, unwind 6, covers [Accepted, Refused, Full, Wrapped] => |c| road_is_left(c, Change::Ahead);
    window_behind, unwind 6, covers [Accepted, Refused, Full, Wrapped] => |c| road_is_left(c, Change::Behind);
    window_trim, unwind 6, covers [Accepted, Refused, Full, Wrapped] => |c| road_is_left(c, Change::Trim);
    window_forget, unwind 6, covers [Accepted, Refused, Full, Wrapped] => |c| road_is_left(c, Change::Forget);
}

#[cfg(not(any(kani, verify_wasm)))]
const WINDOW: &str = "crates/card/src/window.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[Row {
    name: "window-room",
    says: "The card never accepts a change of its window that takes away road that it needs to stop: whatever it \
        accepts, the records from the cursor to the place that it cannot avoid reaching stay as they were; what it \
        refuses changes nothing, and for want of road it refuses nothing that leaves that road and a quarter of the \
        window",
    requirement: "REV, Beyond the source, *Braking to a place*; REV-12",
    bound: "one record ahead or behind, one trim or one forget, of any window of up to 4 records, over the wrap of \
        their numbers, with any planned stops, the cursor and the place anywhere from a record before the window to \
        one after it",
    assumes: "the place that the card passes is the one it cannot avoid reaching: the stopping distance is judged by \
        row stopping-room, and that a rate is chosen within it by drive-braking",
    suffices: "one change from any window is an induction over changes. The rules compare numbers with the ends of \
        the window and a quarter of it, and depend on its size by nothing else; cells are a number's last bits. An \
        instruction ahead is compared in the player, by row stopping-room",
    harnesses: &["window_ahead", "window_behind", "window_trim", "window_forget"],
    searches: &[],
    models: &[],
    mutants: &[
        Mutant {
            name: "a record ahead replaces one within a quarter",
            file: WINDOW,
            find: "bound.record.is_before(self.low + (W / 4 + 1) as u32)",
            put: "bound.record.is_before(self.low)",
            killer: "window_ahead",
        },
        Mutant {
            name: "a record behind replaces the one that is stopped in",
            file: WINDOW,
            find: "let ahead = bound.boundary_ahead().records_to(self.high);",
            put: "let ahead = bound.record.records_to(self.high) + 1;",
            killer: "window_behind",
        },
        Mutant {
            name: "a trim cuts the record that is stopped in",
            file: WINDOW,
            find: "if high.is_before(bound.boundary_ahead())",
            put: "if high.is_before(bound.record)",
            killer: "window_trim",
        },
        Mutant {
            name: "a forget cuts the record that is stopped in",
            file: WINDOW,
            find: "if bound.record.is_before(low) {",
            put: "if bound.boundary_ahead().is_before(low) {",
            killer: "window_forget",
        },
        Mutant {
            name: "a forgotten planned stop is lost",
            file: WINDOW,
            find: "self.low_rests = self.rests_at(low);",
            put: "self.low_rests &= self.rests_at(low);",
            killer: "window_forget",
        },
        Mutant {
            name: "a trim that is refused is made",
            file: WINDOW,
            find: "self.high.is_before(high) || high.is_before(self.low)",
            put: "high.is_before(self.low)",
            killer: "window_trim",
        },
    ],
}];
