//! The record ring: its indices from any valid state, the cells that either side may touch, and the records that are
//! read.
//!
//! Invariant: no property starts from an empty ring only; a state is any that satisfies the invariant, so that one step
//! proves every sequence.

use crate::choice::Choice;
use crate::harness::{built, cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row};
use retrace_core::RecordIndex;
use retrace_core::ring::{Cell, RecordSpan, Ring};
use retrace_core::ring_indices::{ConsumerIndices, ProducerIndices, is_cell_count, sizes_fit};

/// Both sides and the two shared indices.
#[derive(Clone, Copy, Debug)]
struct System {
    planned: ProducerIndices,
    played: ConsumerIndices,
    floor: u32,
    write: u32,
    keep: u32,
    look_ahead: u32,
}

impl System {
    /// Any state that satisfies the invariant: any history, cursor and look-ahead, any place number, and each side with
    /// the other's index as it was at any time before.
    fn any(c: &mut impl Choice) -> Option<Self> {
        let keep = c.upto((1 << 30) - 1);
        let look_ahead = 1 + c.upto((1 << 30) - 1 - keep);
        let (head, retained, ahead) = (c.word(), c.upto(keep), c.upto(look_ahead));
        let (back, seen) = (c.upto(retained), c.upto(ahead));
        let reached = head.wrapping_add(retained);
        let (floor, write) = (reached.wrapping_sub(keep), reached.wrapping_add(ahead));
        let room = keep + look_ahead;
        let lag = c.upto(room - (keep + ahead));
        let planned = ProducerIndices::at(write, floor.wrapping_sub(lag), room);
        let played = ConsumerIndices::at(head, reached.wrapping_sub(back), reached, reached.wrapping_add(seen), keep);
        let played = built!(played);
        cover!(c, Wrapped, head > write);
        cover!(c, Empty, write == head);
        cover!(c, Full, retained == keep && ahead == look_ahead);
        cover!(c, AtEnd, retained > 0 && back == retained);
        Some(Self { planned, played, floor, write, keep, look_ahead })
    }

    fn holds(&self) -> bool {
        let Self { planned, played, floor, write, keep, look_ahead } = *self;
        let (retained, seen) =
            (played.reached().wrapping_sub(played.head()), played.write().wrapping_sub(played.reached()));
        let ahead = write.wrapping_sub(played.reached());
        let back = played.reached().wrapping_sub(played.read());
        back <= retained
            && retained <= keep
            && seen <= ahead
            && ahead <= look_ahead
            && floor == played.floor()
            && floor == played.reached().wrapping_sub(keep)
            && planned.write() == write
    }

    /// The effect of [`retrace_core::ring::Producer::push`], without the cell.
    fn push(&mut self) -> Option<u32> {
        if self.planned.is_full() {
            self.planned.observe_floor(self.floor);
            if self.planned.is_full() {
                return None;
            }
        }
        let place = self.planned.write();
        self.planned.advance();
        self.write = self.planned.write();
        Some(place)
    }
}

/// Storing keeps the order of the positions, and is refused exactly where the look-ahead is full.
fn push_keeps_order(c: &mut impl Choice) -> Option<()> {
    let before = System::any(c)?;
    let mut after = before;
    let ahead = before.write.wrapping_sub(before.played.reached());
    let pushed = after.push();
    cover!(c, Accepted, pushed.is_some());
    cover!(c, Refused, pushed.is_none());
    match pushed {
        None => holds!(ahead == before.look_ahead && after.write == before.write),
        Some(place) => {
            holds!(ahead < before.look_ahead && place == before.write && after.write == place.wrapping_add(1))
        }
    }
    holds!(after.holds() && after.played == before.played && after.floor == before.floor);
    Some(())
}

/// Required effect of every move of the cursor: `reached` and the floor only grow, and with the cursor only; `head`
/// follows `reached` at the distance `keep`, never `read`, and is never before the floor.
fn moved_in_order(before: &System, after: &ConsumerIndices) {
    let (was, retained) = (before.played.reached(), before.played.reached().wrapping_sub(before.played.head()));
    let advanced = after.reached().wrapping_sub(was);
    holds!(advanced <= before.write.wrapping_sub(was));
    holds!(advanced == 0 || after.reached() == after.read());
    let still_retained = after.reached().wrapping_sub(after.head());
    // both numbers are at most 2³⁰
    holds!(still_retained == if retained + advanced < before.keep { retained + advanced } else { before.keep });
    holds!(System { played: *after, floor: after.floor(), ..*before }.holds());
}

/// An advance passes the record under the cursor, and ends exactly at the end of the planned records.
fn forward_keeps_order(c: &mut impl Choice) -> Option<()> {
    let system = System::any(c)?;
    let (before, mut after) = (system.played, system.played);
    let advanced = after.advance_cursor();
    cover!(c, Accepted, advanced.is_some());
    cover!(c, Refused, advanced.is_none());
    match advanced {
        None => holds!(before.read() == before.write() && after == before),
        Some(place) => {
            holds!(before.read() != before.write() && before.holds(place));
            holds!(place == before.read() && after.read() == place.wrapping_add(1));
        }
    }
    moved_in_order(&system, &after);
    Some(())
}

/// A retreat passes one record backward, and ends exactly at the oldest retained one; nothing is released.
fn backward_keeps_order(c: &mut impl Choice) -> Option<()> {
    let system = System::any(c)?;
    let (before, mut after) = (system.played, system.played);
    let retreated = after.retreat();
    cover!(c, Accepted, retreated.is_some());
    cover!(c, Refused, retreated.is_none());
    match retreated {
        None => holds!(before.read() == before.head() && after == before),
        Some(place) => {
            holds!(before.read() != before.head() && before.holds(place));
            holds!(place == before.read().wrapping_sub(1) && after.read() == place);
        }
    }
    holds!(after.head() == before.head() && after.reached() == before.reached());
    moved_in_order(&system, &after);
    Some(())
}

/// The cursor follows the card to any place that is held, and to no other.
fn follow_keeps_order(c: &mut impl Choice) -> Option<()> {
    let system = System::any(c)?;
    let (before, mut after) = (system.played, system.played);
    let place = before.head().wrapping_add(c.word());
    let held = place.wrapping_sub(before.head()) <= before.write().wrapping_sub(before.head());
    cover!(c, Accepted, held);
    cover!(c, Refused, !held);
    holds!(after.seek(place) == held);
    holds!(if held { after.read() == place } else { after == before });
    moved_in_order(&system, &after);
    Some(())
}

/// Refreshing the number of planned records moves nothing.
fn look_keeps_order(c: &mut impl Choice) -> Option<()> {
    let system = System::any(c)?;
    let mut after = system.played;
    after.observe_write(system.write);
    holds!(after.read() == system.played.read() && after.head() == system.played.head());
    moved_in_order(&system, &after);
    Some(())
}

/// A record is held exactly where it is retained or planned: head ≤ place < write, as far as is known.
fn holds_what_is_retained_or_planned(c: &mut impl Choice) -> Option<()> {
    let System { played, .. } = System::any(c)?;
    let (head, reached, write) = (played.head(), played.reached(), played.write());
    let place = c.word();
    // in words of its own: so many records behind `reached`, or so many beyond it
    let (behind, beyond) = (reached.wrapping_sub(place), place.wrapping_sub(reached));
    let retained = behind > 0 && behind <= reached.wrapping_sub(head);
    let planned = beyond < write.wrapping_sub(reached);
    cover!(c, Accepted, retained || planned);
    cover!(c, Refused, !retained && !planned);
    holds!(played.holds(place) == (retained || planned));
    Some(())
}

/// A number of cells is enough exactly where history and look-ahead fit in it, and is valid where it is a power of two.
fn sizes_fit_in_cells(c: &mut impl Choice) -> Option<()> {
    let (cells, keep, look_ahead) = (c.word(), c.word(), c.word());
    // subtracted, not added: nothing here can wrap
    let enough = look_ahead > 0 && look_ahead <= cells && keep <= cells - look_ahead;
    cover!(c, Accepted, enough);
    cover!(c, Refused, !enough);
    holds!(sizes_fit(cells as usize, keep, look_ahead) == enough);
    let exponent = c.below(31);
    let is_power = c.flag();
    let count = if is_power { 1 << exponent } else { cells };
    holds!(!is_power || is_cell_count(count as usize));
    // the lowest bit of a number that is set divides it; only a power of two is that bit alone
    let lowest = count & count.wrapping_neg();
    holds!(is_cell_count(count as usize) == (count > 0 && count == lowest && count <= 1 << 30));
    Some(())
}

/// The real ring is created exactly where its sizes fit and its records are in order, for any sizes and places.
fn created_where_all_fits<const N: usize>(c: &mut impl Choice) -> Option<()> {
    let mut cells: [Cell<u32>; N] = core::array::from_fn(|_| Cell::new(0));
    // any numbers; natively half of them about as large as the ring
    let is_near = c.flag();
    let mut size = || if is_near { c.below(N as u32 + 2) } else { c.word() };
    let (keep, look_ahead, history, ahead) = (size(), size(), size(), size());
    let (n, head) = (c.upto(N as u32), c.word());
    let reached = head.wrapping_add(history);
    let span = [head, reached, reached.wrapping_add(ahead)].map(RecordIndex::new);
    let span = RecordSpan { head: span[0], reached: span[1], write: span[2] };
    let is_power = n == 1 || n == 2 || n == 4 || n == 8;
    let enough = look_ahead > 0 && look_ahead <= n && keep <= n - look_ahead;
    let ring = Ring::with_records(&mut cells[..n as usize], keep, look_ahead, span);
    let fits = is_power && enough && history <= keep && ahead <= look_ahead;
    cover!(c, Accepted, fits);
    cover!(c, Refused, !fits);
    cover!(c, Wrapped, fits && reached < head);
    holds!(ring.is_ok() == fits);
    Some(())
}

/// The cell that the planner writes is none that the motion path may read, in a ring of any sufficient size.
fn sides_are_apart(c: &mut impl Choice) -> Option<()> {
    let mut system = System::any(c)?;
    let cells = 1u32 << c.below(31);
    c.assume(system.keep + system.look_ahead <= cells)?;
    let (head, readable) = (system.played.head(), system.write.wrapping_sub(system.played.head()));
    c.assume(readable > 0)?;
    let place = head.wrapping_add(c.upto(readable - 1));
    // whatever the motion path asks for
    let asked = c.word();
    let pushed = system.push();
    cover!(c, Accepted, pushed.is_some());
    cover!(c, Refused, pushed.is_none());
    if let Some(written) = pushed {
        holds!(written & (cells - 1) != place & (cells - 1));
        holds!(!system.played.holds(asked) || written & (cells - 1) != asked & (cells - 1));
    }
    Some(())
}

/// The real ring from any state of `N` cells, any operations: what is read is what was pushed, and it ends where it
/// must.
fn reads_what_was_pushed<const N: usize, const OPERATIONS: usize>(c: &mut impl Choice) -> Option<()> {
    let (keep, look_ahead) = (c.below(N as u32), 1 + c.below(N as u32));
    c.assume(keep + look_ahead <= N as u32)?;
    let (mut head, retained, mut ahead) = (c.word(), c.below(N as u32), c.below(N as u32 + 1));
    c.assume(retained <= keep && ahead <= look_ahead)?;
    let mut reached = head.wrapping_add(retained);
    let write = reached.wrapping_add(ahead);
    cover!(c, Wrapped, head > write);
    cover!(c, Empty, write == head);
    cover!(c, Full, retained == keep && ahead == look_ahead);
    // The record of a place is its number; a cell without a record has any content.
    let mut cells: [Cell<u32>; N] = core::array::from_fn(|n| {
        let place = head.wrapping_add((n as u32).wrapping_sub(head) & (N as u32 - 1));
        Cell::new(if place.wrapping_sub(head) < write.wrapping_sub(head) { place } else { !place })
    });
    let [first, end, after] = [head, reached, write].map(RecordIndex::new);
    let span = RecordSpan { head: first, reached: end, write: after };
    let mut ring = built!(Ring::with_records(&mut cells[..], keep, look_ahead, span).ok());
    let (mut producer, mut consumer) = ring.split();
    let mut read = reached;
    let mut k = 0;
    while k < OPERATIONS {
        match c.below(3) {
            0 => {
                let full = ahead == look_ahead;
                cover!(c, Accepted, !full);
                cover!(c, Refused, full);
                holds!(producer.push(producer.write().number()).is_err() == full);
                ahead += u32::from(!full);
            }
            1 => {
                let end = read == reached.wrapping_add(ahead);
                let record = consumer.advance();
                cover!(c, AtEnd, end);
                cover!(c, Forward, !end);
                holds!(if end { record.is_none() } else { record == Some(read) });
                if !end {
                    read = read.wrapping_add(1);
                    if read == reached.wrapping_add(1) {
                        (reached, ahead) = (read, ahead - 1);
                        if reached.wrapping_sub(head) > keep {
                            head = head.wrapping_add(1);
                        }
                    }
                }
            }
            _ => {
                let end = read == head;
                let record = consumer.retreat();
                cover!(c, Backward, !end);
                if !end {
                    read = read.wrapping_sub(1);
                }
                holds!(if end { record.is_none() } else { record == Some(read) });
            }
        }
        holds!(consumer.head().number() == head && consumer.read().number() == read);
        holds!(consumer.reached().number() == reached);
        holds!(producer.write().number() == reached.wrapping_add(ahead));
        k += 1;
    }
    Some(())
}

harnesses! {
    ring_push, unwind 2, covers [Empty, Full, Wrapped, AtEnd, Accepted, Refused] => |c| push_keeps_order(c);
    ring_forward, unwind 2, covers [Empty, Full, Wrapped, AtEnd, Accepted, Refused] => |c| forward_keeps_order(c);
    ring_backward, unwind 2, covers [Empty, Full, Wrapped, AtEnd, Accepted, Refused] => |c| backward_keeps_order(c);
    ring_follow, unwind 2, covers [Empty, Full, Wrapped, AtEnd, Accepted, Refused] => |c| follow_keeps_order(c);
    ring_look, unwind 2, covers [Empty, Full, Wrapped, AtEnd] => |c| look_keeps_order(c);
    ring_apart, unwind 2, covers [Full, Wrapped, AtEnd, Accepted, Refused] => |c| sides_are_apart(c);
    ring_holds, unwind 2, covers [Empty, Full, Wrapped, AtEnd, Accepted, Refused] =>
        |c| holds_what_is_retained_or_planned(c);
    ring_sizes, unwind 2, covers [Accepted, Refused] => |c| sizes_fit_in_cells(c);
    ring_created, unwind 10, covers [Wrapped, Accepted, Refused] => |c| created_where_all_fits::<8>(c);
    ring_content_4, unwind 6, covers [Empty, Full, Wrapped, AtEnd, Forward, Backward, Accepted, Refused] =>
        |c| reads_what_was_pushed::<4, 3>(c);
    ring_content_8, unwind 10, covers [Empty, Full, Wrapped, AtEnd, Forward, Backward, Accepted, Refused] =>
        |c| reads_what_was_pushed::<8, 2>(c);
}

#[cfg(not(any(kani, verify_wasm)))]
const POSITIONS: &str = "crates/core/src/ring_indices.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    Row {
        name: "ring-positions",
        says: "Every operation keeps head ≤ read ≤ reached ≤ write; reverse ends after exactly the retained records, \
            forward exactly at what is planned, storing is refused exactly where the look-ahead is full; reached and \
            floor only grow",
        requirement: "REV-2, REV-3, REV-6, REV-7; Beyond the source, *The ring, completed*",
        bound: "none: any capacity up to 2³⁰, any keep and look-ahead, any place numbers over the wrap of u32, each \
            side's knowledge of the other arbitrarily old",
        assumes: "the state satisfies the invariant, which `new` and `with_records` establish",
        suffices: "one step from every valid state is an induction over sequences of any length",
        harnesses: &["ring_push", "ring_forward", "ring_backward", "ring_follow", "ring_look"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "a ring over the wrap is refused",
                file: "crates/core/src/ring_indices.rs",
                find: "&& span <= 1 << 30\n",
                put: "&& span <= 1 << 30\n            && head <= write\n",
                killer: "ring_push",
            },
            Mutant {
                name: "the look-ahead holds one record too many",
                file: POSITIONS,
                find: "self.write.wrapping_sub(self.floor) >= self.limit",
                put: "self.write.wrapping_sub(self.floor) > self.limit",
                killer: "ring_push",
            },
            Mutant {
                name: "head follows one record late",
                file: POSITIONS,
                find: "if passed > self.keep {",
                put: "if passed > self.keep + 1 {",
                killer: "ring_forward",
            },
            Mutant {
                name: "reverse run ends one record early",
                file: POSITIONS,
                find: "if self.read == self.head {",
                put: "if self.read.wrapping_sub(self.head) <= 1 {",
                killer: "ring_backward",
            },
            Mutant {
                name: "positions compared without the wrap",
                file: POSITIONS,
                find: "if passed > self.reached.wrapping_sub(self.head) {",
                put: "if read > self.reached {",
                killer: "ring_follow",
            },
        ],
    },
    Row {
        name: "ring-apart",
        says: "The cell that the planner writes is none that the motion path may read, now or later, before it \
            releases it",
        requirement: "REV, Beyond the source, *Threads*",
        bound: "none: any power of two of cells up to 2³⁰, any valid state",
        assumes: "keep + look-ahead ≤ cells, which `holding` checks",
        suffices: "one step from every valid state; what the threads make of it in time is row ring-threads",
        harnesses: &["ring_apart"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "the room counts from the cursor's share alone",
                file: POSITIONS,
                find: "self.write.wrapping_sub(self.floor) >= self.limit\n",
                put: "self.write.wrapping_sub(self.floor) > self.limit + 1\n",
                killer: "ring_apart",
            },
            Mutant {
                name: "the record at the end of the plan may be read",
                file: POSITIONS,
                find: "place.wrapping_sub(self.head) < self.write.wrapping_sub(self.head)\n",
                put: "place.wrapping_sub(self.head) <= self.write.wrapping_sub(self.head)\n",
                killer: "ring_apart",
            },
        ],
    },
    Row {
        name: "ring-holds",
        says: "A record can be read by place exactly where it is retained or planned: from head on and before write",
        requirement: "REV-2, REV-6; Beyond the source, *Threads*",
        bound: "none: any valid state, any place",
        assumes: "the state satisfies the invariant (ring-positions)",
        suffices: "it is a predicate of one state",
        harnesses: &["ring_holds"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "the end of the plan counts as held",
                file: POSITIONS,
                find: "place.wrapping_sub(self.head) < self.write.wrapping_sub(self.head)\n",
                put: "place.wrapping_sub(self.head) <= self.write.wrapping_sub(self.head)\n",
                killer: "ring_holds",
            },
            Mutant {
                name: "the record before the history counts as held",
                file: POSITIONS,
                find: "place.wrapping_sub(self.head) < self.write.wrapping_sub(self.head)\n",
                put: "place.wrapping_sub(self.head.wrapping_sub(1)) < self.write.wrapping_sub(self.head)\n",
                killer: "ring_holds",
            },
        ],
    },
    Row {
        name: "ring-sizes",
        says: "A ring is created exactly where its cells are a power of two up to 2³⁰, hold history and look-ahead \
            together, and the records that it takes over are in order and fit",
        requirement: "REV-2, REV-3; Beyond the source, *Threads*",
        bound: "the sizes: none, any number of cells, history and look-ahead; the real ring: 0 to 8 cells with any \
            history, look-ahead and places",
        assumes: "nothing",
        suffices: "`with_records` decides by the number of cells through the two functions that are proved for all of \
            them",
        harnesses: &["ring_sizes", "ring_created"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "history and look-ahead are added with a wrap",
                file: POSITIONS,
                find: "keep as u64 + look_ahead as u64 <= cells as u64",
                put: "keep.wrapping_add(look_ahead) as u64 <= cells as u64",
                killer: "ring_sizes",
            },
            Mutant {
                name: "the real ring adds with a wrap",
                file: POSITIONS,
                find: "keep as u64 + look_ahead as u64 <= cells as u64",
                put: "keep.wrapping_add(look_ahead) as u64 <= cells as u64",
                killer: "ring_created",
            },
            Mutant {
                name: "one cell is enough for two records",
                file: POSITIONS,
                find: "keep as u64 + look_ahead as u64 <= cells as u64",
                put: "keep as u64 + look_ahead as u64 <= cells as u64 + 1",
                killer: "ring_sizes",
            },
            Mutant {
                name: "any number of cells",
                file: POSITIONS,
                find: "cells.is_power_of_two() && cells <= 1 << 30",
                put: "cells > 0 && cells <= 1 << 30",
                killer: "ring_sizes",
            },
            Mutant {
                name: "more cells than places can tell apart",
                file: POSITIONS,
                find: "cells.is_power_of_two() && cells <= 1 << 30",
                put: "cells.is_power_of_two()",
                killer: "ring_sizes",
            },
            Mutant {
                name: "the sizes are not checked",
                file: "crates/core/src/ring.rs",
                find: "if !sizes_fit(n, keep, look_ahead) {",
                put: "if look_ahead == 0 {",
                killer: "ring_created",
            },
            Mutant {
                name: "the number of cells is not checked",
                file: "crates/core/src/ring.rs",
                find: "if !is_cell_count(n) {",
                put: "if n == 0 {",
                killer: "ring_created",
            },
            Mutant {
                name: "more records are taken over than are planned at most",
                file: "crates/core/src/ring.rs",
                find: "|| write.wrapping_sub(reached) > look_ahead",
                put: "|| write.wrapping_sub(reached) > look_ahead + 1",
                killer: "ring_created",
            },
        ],
    },
    Row {
        name: "ring-content",
        says: "What is read forward or backward is what was pushed under that place number; the empty and the full \
            ring stop where they must",
        requirement: "REV-3, REV-6, REV-7",
        bound: "the real ring of 4 cells, 3 operations, and of 8 cells, 2 operations, from any held records, any \
            place number",
        assumes: "cell contents as after pushes; a cell without a record has any content",
        suffices: "the positions are proved without bound (ring-positions); a cell's index is the place modulo a \
            power of two",
        harnesses: &["ring_content_4", "ring_content_8"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "records over the wrap are not taken over",
                file: "crates/core/src/ring.rs",
                find: "|| write.wrapping_sub(reached) > look_ahead",
                put: "|| write.wrapping_sub(reached) > look_ahead || write < head",
                killer: "ring_content_4",
            },
            Mutant {
                name: "a cell too far",
                file: "crates/core/src/ring.rs",
                find: "&self.cells[place as usize & (self.cells.len() - 1)].0",
                put: "&self.cells[place as usize & (self.cells.len() / 2 - 1)].0",
                killer: "ring_content_4",
            },
            Mutant {
                name: "history is not kept when a ring takes over records",
                file: "crates/core/src/ring.rs",
                find: "let history = reached.wrapping_sub(head);",
                put: "let history = write.wrapping_sub(reached).min(keep);",
                killer: "ring_content_8",
            },
        ],
    },
];
