//! The gates as the source has them: A, `B = B1 ∧ B2`, `C = C1 ∧ C2 ∧ B2`, flags set by events (GMC-1 … GMC-7).
//!
//! All is decoded before the search begins, which is the best case for the source. B1 and C1 are set at a front marker,
//! where the coarse thread sleeps until B1 is 1 again. B2 and C2 are what the card last reported of itself.
//!
//! Invariant: with `delay` 0 the flags are the card's own at every moment; otherwise at most `delay` reports are on
//! their way.

use super::Program;
use super::card::{Act, Card, Failure, Line};
use super::search::Model;

/// Reading of "its buffer is empty" of GMC-4 and GMC-6.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Empty {
    /// As an event: the buffer was emptied by sending its last datum, which is the end marker.
    Event,
    /// As a level: there is nothing in it, for whatever reason.
    Level,
}

/// The flags that the card reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Flags {
    b2: bool,
    c2: bool,
}

/// Content of the coordinator's one-instruction buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Buffer {
    Empty,
    /// An instruction and its end marker.
    Instruction,
    /// The end marker alone: the instruction was sent to the card.
    EndMarker,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct State {
    /// Front markers that the coarse thread has passed, and whether it sleeps at the next.
    passed: u8,
    sleeps: bool,
    /// Number of instructions that channel A has passed.
    taken: u8,
    buffer: Buffer,
    a: bool,
    b1: bool,
    c1: bool,
    seen: Flags,
    line: Line<Flags>,
    card: Card,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum Step {
    MeetFrontMarker,
    PassFrontMarker,
    SendRecord,
    TakeInstruction,
    SendInstruction,
    MeetEndMarker,
    FindEmpty,
    Report,
    Hear,
    Card(Act),
}

/// A program under the literal gates.
#[derive(Debug)]
pub(super) struct Literal {
    program: Program,
    delay: usize,
    empty: Empty,
}

impl Literal {
    pub(super) fn new(program: Program, delay: usize, empty: Empty) -> Self {
        Self { program, delay, empty }
    }

    fn flags(&self, state: &State) -> Flags {
        if self.delay == 0 { own_flags(&state.card) } else { state.seen }
    }

    /// Whether the next coarse datum is a front marker.
    fn is_at_marker(&self, state: &State) -> bool {
        self.program.markers.get(usize::from(state.passed)) == Some(&state.card.records)
    }

    fn after(&self, state: &State, step: Step) -> Option<State> {
        let Flags { b2, c2 } = self.flags(state);
        let (at_marker, is_empty) = (self.is_at_marker(state), state.buffer == Buffer::Empty);
        let mut next = *state;
        let may = match step {
            Step::MeetFrontMarker => {
                (next.sleeps, next.b1, next.c1) = (true, false, true);
                at_marker && !state.sleeps
            }
            Step::PassFrontMarker => {
                next.sleeps = false;
                next.passed += 1;
                state.sleeps && state.b1
            }
            Step::SendRecord => {
                next.card.records += 1;
                !at_marker && state.card.records < self.program.records && state.b1 && b2
            }
            Step::TakeInstruction => {
                (next.a, next.buffer) = (false, Buffer::Instruction);
                next.taken += 1;
                state.a && is_empty && usize::from(state.taken) < self.program.markers.len()
            }
            Step::SendInstruction => {
                next.buffer = Buffer::EndMarker;
                next.card.instructions += 1;
                state.buffer == Buffer::Instruction && state.c1 && c2 && b2
            }
            Step::MeetEndMarker => {
                (next.buffer, next.a, next.b1, next.c1) = (Buffer::Empty, true, true, false);
                state.buffer == Buffer::EndMarker
            }
            Step::FindEmpty => {
                (next.a, next.b1, next.c1) = (true, true, false);
                self.empty == Empty::Level && is_empty && next != *state
            }
            Step::Report => {
                next.line = state.line.sent(own_flags(&state.card), self.delay)?;
                true
            }
            Step::Hear => {
                (next.seen, next.line) = state.line.received()?;
                true
            }
            Step::Card(_) => false,
        };
        may.then_some(next)
    }
}

fn own_flags(card: &Card) -> Flags {
    Flags { b2: card.is_ready(), c2: card.has_finished() }
}

impl Model for Literal {
    type State = State;
    type Step = Step;

    fn start(&self) -> State {
        let card = Card::default();
        State {
            passed: 0,
            sleeps: false,
            taken: 0,
            buffer: Buffer::Empty,
            a: true,
            b1: true,
            c1: false,
            seen: own_flags(&card),
            line: Line::EMPTY,
            card,
        }
    }

    fn steps(&self, state: &State) -> Vec<(Step, State)> {
        use Step::{FindEmpty, Hear, MeetEndMarker, MeetFrontMarker, PassFrontMarker};
        use Step::{Report, SendInstruction, SendRecord, TakeInstruction};
        let host = [
            MeetFrontMarker,
            PassFrontMarker,
            SendRecord,
            TakeInstruction,
            SendInstruction,
            MeetEndMarker,
            FindEmpty,
            Report,
            Hear,
        ];
        let acts = state.card.acts(&self.program).map(|(act, card)| (Step::Card(act), State { card, ..*state }));
        host.into_iter().filter_map(|step| Some((step, self.after(state, step)?))).chain(acts).collect()
    }

    fn failure(&self, state: &State) -> Option<Failure> {
        state.card.failure
    }

    fn is_end(&self, state: &State) -> bool {
        state.card.is_done(&self.program)
    }

    fn program(&self) -> String {
        self.program.to_string()
    }

    fn words(&self, state: &State, step: Step) -> String {
        let marker = state.passed + 1;
        let seen = if self.delay == 0 { "" } else { " as last reported" };
        match step {
            Step::MeetFrontMarker => {
                format!("Coarse interpolation meets the front marker of instruction {marker}: B1 := 0, C1 := 1")
            }
            Step::PassFrontMarker => {
                format!("B1 is 1: coarse interpolation goes on behind the front marker of instruction {marker}")
            }
            Step::SendRecord => {
                format!("Gate B is open (B1, and B2{seen}): record {} goes to the card", state.card.records + 1)
            }
            Step::TakeInstruction => {
                format!("Gate A is open: instruction {} enters the coordinator's buffer, A := 0", state.taken + 1)
            }
            Step::SendInstruction => {
                format!("Gate C is open (C1, and C2 and B2{seen}): instruction {} goes to the card", state.taken)
            }
            Step::MeetEndMarker => {
                format!("The coordinator meets the end marker of instruction {}: B1 := 1, C1 := 0, A := 1", state.taken)
            }
            Step::FindEmpty => "The coordinator's buffer is empty: B1 := 1, C1 := 0, A := 1".to_owned(),
            Step::Report => {
                let Flags { b2, c2 } = own_flags(&state.card);
                format!("The card reports B2 = {}, C2 = {}", u8::from(b2), u8::from(c2))
            }
            Step::Hear => "The oldest report on its way arrives".to_owned(),
            Step::Card(act) => act.words(&state.card),
        }
    }
}
