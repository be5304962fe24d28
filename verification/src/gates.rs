//! The acknowledged gates, from any state (GMC-4 … GMC-6); the literal ones, which fail, are in `literal_gates`.
//!
//! Invariant: every state of [`Gates`] is reached by accepting an instruction and sending it or not.

use crate::choice::Choice;
use crate::harness::{cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row};
use retrace_core::gate::Gates;
use retrace_core::{Place, RecordIndex};

/// The accepted instruction: number, place of the marker, and whether the card has it.
type InHand = Option<(u32, RecordIndex, bool)>;

fn any_gates(c: &mut impl Choice) -> (Gates, InHand) {
    let mut gates = Gates::default();
    if c.flag() {
        return (gates, None);
    }
    let (number, place, sent) = (c.word(), RecordIndex::new(c.word()), c.flag());
    holds!(gates.accept(number, place));
    if sent {
        gates.mark_sent();
    }
    (gates, Some((number, place, sent)))
}

/// Required state of the three gates for an accepted instruction, for any record and any report.
fn gates_say(gates: &Gates, in_hand: InHand, record: RecordIndex, cursor: Place, at_rest: bool) {
    let (b, c) = (gates.b_open(record), gates.c_open(cursor, at_rest));
    match in_hand {
        // nothing accepted: motion is free, nothing can be sent
        None => holds!(gates.a_open() && b && !c),
        Some((_, marker, sent)) => {
            holds!(!gates.a_open());
            // no record behind the marker, every record before it
            holds!(b == record.is_before(marker));
            // the instruction once, and only with the cursor at rest on the marker
            holds!(c == (!sent && at_rest && cursor == Place::start_of(marker)));
            // what C lets through, B holds the motion behind
            holds!(!c || !gates.b_open(cursor.record));
        }
    }
}

/// From any state, any event: A, B and C open and shut exactly where they must.
fn gates_keep_order(c: &mut impl Choice) -> Option<()> {
    let (mut gates, mut in_hand) = any_gates(c);
    let record = RecordIndex::new(c.word());
    let cursor = Place { record: RecordIndex::new(c.word()), fraction: c.word() };
    gates_say(&gates, in_hand, record, cursor, c.flag());
    cover!(c, Empty, in_hand.is_none());
    cover!(c, Full, matches!(in_hand, Some((_, _, true))));
    cover!(
        c,
        Wrapped,
        matches!(in_hand, Some((_, marker, _)) if record.is_before(marker) && record.number() > marker.number())
    );
    match c.below(3) {
        0 => {
            let (number, place) = (c.word(), RecordIndex::new(c.word()));
            cover!(c, Accepted, in_hand.is_none());
            holds!(gates.accept(number, place) == in_hand.is_none());
            in_hand = in_hand.or(Some((number, place, false)));
        }
        1 => {
            gates.mark_sent();
            in_hand = in_hand.map(|(number, place, _)| (number, place, true));
        }
        _ => {
            let executed = c.word();
            let done = matches!(in_hand, Some((number, _, true)) if number == executed);
            cover!(c, AtEnd, done);
            cover!(c, Refused, in_hand.is_some() && !done);
            holds!(gates.acknowledge(executed) == if done { Some(executed) } else { None });
            in_hand = if done { None } else { in_hand };
        }
    }
    gates_say(&gates, in_hand, record, cursor, c.flag());
    Some(())
}

harnesses! {
    gates_order, unwind 2, covers [Empty, Full, Wrapped, Accepted, AtEnd, Refused] => |c| gates_keep_order(c);
}

#[cfg(not(any(kani, verify_wasm)))]
const GATE: &str = "crates/core/src/gate.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[Row {
    name: "gates-states",
    says: "B and C are never open together: no record behind a marker passes before its instruction is acknowledged, \
        and the instruction passes once, with the cursor at rest on the marker; one is accepted at a time",
    requirement: "GMC-4, GMC-5, GMC-6",
    bound: "none: any state, any event, any record, any report",
    assumes: "records are within 2³¹ of the marker",
    suffices: "one step from every state is an induction",
    harnesses: &["gates_order"],
    searches: &[],
    models: &[],
    mutants: &[
        Mutant {
            name: "the record behind the marker passes",
            file: GATE,
            find: "Some(marker) => place.is_before(marker.place),",
            put: "Some(marker) => !marker.place.is_before(place),",
            killer: "gates_order",
        },
        Mutant {
            name: "an instruction passes beside motion",
            file: GATE,
            find: "!marker.sent && at_rest && cursor",
            put: "!marker.sent && cursor",
            killer: "gates_order",
        },
        Mutant {
            name: "any acknowledgement will do",
            file: GATE,
            find: "m.sent && m.number == executed",
            put: "m.sent",
            killer: "gates_order",
        },
    ],
}];
