//! The rows of what runs in time: the two threads at the ring, the two threads at the gates, and the literal gates that
//! fail.
//!
//! Invariant: the models are in `concurrent/` and run in the packages `retrace-loom` and `retrace-shuttle`; here are
//! their names and mutants.

use crate::ledger::{Model, Mutant, Row, Search, Size};
use crate::literal_gates::{search_acknowledged, search_intended, search_level, search_sampled};
use crate::native::Harness;

/// No harness: concurrent code is explored by loom and shuttle, not unrolled.
pub const HARNESSES: &[Harness] = &[];

const SAMPLED: &str = include_str!("../counterexamples/literal-gates-sampled.txt");
const LEVEL: &str = include_str!("../counterexamples/literal-gates-level.txt");

/// The literal gates fail exactly as in the checked-in traces.
fn literal_gates_fail(_: Size) -> String {
    let sampled = search_sampled();
    for trace in &sampled {
        assert!(SAMPLED.contains(&trace.to_string()), "not the checked-in trace:\n{trace}");
    }
    let level = search_level();
    assert!(LEVEL.contains(&level.to_string()), "not the checked-in trace:\n{level}");
    format!(
        "refuted three times, by the checked-in traces: {} and {} steps with late flags, {} by the level",
        sampled[0].steps.len(),
        sampled[1].steps.len(),
        level.steps.len()
    )
}

/// The acknowledged gates over every small program and every delay; no state is stuck.
fn acknowledged_gates_hold(size: Size) -> String {
    let delay = if size.full { 4 } else { 2 };
    let (ours, intended) = (search_acknowledged(4, 3, delay), search_intended(4, 3));
    for counts in [&ours, &intended] {
        assert!(counts.failure.is_none() && counts.stuck == 0, "{counts:?}");
    }
    format!(
        "all {} states of {} programs with up to {delay} reports under way, none stuck; the literal gates without \
            delay: {} states",
        ours.states, ours.programs, intended.states
    )
}

pub(crate) const fn loom(test: &'static str) -> Model {
    Model { engine: "loom", test }
}

const fn shuttle(test: &'static str) -> Model {
    Model { engine: "shuttle", test }
}

const RING: &str = "crates/core/src/ring.rs";
const GATE: &str = "crates/core/src/gate.rs";
const COORDINATION: &str = "verification/concurrent/coordination.rs";

/// The rows.
pub const ROWS: &[Row] = &[
    Row {
        name: "ring-threads",
        says: "Planner and motion path never touch a cell that the other may touch, and what the motion path reads, \
            forward, backward and by place, is what was pushed, under every interleaving and every order that the \
            memory model allows",
        requirement: "REV, Beyond the source, *Threads*",
        bound: "rings of 2 and 4 cells with histories of 0 to 3 records, 4 and 5 records that are published \
            one by one and by twos, place numbers from 0 and over the wrap; preemption bound 2 (full: 3); 2 cells and \
            3 (full: 4) records without a bound",
        assumes: "the memory model as loom has it: coherence and release–acquire, no load buffering; shuttle explores \
            sequentially consistent interleavings only",
        suffices: "either side decides by two indices that only grow; a lost order shows within one turn of the ring, \
            which every model makes (a cell is written again from N + 1 records on)",
        harnesses: &[],
        searches: &[],
        models: &[
            loom("two_cells_keep_0"),
            loom("two_cells_keep_1"),
            loom("four_cells_keep_0"),
            loom("four_cells_keep_1"),
            loom("four_cells_keep_2"),
            loom("four_cells_keep_3"),
            loom("two_cells_without_a_bound"),
            loom("staged_records_are_read_once_published"),
            loom("asked_beyond_the_plan_touches_no_cell"),
            shuttle("a_long_tape_reads_what_was_pushed"),
        ],
        mutants: &[
            Mutant {
                name: "a record is published relaxed",
                file: RING,
                find: "self.shared.write.store(self.indices.write(), Ordering::Release);",
                put: "self.shared.write.store(self.indices.write(), Ordering::Relaxed);",
                killer: "two_cells_keep_1",
            },
            Mutant {
                name: "a record is published before it is written",
                file: RING,
                find: "cell.with_mut(|p| unsafe { *p = record });\n        self.indices.advance();\n",
                put: "self.indices.advance();\n        \
                    self.shared.write.store(self.indices.write(), Ordering::Release);\n        \
                    cell.with_mut(|p| unsafe { *p = record });\n",
                killer: "staged_records_are_read_once_published",
            },
            Mutant {
                name: "the floor is published relaxed",
                file: RING,
                find: "self.shared.floor.store(floor, Ordering::Release);",
                put: "self.shared.floor.store(floor, Ordering::Relaxed);",
                killer: "two_cells_keep_1",
            },
            Mutant {
                name: "the floor is looked up relaxed",
                file: RING,
                find: "self.shared.floor.load(Ordering::Acquire)",
                put: "self.shared.floor.load(Ordering::Relaxed)",
                killer: "two_cells_keep_1",
            },
            Mutant {
                name: "what is planned is looked up relaxed",
                file: RING,
                find: "self.shared.write.load(Ordering::Acquire)",
                put: "self.shared.write.load(Ordering::Relaxed)",
                killer: "two_cells_keep_1",
            },
            Mutant {
                name: "a cell is let go before it is read",
                file: RING,
                find: "let record = Some(self.read_cell(place));\n        self.publish(floor);",
                put: "self.publish(floor);\n        let record = Some(self.read_cell(place));",
                killer: "two_cells_keep_0",
            },
            Mutant {
                name: "the cell at the end of the plan is read",
                file: "crates/core/src/ring_indices.rs",
                find: "place.wrapping_sub(self.head) < self.write.wrapping_sub(self.head)\n",
                put: "place.wrapping_sub(self.head) <= self.write.wrapping_sub(self.head)\n",
                killer: "asked_beyond_the_plan_touches_no_cell",
            },
            Mutant {
                name: "a record by place is not asked for",
                file: RING,
                find: "self.indices.holds(place).then(|| self.read_cell(place))",
                put: "Some(self.read_cell(place))",
                killer: "asked_beyond_the_plan_touches_no_cell",
            },
            Mutant {
                name: "a record is written without room",
                file: RING,
                find: "if !self.has_room() {",
                put: "if !self.has_room() && self.indices.write() == 0 {",
                killer: "two_cells_keep_0",
            },
            Mutant {
                name: "room for one record more than there are cells",
                file: RING,
                find: "self.keep + self.look_ahead);",
                put: "self.keep + self.look_ahead + 1);",
                killer: "a_long_tape_reads_what_was_pushed",
            },
        ],
    },
    Row {
        name: "gates-literal",
        says: "The gates as the source defines them let motion pass an instruction that is not complete: with flags \
            that are sampled and late, and, where \"empty\" is read as a level, with no delay at all (both are shown \
            to FAIL)",
        requirement: "GMC-4, GMC-5, GMC-6; Beyond the source, both defects",
        bound: "the shortest traces over all programs of up to 2 records and 2 markers; checked in under \
            verification/counterexamples",
        assumes: "the card and its reports as in the requirement; at most one report under way",
        suffices: "one counterexample refutes",
        harnesses: &[],
        searches: &[Search { name: "literal-gates-fail", run: literal_gates_fail }],
        models: &[],
        mutants: &[Mutant {
            name: "the literal gates do not heed the marker",
            file: "verification/src/literal_gates/literal.rs",
            find: "!at_marker && state.card.records < self.program.records && state.b1 && b2",
            put: "state.card.records < self.program.records && state.b1 && b2",
            killer: "literal-gates-fail",
        }],
    },
    Row {
        name: "gates-order",
        says: "With the acknowledged gates no record behind an exclusive marker reaches the card's motion before the \
            instruction is complete, and no instruction begins before the motion ahead of it is complete, under every \
            delay; the end can be reached from every state",
        requirement: "GMC-3 to GMC-6; Beyond the source, *Safety* and *Liveness*",
        bound: "every program of up to 4 records and 3 markers in any places, up to 2 (full: 4) reports under way, \
            every interleaving",
        assumes: "the card reports honestly and in order; frames are not lost (the link's task)",
        suffices: "the gates handle one marker at a time and drop it with its acknowledgement (row gates-states)",
        harnesses: &[],
        searches: &[Search { name: "acknowledged-gates-hold", run: acknowledged_gates_hold }],
        models: &[],
        mutants: &[
            Mutant {
                name: "an instruction is sent away from its place",
                file: GATE,
                find: "cursor == Place::start_of(marker.place)",
                put: "cursor != Place::start_of(marker.place + 1)",
                killer: "acknowledged-gates-hold",
            },
            Mutant {
                name: "an acknowledgement without its number",
                file: GATE,
                find: "m.sent && m.number == executed",
                put: "m.sent",
                killer: "acknowledged-gates-hold",
            },
            Mutant {
                name: "an instruction is sent again",
                file: GATE,
                find: "!marker.sent && at_rest",
                put: "at_rest",
                killer: "acknowledged-gates-hold",
            },
        ],
    },
    Row {
        name: "gates-threads",
        says: "In a model of the coarse and the coordinator thread, on the real gates, one mutex and one condition \
            variable, order holds in the card's own time line, no wake-up is lost and no thread sleeps for ever",
        requirement: "GMC-7; Beyond the source, *Liveness*",
        bound: "loom: up to 3 records and 2 instructions, including wake-ups without a cause, preemption bound 2 \
            (full: 3); shuttle: 40 records, 6 instructions, every lag, random and PCT schedules",
        assumes: "the mutex and condition variable as the standard library specifies them",
        suffices: "the threads share one state under one mutex; a third instruction only repeats the second. No crate \
            ships these two threads (gate.rs is real, coordination.rs is a model): the product polls the gates in its \
            motion thread",
        harnesses: &[],
        searches: &[],
        models: &[
            loom("one_instruction_before_any_motion"),
            loom("one_instruction_between_two_records"),
            loom("one_instruction_behind_all_motion"),
            loom("two_instructions_at_one_place"),
            loom("two_instructions_and_two_records"),
            loom("two_instructions_and_three_records"),
            loom("one_instruction_and_a_wake_up_for_nothing"),
            shuttle("forty_records_and_six_instructions_stay_in_order_under_every_lag"),
        ],
        mutants: &[
            Mutant {
                name: "nobody is woken when an instruction is done",
                file: COORDINATION,
                find: "        self.changed.notify_all();\n        woken",
                put: "        woken",
                killer: FORTY,
            },
            Mutant {
                name: "the notice comes before the change",
                file: COORDINATION,
                find: "        let mut state = self.state();\n        state.report = report;\n        if state.k() \
                    {\n            self.changed.notify_all();\n        }",
                put: "        self.changed.notify_all();\n        self.state().report = report;",
                killer: FORTY,
            },
            Mutant {
                name: "the coarse thread looks once instead of until",
                file: COORDINATION,
                find: "while !state.gates.b_open(RecordIndex::new(place)) {",
                put: "if !state.gates.b_open(RecordIndex::new(place)) {",
                killer: FORTY,
            },
            Mutant {
                name: "the coordinator looks once instead of until",
                file: COORDINATION,
                find: "while !state.is_due() {",
                put: "if !state.is_due() {",
                killer: "one_instruction_and_a_wake_up_for_nothing",
            },
            Mutant {
                name: "the coordinator looks outside of the mutex",
                file: COORDINATION,
                find: "        let mut state = self.state();\n        while !state.is_due() {\n            state = \
                    self.sleep(state);",
                put: "        let due = self.state().is_due();\n        let mut state = self.state();\n        if \
                    !due {\n            state = self.sleep(state);",
                killer: FORTY,
            },
        ],
    },
];

const FORTY: &str = "forty_records_and_six_instructions_stay_in_order_under_every_lag";
