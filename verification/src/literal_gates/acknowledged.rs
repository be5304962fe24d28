//! The gates of `retrace-core` over a late line: nothing is sampled, everything is acknowledged by place and number.
//!
//! The planner publishes the program piece by piece, a marker before the records behind it. The next instruction is
//! accepted at once where gate A is open, as in the controller. The card reports its place, which is within a record
//! while it moves, whether it is at rest, which is also possible within a record (hold), and the number of the last
//! instruction executed.
//!
//! Invariant: a state holds what rebuilds the gates, by the same calls that led to them.

use retrace_core::gate::Gates;
use retrace_core::{Place, RecordIndex};

use super::Program;
use super::card::{Act, Card, Failure, Line};
use super::search::Model;

/// Place number of the first record, so that the second is behind the wrap.
const START: u32 = u32::MAX;

/// The card's report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Report {
    played: u8,
    is_within: bool,
    at_rest: bool,
    executed: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct State {
    /// Markers and records that are published.
    planned: u8,
    /// Number of instructions that were accepted.
    taken: u8,
    /// Whether the last of them is accepted and not acknowledged, and whether the card has it.
    in_hand: bool,
    seen: Report,
    line: Line<Report>,
    card: Card,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Step {
    Plan,
    SendRecord,
    SendInstruction,
    Report { held: bool },
    Hear,
    Card(Act),
}

/// A program under the acknowledged gates.
#[derive(Debug)]
pub(super) struct Acknowledged {
    program: Program,
    delay: usize,
    /// For every piece of the program, in order, whether it is a marker.
    pieces: Vec<bool>,
}

impl Acknowledged {
    pub(super) fn new(program: Program, delay: usize) -> Self {
        let mut pieces = Vec::new();
        for record in 0..=program.records {
            pieces.extend(program.markers.iter().filter(|marker| **marker == record).map(|_| true));
            pieces.extend((record < program.records).then_some(false));
        }
        Self { program, delay, pieces }
    }

    /// Front marker of the instruction that was accepted last.
    fn marker(&self, state: &State) -> RecordIndex {
        place(self.program.markers[usize::from(state.taken) - 1])
    }

    fn gates(&self, state: &State) -> Gates {
        let mut gates = Gates::default();
        if state.in_hand {
            gates.accept(u32::from(state.taken), self.marker(state));
            if state.card.instructions == state.taken {
                gates.mark_sent();
            }
        }
        gates
    }

    fn c_open(&self, state: &State) -> bool {
        let Report { played, is_within, at_rest, .. } = state.seen;
        let cursor = Place { record: place(played), fraction: if is_within { 1 << 31 } else { 0 } };
        self.gates(state).c_open(cursor, at_rest)
    }

    fn published(&self, state: &State) -> impl Iterator<Item = bool> {
        self.pieces[..usize::from(state.planned)].iter().copied()
    }

    /// Accepts the next instruction if it is published and gate A is open.
    fn look(&self, mut state: State) -> State {
        let markers = self.published(&state).filter(|is_marker| *is_marker).count();
        if usize::from(state.taken) < markers {
            let number = state.taken + 1;
            let marker = place(self.program.markers[usize::from(state.taken)]);
            if self.gates(&state).accept(u32::from(number), marker) {
                (state.taken, state.in_hand) = (number, true);
            }
        }
        state
    }

    fn hear(&self, mut state: State, report: Report) -> State {
        state.seen = report;
        if self.gates(&state).acknowledge(u32::from(report.executed)).is_some() {
            state.in_hand = false;
        }
        self.look(state)
    }

    fn after(&self, state: &State, step: Step) -> Option<State> {
        let mut next = *state;
        match step {
            Step::Plan => {
                next.planned += 1;
                (usize::from(state.planned) < self.pieces.len()).then(|| self.look(next))
            }
            Step::SendRecord => {
                let records = self.published(state).filter(|is_marker| !is_marker).count();
                next.card.records += 1;
                let record = state.card.records;
                (usize::from(record) < records && self.gates(state).b_open(place(record))).then_some(next)
            }
            Step::SendInstruction => {
                next.card.instructions += 1;
                self.c_open(state).then_some(next)
            }
            Step::Report { held } => {
                next.line = state.line.sent(own_report(&state.card, held)?, self.delay)?;
                Some(next)
            }
            Step::Hear if self.delay == 0 => {
                let report = own_report(&state.card, false)?;
                Some(self.hear(next, report)).filter(|after| after != state)
            }
            Step::Hear => {
                let (report, line) = state.line.received()?;
                next.line = line;
                Some(self.hear(next, report))
            }
            Step::Card(_) => None,
        }
    }
}

fn place(record: u8) -> RecordIndex {
    RecordIndex::new(START.wrapping_add(u32::from(record)))
}

/// Current report of the card; `held` where it is at rest within a record, which is possible only during one.
fn own_report(card: &Card, held: bool) -> Option<Report> {
    let at_rest = held || card.has_finished();
    let report = Report { played: card.played, is_within: card.is_moving, at_rest, executed: card.executed };
    (card.is_moving || !held).then_some(report)
}

impl Model for Acknowledged {
    type State = State;
    type Step = Step;

    fn start(&self) -> State {
        let seen = Report { played: 0, is_within: false, at_rest: true, executed: 0 };
        State { planned: 0, taken: 0, in_hand: false, seen, line: Line::EMPTY, card: Card::default() }
    }

    fn steps(&self, state: &State) -> Vec<(Step, State)> {
        let reports = [Step::Report { held: false }, Step::Report { held: true }];
        let host = [Step::Plan, Step::SendRecord, Step::SendInstruction, Step::Hear].into_iter().chain(reports);
        let acts = state.card.acts(&self.program).map(|(act, card)| (Step::Card(act), State { card, ..*state }));
        host.filter_map(|step| Some((step, self.after(state, step)?))).chain(acts).collect()
    }

    fn failure(&self, state: &State) -> Option<Failure> {
        let both_open = state.in_hand && self.c_open(state) && self.gates(state).b_open(self.marker(state));
        state.card.failure.or(both_open.then_some(Failure::BothOpen))
    }

    fn is_end(&self, state: &State) -> bool {
        state.card.is_done(&self.program)
    }

    fn program(&self) -> String {
        format!("{}; up to {} reports under way", self.program, self.delay)
    }

    fn words(&self, state: &State, step: Step) -> String {
        match step {
            Step::Plan => "The planner publishes the next piece".to_owned(),
            Step::SendRecord => format!("Gate B is open: record {} goes to the card", state.card.records + 1),
            Step::SendInstruction => format!("Gate C is open: instruction {} goes to the card", state.taken),
            Step::Report { held } => {
                let rest = if held { ", held within a record" } else { "" };
                format!("The card reports {} records and {} instructions{rest}", state.card.played, state.card.executed)
            }
            Step::Hear => "The oldest report on its way arrives".to_owned(),
            Step::Card(act) => act.words(&state.card),
        }
    }
}
