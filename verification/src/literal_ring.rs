//! The ring as the source defines it: three cells and two crossing flags (REV-2, REV-3, REV-6, REV-7), and the proof
//! that it answers every question like the machine of place numbers.
//!
//! Invariant: [`LiteralRing`] is written from the requirements alone and shares no code with the core.

use crate::choice::Choice;
use crate::harness::{built, cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search};
use retrace_core::ring_indices::ConsumerIndices;

/// Largest number of cells that is modelled.
pub const MAX_CELLS: usize = 8;

/// The source's ring of up to [`MAX_CELLS`] cells. The record of a place is its place number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LiteralRing {
    /// The records.
    cells: [u32; MAX_CELLS],
    /// Number of cells.
    size: usize,
    /// Number of filled cells: REV-3 asks whether every cell is full.
    filled: usize,
    /// *Head*: the cell of the oldest record.
    h: usize,
    /// *Read*.
    r: usize,
    /// *Write*.
    w: usize,
    /// R's latest crossing of H was in the negative direction.
    over_h_negative: bool,
    /// R's latest crossing of W was in the negative direction.
    over_w_negative: bool,
}

impl LiteralRing {
    /// REV-2: at first all three are the same cell.
    #[must_use]
    pub fn new(size: usize) -> Self {
        Self {
            cells: [0; MAX_CELLS],
            size,
            filled: 0,
            h: 0,
            r: 0,
            w: 0,
            over_h_negative: false,
            over_w_negative: false,
        }
    }

    fn next(&self, cell: usize) -> usize {
        if cell + 1 == self.size { 0 } else { cell + 1 }
    }

    fn previous(&self, cell: usize) -> usize {
        if cell == 0 { self.size - 1 } else { cell - 1 }
    }

    /// Stores a record by REV-3, in its order. R is set to the newest record, so it advances over all records in
    /// between.
    pub fn store(&mut self, record: u32) {
        self.cells[self.w] = record;
        if self.filled == self.size {
            if self.w == self.h {
                self.h = self.next(self.h);
            }
        } else {
            self.filled += 1;
        }
        self.r = self.w;
        (self.over_h_negative, self.over_w_negative) = (false, false);
        self.w = self.next(self.w);
    }

    /// One turn of REV-6: the record that is sent with its directions negated, or the end.
    pub fn reverse(&mut self) -> Option<u32> {
        if self.r == self.previous(self.h) && self.over_h_negative {
            return None;
        }
        let record = self.cells[self.r];
        self.over_h_negative |= self.r == self.h;
        self.over_w_negative |= self.r == self.w;
        self.r = self.previous(self.r);
        Some(record)
    }

    /// One turn of REV-7: the record that is sent as recorded, or the end.
    pub fn forward(&mut self) -> Option<u32> {
        if self.w == self.next(self.r) && !self.over_w_negative {
            return None;
        }
        self.r = self.next(self.r);
        self.over_h_negative &= self.r != self.h;
        self.over_w_negative &= self.r != self.w;
        Some(self.cells[self.r])
    }

    /// Whether this is the ring that holds `played`'s history. The source's W is `reached`, and its R the record before
    /// `read`.
    #[must_use]
    pub fn mirrors(&self, played: &ConsumerIndices) -> bool {
        let retained = played.reached().wrapping_sub(played.head()) as usize;
        let back = played.reached().wrapping_sub(played.read()) as usize;
        if self.filled != retained || self.h != self.behind_write(retained) {
            return false;
        }
        if retained == 0 {
            return self.r == self.w && back == 0 && !self.over_h_negative && !self.over_w_negative;
        }
        let exhausted = back == retained;
        let mut same = self.r == self.previous(self.behind_write(back))
            && self.over_h_negative == exhausted
            && self.over_w_negative == (exhausted && retained == self.size);
        let mut cell = 0;
        while cell < self.size {
            let n = self.age(cell);
            same &= n > retained || self.cells[cell] == played.reached().wrapping_sub(n as u32);
            cell += 1;
        }
        same
    }

    /// Number of cells from that cell to W, 1 … size.
    fn age(&self, cell: usize) -> usize {
        if cell < self.w { self.w - cell } else { self.w + self.size - cell }
    }

    /// The cell `n` ≤ size cells before W.
    fn behind_write(&self, n: usize) -> usize {
        if n <= self.w { self.w - n } else { self.w + self.size - n }
    }
}

/// Any ring of `size` cells that mirrors the positions returned with it.
fn any_pair(c: &mut impl Choice, size: u32) -> Option<(LiteralRing, ConsumerIndices)> {
    let retained = c.below(size + 1);
    let (back, w) = (c.below(retained + 1), c.below(size) as usize);
    let reached = c.word();
    let seen = c.upto(1 << 20);
    let played = built!(ConsumerIndices::at(
        reached.wrapping_sub(retained),
        reached.wrapping_sub(back),
        reached,
        reached.wrapping_add(seen),
        size,
    ));
    let mut literal = LiteralRing::new(size as usize);
    (literal.w, literal.filled) = (w, retained as usize);
    literal.h = literal.behind_write(retained as usize);
    literal.r = literal.behind_write(back as usize);
    if retained > 0 {
        literal.r = literal.previous(literal.r);
        literal.over_h_negative = back == retained;
        literal.over_w_negative = back == retained && retained == size;
    }
    let mut cell = 0;
    while cell < size as usize {
        // a cell that holds no record has any content
        let n = literal.age(cell) as u32;
        literal.cells[cell] = if n <= retained { reached.wrapping_sub(n) } else { reached };
        cell += 1;
    }
    holds!(literal.mirrors(&played));
    cover!(c, Empty, retained == 0);
    cover!(c, Full, retained == size);
    cover!(c, Wrapped, played.head() > reached);
    cover!(c, AtEnd, retained > 0 && back == retained);
    Some((literal, played))
}

/// A question to both machines in one step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Question {
    /// Normal run: a record is executed for the first time and stored (REV-5).
    Store,
    Reverse,
    Forward,
}

/// Asks both machines where the source defines the result. Their answers must be equal, and the mirror is preserved.
fn ask(literal: &mut LiteralRing, played: &mut ConsumerIndices, question: Question) -> Option<()> {
    let empty = played.head() == played.reached();
    match question {
        Question::Store if played.read() != played.reached() || played.reached() == played.write() => return None,
        Question::Store => {
            let place = played.advance_cursor();
            holds!(place.is_some());
            literal.store(place.unwrap_or(0));
        }
        // The source leaves the empty ring undefined; ours stops at once.
        Question::Reverse if empty => holds!(played.retreat().is_none()),
        Question::Forward if empty => holds!(played.at_reached() && played.read() == played.reached()),
        Question::Reverse => holds!(literal.reverse() == played.retreat()),
        Question::Forward if played.read() == played.reached() => {
            holds!(played.at_reached() && literal.forward().is_none());
        }
        Question::Forward => holds!(literal.forward() == played.advance_cursor()),
    }
    holds!(literal.mirrors(played));
    Some(())
}

fn answers_alike<const SIZE: u32>(c: &mut impl Choice) -> Option<()> {
    let (mut literal, mut played) = any_pair(c, SIZE)?;
    let question = match c.below(3) {
        0 => Question::Store,
        1 => Question::Reverse,
        _ => Question::Forward,
    };
    cover!(c, Forward, question == Question::Forward);
    cover!(c, Backward, question == Question::Reverse);
    cover!(c, Accepted, question == Question::Store);
    ask(&mut literal, &mut played, question)
}

harnesses! {
    literal_1, unwind 10, covers [Empty, Full, Wrapped, AtEnd, Forward, Backward, Accepted] =>
        |c| answers_alike::<1>(c);
    literal_2, unwind 10, covers [Empty, Full, Wrapped, AtEnd, Forward, Backward, Accepted] =>
        |c| answers_alike::<2>(c);
    literal_3, unwind 10, covers [Empty, Full, Wrapped, AtEnd, Forward, Backward, Accepted] =>
        |c| answers_alike::<3>(c);
    literal_4, unwind 10, covers [Empty, Full, Wrapped, AtEnd, Forward, Backward, Accepted] =>
        |c| answers_alike::<4>(c);
    literal_5, unwind 10, covers [Empty, Full, Wrapped, AtEnd, Forward, Backward, Accepted] =>
        |c| answers_alike::<5>(c);
}

/// Breadth first over every state that both machines can reach together, from empty, including the real ring's cells.
#[cfg(not(any(kani, verify_wasm)))]
mod search {
    use super::{LiteralRing, MAX_CELLS, Question, ask};
    use crate::ledger::Size;
    use retrace_core::RecordIndex;
    use retrace_core::ring::{Cell, RecordSpan, Ring};
    use retrace_core::ring_indices::ConsumerIndices;
    use std::collections::{HashSet, VecDeque};

    const LOOK_AHEAD: u32 = 3;

    /// Relevant part of a state: place numbers only by their distances.
    fn key(literal: &LiteralRing, played: &ConsumerIndices) -> ([usize; 4], [bool; 2], [u32; 3]) {
        let LiteralRing { filled, h, r, w, over_h_negative, over_w_negative, .. } = *literal;
        let from_head = |place: u32| place.wrapping_sub(played.head());
        (
            [filled, h, r, w],
            [over_h_negative, over_w_negative],
            [played.read(), played.reached(), played.write()].map(from_head),
        )
    }

    /// The same step on the real ring, with its cells filled as by pushes.
    fn ask_ring(before: &ConsumerIndices, keep: u32, question: Question) -> (Option<u32>, [u32; 3]) {
        let size = (keep + LOOK_AHEAD).next_power_of_two();
        let [head, reached, write] = [before.head(), before.reached(), before.write()];
        let mut cells: Vec<Cell<u32>> =
            (0..size).map(|n| Cell::new(head.wrapping_add(n.wrapping_sub(head) & (size - 1)))).collect();
        let [first, end, after] = [head, reached, write].map(RecordIndex::new);
        let span = RecordSpan { head: first, reached: end, write: after };
        let mut ring = Ring::with_records(&mut cells[..], keep, LOOK_AHEAD, span).expect("a valid state");
        let (_, mut consumer) = ring.split();
        for _ in 0..reached.wrapping_sub(before.read()) {
            consumer.retreat().expect("kept");
        }
        let record = match question {
            Question::Reverse => consumer.retreat(),
            Question::Forward if consumer.read() == consumer.reached() => None,
            Question::Store | Question::Forward => consumer.advance(),
        };
        (record, [consumer.head(), consumer.read(), consumer.reached()].map(RecordIndex::number))
    }

    fn expand(literal: LiteralRing, played: ConsumerIndices, keep: u32) -> Vec<(LiteralRing, ConsumerIndices)> {
        let mut next = Vec::new();
        if played.write().wrapping_sub(played.reached()) < LOOK_AHEAD {
            let mut planned = played;
            planned.observe_write(played.write().wrapping_add(1));
            next.push((literal, planned));
        }
        for question in [Question::Store, Question::Reverse, Question::Forward] {
            let (mut l, mut p) = (literal, played);
            if ask(&mut l, &mut p, question).is_none() {
                continue;
            }
            let (record, positions) = ask_ring(&played, keep, question);
            assert_eq!(positions, [p.head(), p.read(), p.reached()], "the ring moved elsewhere");
            let moved = if question == Question::Reverse { p.read() } else { played.read() };
            assert_eq!(record, (p.read() != played.read()).then_some(moved), "the ring read another record");
            next.push((l, p));
        }
        next
    }

    pub(super) fn breadth_first(size: Size) -> String {
        let mut states = 0;
        for keep in 1..=MAX_CELLS as u32 {
            for start in [0, u32::MAX - 9] {
                let first = (
                    LiteralRing::new(keep as usize),
                    ConsumerIndices::at(start, start, start, start, keep).expect("valid"),
                );
                let (mut seen, mut queue) = (HashSet::from([key(&first.0, &first.1)]), VecDeque::from([first]));
                while let Some((literal, played)) = queue.pop_front() {
                    for (l, p) in expand(literal, played, keep) {
                        if seen.insert(key(&l, &p)) {
                            queue.push_back((l, p));
                        }
                    }
                }
                states += seen.len();
            }
        }
        let _ = size;
        format!("all {states} reachable states of capacities 1 to {MAX_CELLS}, from place 0 and over the wrap")
    }

    #[test]
    fn the_empty_literal_ring_reads_a_cell_never_written() {
        for size in 2..=MAX_CELLS {
            assert_eq!(LiteralRing::new(size).reverse(), Some(0));
            assert_eq!(LiteralRing::new(size).forward(), Some(0));
        }
    }
}

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[Row {
    name: "ring-literal",
    says: "The source's machine of three cells and two crossing flags and the ring of place numbers give equal \
        answers to every question, after every sequence of operations, whatever the planner has added since; the \
        empty ring, which the source leaves undefined, stops at once",
    requirement: "REV-2, REV-3, REV-5, REV-6, REV-7",
    bound: "histories of 1 to 5 records (the search: 8) from any state that mirrors, any place number; every \
        reachable state from empty, on the real ring",
    assumes: "records are stored in normal run only, at the newest (REV-5)",
    suffices: "every step from every state preserves the mirror (a simulation), so every sequence does; either \
        machine depends on the size only by wrapping at it",
    harnesses: &["literal_1", "literal_2", "literal_3", "literal_4", "literal_5"],
    searches: &[Search { name: "literal-search", run: search::breadth_first }],
    models: &[],
    mutants: &[
        Mutant {
            name: "reverse ends on the record behind the oldest",
            file: "crates/core/src/ring_indices.rs",
            find: "        if self.read == self.head {\n",
            put: "        if self.read.wrapping_add(1) == self.head {\n",
            killer: "literal_3",
        },
        Mutant {
            name: "reached follows the cursor back",
            file: "crates/core/src/ring_indices.rs",
            find: "        self.read = self.read.wrapping_sub(1);\n",
            put: "        self.read = self.read.wrapping_sub(1);\n        self.reached = self.read;\n",
            killer: "literal_3",
        },
        Mutant {
            name: "forward run goes on into the look-ahead",
            file: "crates/core/src/ring_indices.rs",
            find: "self.read == self.reached\n",
            put: "self.read == self.write\n",
            killer: "literal_4",
        },
        Mutant {
            name: "history ends one record early",
            file: "crates/core/src/ring_indices.rs",
            find: "self.head = self.floor();",
            put: "self.head = self.floor().wrapping_add(1);",
            killer: "literal-search",
        },
        Mutant {
            name: "a ring that is taken over loses half of its history",
            file: "crates/core/src/ring.rs",
            find: "ConsumerIndices::at(reached.wrapping_sub(history), reached,",
            put: "ConsumerIndices::at(reached.wrapping_sub(history / 2), reached,",
            killer: "literal-search",
        },
    ],
}];
