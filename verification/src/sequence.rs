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

/// Any window, the cursor's last reported place in it, and where the cursor cannot avoid going, at most `lead` records
/// ahead of that place and behind it.
struct Scene {
    bounds: PredictedBounds,
    cursor: Place,
    lead: u32,
    /// Furthest places that the cursor reaches ahead and behind.
    ahead: Place,
    behind: Place,
}

impl Scene {
    fn any(c: &mut impl Choice, moves: bool) -> Self {
        let window = 4 + c.upto(4092);
        let held = c.upto(window);
        let low = RecordIndex::new(c.word());
        let high = low + held;
        let before = c.upto(held);
        // at the end of the window there is no record to be in
        let fraction = if before == held { 0 } else { c.word() };
        let cursor = Place { record: low + before, fraction };
        let lead = if moves { c.upto(4096) } else { 0 };
        // the card stops at the ends of its window
        let forward = c.upto(lead.min(held - before));
        let backward = c.upto(lead.min(before));
        let ahead = if before + forward == held {
            Place::start_of(high)
        } else {
            Place { record: cursor.record + forward, fraction }
        };
        let behind = Place { record: cursor.record - backward, fraction };
        Self { bounds: PredictedBounds { low, high, window }, cursor, lead, ahead, behind }
    }

    fn offset(&self, place: RecordIndex) -> i64 {
        i64::from(place.since(self.bounds.low) as i32)
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
    let scene = Scene::any(c, moves);
    let PredictedBounds { low, high, window } = scene.bounds;
    let (held, most) = (scene.offset(high), i64::from(window));
    let margin = scene.lead;
    let place = low + c.upto(held as u32 + 2) - 1;
    let to = scene.offset(place);
    let slides = i64::from(held == most);
    let (predicted, accepted, expected) = match command {
        Command::Ahead => {
            // that the cursor of the card has moved on only helps
            let after = scene.bounds.after_ahead(place, scene.cursor);
            let cursor = scene.offset(scene.cursor.record);
            (after, to == held && (held < most || cursor > most / 4), (slides, held + 1))
        }
        Command::Behind => {
            let after = scene.bounds.after_behind(place, scene.cursor, margin);
            let bound = scene.offset(scene.ahead.boundary_ahead());
            (after, to == -1 && (held < most || held - bound > most / 4), (-1, held - slides))
        }
        Command::Trim => {
            let after = scene.bounds.after_trim(place, scene.cursor, margin);
            let bound = scene.offset(scene.ahead.boundary_ahead());
            (after, to >= 0 && to <= held && to >= bound, (0, to))
        }
        Command::Forget => {
            let after = scene.bounds.after_forget(place, scene.cursor, margin);
            let bound = scene.offset(scene.behind.record);
            (after, to >= 0 && to <= held && to <= bound, (to, held))
        }
    };
    match predicted {
        Ok(after) => {
            holds!(accepted);
            holds!((scene.offset(after.low), scene.offset(after.high)) == expected);
            holds!(after.window == window && after.high.since(after.low) <= window);
        }
        Err(_) => holds!(moves || !accepted),
    }
    cover!(c, Accepted, predicted.is_ok());
    cover!(c, Refused, predicted.is_err());
    cover!(c, Full, held == most && predicted.is_ok());
    cover!(c, Wrapped, predicted.is_ok() && high.number() < low.number());
    cover!(c, AtRest, !moves);
    cover!(c, AtEnd, scene.cursor.record == high);
    cover!(c, Split, scene.cursor.fraction != 0 && predicted.is_ok());
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
    bound: "none: any numbers, over the wrap; any window of 4 to 4096 records at any place",
    assumes: "compared numbers are less than 2¹⁵ apart; the cursor is in the window, and at most as far from its \
              reported place as the margin says",
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
