//! The real ring under loom: for any order of the two threads and of their stores, what is read is what was pushed, and
//! no cell is touched by one side while the other may touch it (REV-2 … REV-7).
//!
//! Each shape is traversed by cursor from a start just before the wrap of place numbers, and followed by place from 0;
//! the full exploration takes both from both starts, with one preemption more. At least one record more than the number
//! of cells is pushed, as only then a cell's second write depends on the order in which the first was released.

use retrace_loom::explore::{explore, is_full};
use retrace_loom::tape::{Outcome, Tape};

/// Just before the wrap: the second record is behind it.
const WRAP: u32 = u32::MAX;

/// Explores the shape and compares the outcomes, pairs of `refused` and `starved` with 3 for three times and more, with
/// those that two preemptions are known to reach.
fn check(name: &str, shape: Tape, run: fn(Tape) -> Outcome, start: u32, known: &[(u32, u32)]) {
    let starts = if is_full() { vec![0, WRAP] } else { vec![start] };
    let bound = if is_full() { 3 } else { 2 };
    for start in starts {
        let tape = Tape { start, ..shape };
        let report = explore(&format!("{name} from {start:#x}"), Some(bound), move || run(tape).capped(3));
        let seen: Vec<_> = report.outcomes.iter().map(|outcome| (outcome.refused, outcome.starved)).collect();
        if is_full() {
            assert!(known.iter().all(|outcome| seen.contains(outcome)), "{name}: an outcome is missing: {seen:?}");
        } else {
            assert_eq!(seen, known, "{name}: not the outcomes that are known");
        }
    }
}

/// A test of either consumer for a shape: `keep + look_ahead`, records, turn, outcomes.
macro_rules! shapes {
    ($($name:ident: $keep:literal + $look_ahead:literal, $records:literal records, turn $turn:literal,
        $known:expr;)*) => {$(
        mod $name {
            use super::*;

            const SHAPE: Tape =
                Tape { keep: $keep, look_ahead: $look_ahead, start: 0, records: $records, staged: 1, turn: $turn };

            #[test]
            fn walked_reads_what_was_pushed() {
                check(concat!("walk ", stringify!($name)), SHAPE, Tape::walk, WRAP, &$known);
            }

            #[test]
            fn followed_reads_what_was_pushed() {
                check(concat!("follow ", stringify!($name)), SHAPE, Tape::follow, 0, &$known);
            }
        }
    )*};
}

/// With space for all records but one, either side may never be held up, or repeatedly.
const ROOMY: [(u32, u32); 12] =
    [(0, 1), (0, 2), (0, 3), (1, 0), (1, 1), (1, 2), (1, 3), (2, 1), (2, 2), (2, 3), (3, 2), (3, 3)];

shapes! {
    two_cells_keep_0: 0 + 2, 4 records, turn 2, ROOMY;
    two_cells_keep_1: 1 + 1, 4 records, turn 2, [(1, 3), (2, 3), (3, 2), (3, 3)];
    four_cells_keep_0: 0 + 4, 5 records, turn 2, ROOMY;
    four_cells_keep_1: 1 + 3, 5 records, turn 2, ROOMY;
    four_cells_keep_2: 2 + 2, 5 records, turn 3, [(0, 3), (1, 2), (1, 3), (2, 1), (2, 2), (2, 3), (3, 2), (3, 3)];
    four_cells_keep_3: 3 + 1, 5 records, turn 2, [(2, 3), (3, 3)];
}

/// Records that are published by twos: what was staged before the planner waits is published by then.
#[test]
fn staged_records_are_read_once_published() {
    let tight = [(1, 2), (1, 3), (2, 1), (2, 2), (2, 3), (3, 2), (3, 3)];
    for (keep, look_ahead, known) in [(0, 2, &ROOMY[..]), (1, 1, &tight), (1, 3, &ROOMY)] {
        let shape = Tape { keep, look_ahead, start: 0, records: keep + look_ahead + 1, staged: 2, turn: 2 };
        let name = format!("by twos keep {keep} look-ahead {look_ahead}");
        check(&format!("walk {name}"), shape, Tape::walk, WRAP, known);
        check(&format!("follow {name}"), shape, Tape::follow, 0, known);
    }
}

/// The consumer asks for the place at which the planner writes, and for those around it.
#[test]
fn asked_beyond_the_plan_touches_no_cell() {
    for (keep, look_ahead, known) in [(0, 2, &ROOMY[..]), (1, 1, &[(1, 3), (2, 3), (3, 2), (3, 3)])] {
        let shape = Tape { keep, look_ahead, start: 0, records: 4, staged: 1, turn: 1 };
        check(&format!("ask keep {keep} look-ahead {look_ahead}"), shape, Tape::ask, WRAP, known);
    }
}

/// Small enough to be explored with no bound on preemptions.
#[test]
fn two_cells_without_a_bound() {
    let records = if is_full() { 4 } else { 3 };
    for keep in [0, 1] {
        let tape = Tape { keep, look_ahead: 2 - keep, start: WRAP, records, staged: 1, turn: 2 };
        let name = format!("walk two_cells_keep_{keep}, {records} records");
        let report = explore(&name, None, move || tape.walk().capped(3));
        let smooth = Outcome { refused: 0, starved: 0 };
        assert!(report.outcomes.contains(&smooth), "an execution in which neither side is held up is missing");
        assert!(report.outcomes.len() >= 14, "{name}: {} outcomes only", report.outcomes.len());
    }
}
