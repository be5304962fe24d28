//! The decisions of the protocol between card and host: about numbers of 16 bits, about epochs, and about the card's
//! window as the host predicts it.
//!
//! Invariant: they are compared with numbers that do not wrap, and with the card's own rule.

use crate::choice::Choice;
use crate::harness::{cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row};
use retrace_core::{Place, RecordIndex};
use retrace_link::predicted_window::PredictedBounds;
use retrace_link::sequence::{acknowledged_items, is_after};
use retrace_link::session::{is_next_opening, is_open_epoch, next_epoch};

/// Two numbers that do not wrap, less than 2¹⁵ apart, compare as their low 16 bits do. This is the step of an
/// induction: what an endpoint expects and what arrives are that close, however many there were before.
fn numbers_compare_as_unbounded_ones(c: &mut impl Choice) -> Option<()> {
    let expected = i64::from(c.word());
    let arrived = expected + c.between(-0x7FFF, 0x7FFF);
    holds!(is_after(arrived as u16, expected as u16) == (arrived > expected));
    holds!(is_after(expected as u16, arrived as u16) == (arrived < expected));
    cover!(c, Forward, arrived > expected);
    cover!(c, Backward, arrived < expected);
    cover!(c, Wrapped, arrived > expected && (arrived as u16) < expected as u16);
    Some(())
}

/// An acknowledgement covers what is outstanding up to its number. One that is older, or of items that do not exist,
/// covers nothing.
fn an_acknowledgement_covers_what_is_outstanding(c: &mut impl Choice) -> Option<()> {
    let first = i64::from(c.word());
    let count = c.upto(0x7FFF);
    let number = first + c.between(-0x8000, 0x7FFF);
    let covered = acknowledged_items(number as u16, first as u16, count as u16);
    let within = number >= first && number <= first + i64::from(count);
    holds!(covered.is_some() == within);
    if let Some(items) = covered {
        holds!(i64::from(items) == number - first);
    }
    cover!(c, Accepted, within && number > first);
    cover!(c, Refused, number < first);
    cover!(c, Wrapped, within && (number as u16) < first as u16);
    cover!(c, Full, within && count == 0x7FFF && number == first + i64::from(count));
    Some(())
}

/// Only the epoch after the last one is opened, by an opening for this start of the card, and once. No frame belongs to
/// a closed epoch.
fn epochs_are_opened_once(c: &mut impl Choice) -> Option<()> {
    let (last, epoch) = (c.word() as u16, c.word() as u16);
    let (boot, named) = (c.word(), c.word());
    let opens = is_next_opening(named, epoch, boot, last);
    let next = if last == u16::MAX { 1 } else { last + 1 };
    holds!(next_epoch(last) == next && next != 0 && next != last);
    holds!(opens == (named == boot && epoch == next));
    // once: it is not the next one any more
    holds!(!opens || !is_next_opening(named, epoch, boot, epoch));
    holds!(!is_open_epoch(epoch, 0));
    holds!(is_open_epoch(epoch, last) == (epoch == last && last != 0));
    cover!(c, Accepted, opens);
    cover!(c, Refused, !opens && epoch == next);
    cover!(c, Wrapped, opens && last == u16::MAX);
    Some(())
}

/// Any window, the cursor's last reported place in it, and how far it cannot avoid going from there. Offsets count from
/// the beginning of the window; none of them wraps.
struct Scene {
    bounds: PredictedBounds,
    cursor: Place,
    /// Records held, and the cursor's record.
    held: u32,
    record: u32,
    /// Records by which the cursor may be elsewhere, as the host knows.
    lead: u32,
    /// Boundaries that the cursor cannot avoid reaching, ahead and behind.
    ahead: u32,
    behind: u32,
}

impl Scene {
    fn any(c: &mut impl Choice, moves: bool) -> Self {
        let window = 4 + c.upto(1020);
        let held = c.upto(window);
        let low = RecordIndex::new(c.word());
        let record = c.upto(held);
        // at the end of the window there is no record to be in
        let fraction = if record == held { 0 } else { c.word() };
        let lead = if moves { c.upto(1023) } else { 0 };
        // the card stops at the ends of its window
        let boundary = record + u32::from(fraction != 0);
        let ahead = boundary + c.upto(lead.min(held - boundary));
        let behind = record - c.upto(lead.min(record));
        let cursor = Place { record: low + record, fraction };
        let bounds = PredictedBounds { low, high: low + held, window };
        Self { bounds, cursor, held, record, lead, ahead, behind }
    }
}

/// A command that moves an end of the window.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Command {
    Ahead,
    Behind,
    Trim,
    Forget,
}

/// What the host predicts to be accepted is accepted by a card whose cursor is within the margin; at rest, what it
/// predicts to be rejected is rejected, too. Both have the same window then, and never more than the card can hold.
#[inline(always)]
fn the_prediction_is_the_cards_rule(c: &mut impl Choice, command: Command) -> Option<()> {
    let moves = c.flag();
    let Scene { bounds, cursor, held, record, lead, ahead, behind } = Scene::any(c, moves);
    let PredictedBounds { low, high, window } = bounds;
    // from one record before the window to one behind it
    let to = c.upto(held + 2);
    let place = low + to - 1;
    let is_full = held == window;
    let slides = u32::from(is_full);
    let within = to >= 1 && to <= held + 1;
    // whether the card accepts it, and the window then: its beginning, and its length
    let (predicted, accepted, first, length) = match command {
        Command::Ahead => {
            // a cursor that runs forward has only moved on; one that runs backward may need the records that would go
            // to stop, and then the card refuses and the host sends the record again
            let accepted = to == held + 1 && (!is_full || record > window / 4);
            (bounds.after_ahead(place, cursor), accepted, low + slides, held + 1 - slides)
        }
        Command::Behind => {
            let accepted = to == 0 && (!is_full || held - ahead > window / 4);
            (bounds.after_behind(place, cursor, lead), accepted, low - 1, held + 1 - slides)
        }
        Command::Trim => {
            let accepted = within && to > ahead;
            (bounds.after_trim(place, cursor, lead), accepted, low, to.wrapping_sub(1))
        }
        Command::Forget => {
            let accepted = within && to <= behind + 1;
            (bounds.after_forget(place, cursor, lead), accepted, place, (held + 1).wrapping_sub(to))
        }
    };
    match predicted {
        Ok(after) => {
            holds!(accepted);
            holds!(after.low == first && after.high == first + length);
            holds!(after.window == window && length <= window);
        }
        Err(_) => holds!(moves || !accepted),
    }
    cover!(c, Accepted, predicted.is_ok());
    cover!(c, Refused, predicted.is_err());
    cover!(c, Full, is_full && predicted.is_ok());
    cover!(c, Wrapped, predicted.is_ok() && high.number() < low.number());
    cover!(c, AtRest, !moves);
    cover!(c, AtEnd, record == held);
    cover!(c, Split, cursor.fraction != 0 && predicted.is_ok());
    Some(())
}

harnesses! {
    protocol_numbers, unwind 2, covers [Forward, Backward, Wrapped] =>
        |c| numbers_compare_as_unbounded_ones(c);
    protocol_acknowledgements, unwind 2, covers [Accepted, Refused, Wrapped, Full] =>
        |c| an_acknowledgement_covers_what_is_outstanding(c);
    protocol_epochs, unwind 2, covers [Accepted, Refused, Wrapped] =>
        |c| epochs_are_opened_once(c);
    protocol_window_ahead, unwind 2, covers [Accepted, Refused, Full, Wrapped, AtRest, AtEnd, Split] =>
        |c| the_prediction_is_the_cards_rule(c, Command::Ahead);
    protocol_window_behind, unwind 2, covers [Accepted, Refused, Full, Wrapped, AtRest, AtEnd, Split] =>
        |c| the_prediction_is_the_cards_rule(c, Command::Behind);
    protocol_window_trim, unwind 2, covers [Accepted, Refused, Full, Wrapped, AtRest, AtEnd, Split] =>
        |c| the_prediction_is_the_cards_rule(c, Command::Trim);
    protocol_window_forget, unwind 2, covers [Accepted, Refused, Full, Wrapped, AtRest, AtEnd, Split] =>
        |c| the_prediction_is_the_cards_rule(c, Command::Forget);
}

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[Row {
    name: "protocol-decisions",
    says: "The protocol's decisions about numbers, acknowledgements and epochs are those of numbers that never wrap; \
           the window that the host predicts is the one that the card's rule makes",
    requirement: "GMC-2, over a line that can damage bytes",
    bound: "none: any numbers, over the wrap; any window of 4 to 1024 records at any place",
    assumes: "compared numbers are less than 2¹⁵ apart; the cursor is in the window, and at most as far from its \
              reported place as the margin says; it does not run backward while a record is added ahead of a full \
              window: then the card keeps what it needs to stop, and may refuse a record that the host sends again",
    suffices: "one decision from any state is an induction; at most 128 commands and 16 384 entries are outstanding",
    harnesses: &[
        "protocol_numbers",
        "protocol_acknowledgements",
        "protocol_epochs",
        "protocol_window_ahead",
        "protocol_window_behind",
        "protocol_window_trim",
        "protocol_window_forget",
    ],
    searches: &[],
    models: &[],
    mutants: &[
        Mutant {
            name: "sequence numbers compared without the wrap",
            file: "crates/link/src/sequence.rs",
            find: "number.wrapping_sub(other) as i16 > 0",
            put: "number > other",
            killer: "protocol_numbers",
        },
        Mutant {
            name: "a stale acknowledgement counts",
            file: "crates/link/src/sequence.rs",
            find: "if items <= count { Some(items) } else { None }",
            put: "if items <= count || items > 0xFF00 { Some(items) } else { None }",
            killer: "protocol_acknowledgements",
        },
        Mutant {
            name: "epoch 0 is opened after the last number",
            file: "crates/link/src/session.rs",
            find: "0 => 1,",
            put: "0 => 0,",
            killer: "protocol_epochs",
        },
        Mutant {
            name: "the host slides a full window too early",
            file: "crates/link/src/predicted_window.rs",
            find: "cursor.record.is_before(self.low + (self.window / 4 + 1))",
            put: "cursor.record.is_before(self.low + self.window / 4)",
            killer: "protocol_window_ahead",
        },
        Mutant {
            name: "the host trims within the margin",
            file: "crates/link/src/predicted_window.rs",
            find: "high.is_before(cursor.boundary_ahead() + margin)",
            put: "high.is_before(cursor.boundary_ahead())",
            killer: "protocol_window_trim",
        },
        Mutant {
            name: "the host slides behind within the margin",
            file: "crates/link/src/predicted_window.rs",
            find: "self.high.is_before(cursor.boundary_ahead() + (margin + self.window / 4 + 1))",
            put: "self.high.is_before(cursor.boundary_ahead() + (margin + self.window / 4))",
            killer: "protocol_window_behind",
        },
        Mutant {
            name: "the host forgets in front of the cursor",
            file: "crates/link/src/predicted_window.rs",
            find: "cursor.record.is_before(low + margin)",
            put: "cursor.boundary_ahead().is_before(low + margin)",
            killer: "protocol_window_forget",
        },
    ],
}];
