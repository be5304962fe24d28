//! The interrupted on-line program as the source defines it, flag by flag (DNC-1 … DNC-8), and the proof that the
//! core's steps answer every event in the same way.
//!
//! Invariant: [`LiteralSteps`] is written from the requirements alone and shares no decision with the core.

use crate::choice::Choice;
use crate::harness::{cover, harnesses, holds};
#[cfg(not(any(kani, verify_wasm)))]
use crate::ledger::{Mutant, Row, Search};
use retrace_core::interruption::{
    Breakpoint, Interruption, InterruptionAction, InterruptionEvent, SpindleDirection, SpindleState,
};

/// Flags, mode and spindle, each as the requirements name it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LiteralSteps<const A: usize> {
    on_line: bool,
    dnc_paused: bool,
    mode_changed: bool,
    inhibit: bool,
    /// Whether the spindle has stopped since the pause. Where it was at rest at the breakpoint there is nothing to
    /// stop.
    has_stopped: bool,
    turns: Option<SpindleDirection>,
    latched: Option<Breakpoint<A>>,
}

impl<const A: usize> LiteralSteps<A> {
    /// Machining on line.
    #[must_use]
    pub fn on_line() -> Self {
        Self {
            on_line: true,
            dnc_paused: false,
            mode_changed: false,
            inhibit: false,
            has_stopped: false,
            turns: None,
            latched: None,
        }
    }

    /// DNC-8: execution resumes.
    #[must_use]
    pub fn executes(&self) -> bool {
        self.on_line && !self.dnc_paused && !self.mode_changed && !self.inhibit
    }

    /// Whether the spindle is in its state of the breakpoint, after a stop.
    fn spindle_is_back(&self) -> bool {
        match self.latched.map(|latch| latch.spindle) {
            Some(Some(turning)) => self.has_stopped && self.turns == Some(turning.direction),
            Some(None) => self.turns.is_none(),
            None => false,
        }
    }

    /// Applies an event where the requirements permit it.
    pub fn apply(&mut self, word: InterruptionEvent<A>) -> bool {
        let is_manual = self.dnc_paused && !self.inhibit;
        match (word, self.latched) {
            // DNC-1, DNC-2; the breakpoint of an unfinished return does not change
            (InterruptionEvent::Pause(latch), latched) if self.on_line => {
                let breakpoint = latched.unwrap_or(latch);
                (self.on_line, self.dnc_paused, self.mode_changed, self.inhibit) = (false, true, true, false);
                (self.latched, self.turns) = (Some(breakpoint), breakpoint.spindle.map(|turning| turning.direction));
                self.has_stopped = false;
            }
            // DNC-3
            (InterruptionEvent::StopSpindle, _) if is_manual && self.turns.is_some() => {
                (self.turns, self.has_stopped) = (None, true);
                (self.on_line, self.mode_changed) = (false, true);
            }
            (InterruptionEvent::Jog, _) if self.mode_changed => {}
            // DNC-4
            (InterruptionEvent::StartSpindle(direction), Some(Breakpoint { spindle: Some(turning), .. }))
                if is_manual && self.turns.is_none() && direction == turning.direction =>
            {
                self.turns = Some(direction);
            }
            // DNC-5
            (InterruptionEvent::Online, _) if self.mode_changed && self.spindle_is_back() => {
                (self.on_line, self.mode_changed) = (true, false);
            }
            // DNC-6
            (InterruptionEvent::CycleStart { program }, Some(latch))
                if is_manual && self.on_line && self.spindle_is_back() && program == latch.program =>
            {
                self.inhibit = true;
            }
            // DNC-7
            (InterruptionEvent::Arrived(counts), Some(latch)) if self.inhibit && counts == latch.counts => {
                (self.inhibit, self.dnc_paused, self.latched) = (false, false, None);
                (self.turns, self.has_stopped) = (None, false);
            }
            _ => return false,
        }
        true
    }

    /// Progress in the order: 0 on line, then a number for each of DNC-1, -3, -4, -5, -6.
    fn step(&self) -> u32 {
        if !self.dnc_paused {
            0
        } else if self.inhibit {
            5
        } else if !self.mode_changed {
            4
        } else if self.spindle_is_back() {
            3
        } else if self.turns.is_none() {
            2
        } else {
            1
        }
    }
}

/// The events of the order, up to step `step`, applied to both machines.
fn both_at<const A: usize>(step: u32, latch: &Breakpoint<A>) -> (Interruption<A>, LiteralSteps<A>) {
    let (mut real, mut literal) = (Interruption::reading(), LiteralSteps::on_line());
    let mut n = 1;
    while n <= step {
        let word = match (n, latch.spindle) {
            (1, _) => Some(InterruptionEvent::Pause(*latch)),
            (2, Some(_)) => Some(InterruptionEvent::StopSpindle),
            (3, Some(turning)) => Some(InterruptionEvent::StartSpindle(turning.direction)),
            (4, _) => Some(InterruptionEvent::Online),
            (5, _) => Some(InterruptionEvent::CycleStart { program: latch.program }),
            _ => None,
        };
        if let Some(word) = word {
            holds!(real.apply(word).is_ok() && literal.apply(word));
        }
        n += 1;
    }
    (real, literal)
}

fn alike<const A: usize>(real: &Interruption<A>, literal: &LiteralSteps<A>) {
    holds!(real.may_read() == literal.executes());
    holds!(real.is_paused() == literal.dnc_paused && real.mode_changed() == literal.mode_changed);
    holds!(real.is_inhibited() == literal.inhibit && real.may_jog() == literal.mode_changed);
    holds!(real.breakpoint().copied() == literal.latched);
}

/// The effect of an accepted event is the one that the requirement defines, with the latched values.
fn does_what_is_said<const A: usize>(effect: InterruptionAction<A>, word: InterruptionEvent<A>, latch: &Breakpoint<A>) {
    let right = match (word, effect) {
        (InterruptionEvent::StartSpindle(direction), InterruptionAction::StartSpindle(turning)) => {
            latch.spindle == Some(turning) && turning.direction == direction
        }
        (InterruptionEvent::CycleStart { .. }, InterruptionAction::Approach(counts)) => counts == latch.counts,
        (InterruptionEvent::Pause(_), InterruptionAction::Halt)
        | (InterruptionEvent::StopSpindle, InterruptionAction::StopSpindle)
        | (InterruptionEvent::Jog, InterruptionAction::Jog)
        | (InterruptionEvent::Online, InterruptionAction::Online)
        | (InterruptionEvent::Arrived(_), InterruptionAction::ResumeReading) => true,
        _ => false,
    };
    holds!(right);
}

/// An event applied to both: the same answer, the same flags, and where it is refused nothing has changed. Then both
/// are in one of the states that the events of the order lead to, so that this holds again of the next event.
fn said_to_both<const A: usize>(
    real: &mut Interruption<A>,
    literal: &mut LiteralSteps<A>,
    word: InterruptionEvent<A>,
) -> bool {
    let before = (*real, *literal);
    let answer = real.apply(word);
    let taken = literal.apply(word);
    holds!(answer.is_ok() == taken);
    holds!(taken || (*real, *literal) == before);
    alike(real, literal);
    if let (Ok(effect), Some(latch)) = (answer, literal.latched.or(before.1.latched)) {
        does_what_is_said(effect, word, &latch);
    }
    taken
}

fn any_latch<const A: usize>(c: &mut impl Choice) -> Breakpoint<A> {
    let spindle = match any_direction(c) {
        direction if c.flag() => Some(SpindleState { direction, speed: c.word() }),
        _ => None,
    };
    Breakpoint { program: any_long(c), counts: core::array::from_fn(|_| any_long(c) as i64), spindle }
}

fn any_long(c: &mut impl Choice) -> u64 {
    u64::from(c.word()) << 32 | u64::from(c.word())
}

fn any_direction(c: &mut impl Choice) -> SpindleDirection {
    if c.flag() { SpindleDirection::Clockwise } else { SpindleDirection::Counterclockwise }
}

/// Any event; natively half of the numbers are the latched ones.
fn any_word<const A: usize>(c: &mut impl Choice, latch: &Breakpoint<A>) -> InterruptionEvent<A> {
    match c.below(7) {
        0 => InterruptionEvent::Pause(any_latch(c)),
        1 => InterruptionEvent::StopSpindle,
        2 => InterruptionEvent::StartSpindle(any_direction(c)),
        3 => InterruptionEvent::Jog,
        4 => InterruptionEvent::Online,
        5 => InterruptionEvent::CycleStart { program: if c.flag() { latch.program } else { any_long(c) } },
        _ => {
            InterruptionEvent::Arrived(latch.counts.map(|latched| if c.flag() { latched } else { any_long(c) as i64 }))
        }
    }
}

/// Any state and any event.
fn order_is_kept<const A: usize>(c: &mut impl Choice) -> Option<()> {
    let step = c.below(6);
    let latch = any_latch::<A>(c);
    let (mut real, mut literal) = both_at(step, &latch);
    let word = any_word(c, &latch);
    let taken = said_to_both(&mut real, &mut literal, word);
    cover!(c, Accepted, taken);
    cover!(c, Refused, !taken);
    cover!(c, SpindleTurns, step == 1 && latch.spindle.is_some());
    cover!(c, NormalRun, step == 0);
    cover!(c, AtEnd, step == 5 && literal.executes());
    let latch = literal.latched.unwrap_or(latch);
    holds!((real, literal) == both_at(literal.step(), &latch));
    Some(())
}

/// Motion from the program begins again by *arrived* alone, at exactly the latched counts; and before it, since the
/// last pause, every event of the order has occurred, each after the one before it.
fn one_way_back<const A: usize>(c: &mut impl Choice) -> Option<()> {
    let step = c.below(6);
    let latch = any_latch::<A>(c);
    let (real, literal) = both_at(step, &latch);
    let word = any_word(c, &latch);
    let mut after = real;
    c.assume(after.apply(word).is_ok())?;
    let mut expected = literal;
    expected.apply(word);
    let (from, to) = (literal.step(), expected.step());
    let next = match word {
        InterruptionEvent::Jog => to == from,
        InterruptionEvent::Pause(_) => {
            to == 1 || to == 3 && expected.latched.is_some_and(|latch| latch.spindle.is_none())
        }
        InterruptionEvent::StopSpindle => to == 2,
        InterruptionEvent::StartSpindle(_) => (from, to) == (2, 3),
        InterruptionEvent::Online => (from, to) == (3, 4),
        InterruptionEvent::CycleStart { program } => (from, to) == (4, 5) && program == latch.program,
        InterruptionEvent::Arrived(counts) => (from, to) == (5, 0) && counts == latch.counts,
    };
    holds!(next);
    cover!(c, NormalRun, from == 0);
    cover!(c, SpindleTurns, (from, to) == (2, 3));
    cover!(c, Rejoined, (from, to) == (5, 0));
    cover!(c, Backward, from > to && to > 0);
    holds!(
        after.may_read() == (to == 0)
            && (real.may_read() || !after.may_read() || matches!(word, InterruptionEvent::Arrived(_)))
    );
    Some(())
}

harnesses! {
    steps_order, unwind 7, covers [Accepted, Refused, SpindleTurns, NormalRun, AtEnd] => |c| order_is_kept::<4>(c);
    steps_way_back, unwind 7, covers [NormalRun, SpindleTurns, Rejoined, Backward] => |c| one_way_back::<4>(c);
}

/// Breadth first over every state that both machines can reach together, over a few values of everything.
#[cfg(not(any(kani, verify_wasm)))]
mod search {
    use super::{LiteralSteps, said_to_both};
    use crate::ledger::Size;
    use retrace_core::interruption::{Breakpoint, Interruption, InterruptionEvent, SpindleDirection, SpindleState};
    use std::collections::{HashSet, VecDeque};

    fn words() -> Vec<InterruptionEvent<2>> {
        let directions = [SpindleDirection::Clockwise, SpindleDirection::Counterclockwise];
        let turning = |speed: u32| directions.map(|direction| Some(SpindleState { direction, speed }));
        let spindles = [turning(1), turning(u32::MAX), [None; 2]].concat();
        let counts = [[0, 0], [0, 1], [1, 0], [1 << 32, 0], [i64::MIN, i64::MAX]];
        let mut words = vec![InterruptionEvent::StopSpindle, InterruptionEvent::Jog, InterruptionEvent::Online];
        words.extend(directions.map(InterruptionEvent::StartSpindle));
        words.extend(counts.map(InterruptionEvent::Arrived));
        for program in [0, 1, 1 << 32] {
            words.push(InterruptionEvent::CycleStart { program });
            for (counts, spindle) in counts.iter().flat_map(|c| spindles.iter().map(move |s| (*c, *s))) {
                words.push(InterruptionEvent::Pause(Breakpoint { program, counts, spindle }));
            }
        }
        words
    }

    pub(super) fn breadth_first(_: Size) -> String {
        let (words, first) = (words(), (Interruption::reading(), LiteralSteps::on_line()));
        let (mut seen, mut queue, mut taken) = (HashSet::from([first]), VecDeque::from([first]), 0u64);
        while let Some(before) = queue.pop_front() {
            for word in &words {
                let (mut real, mut literal) = before;
                taken += u64::from(said_to_both(&mut real, &mut literal, *word));
                if seen.insert((real, literal)) {
                    queue.push_back((real, literal));
                }
            }
        }
        format!("all {} reachable states, {} words in each, {taken} of them taken", seen.len(), words.len())
    }
}

#[cfg(not(any(kani, verify_wasm)))]
const FILE: &str = "crates/core/src/interruption.rs";

/// The rows of this module.
#[cfg(not(any(kani, verify_wasm)))]
pub const ROWS: &[Row] = &[
    Row {
        name: "dnc-order",
        says: "The core answers every event as the flags of the requirements do: the same events are accepted, the \
            three flags, the latch and reading are the same after each, what is commanded is what was latched; a \
            refused event changes nothing",
        requirement: "DNC-1 … DNC-8; Beyond the source, *A wrong order of steps*",
        bound: "none in the states, events and numbers: any program number, any counts of 4 axes, any speed; the \
            search: 2 axes, a few values, every sequence of events",
        assumes: "the machine follows its commands, and reports *arrived* with the counts at which its axes are at \
            rest",
        suffices: "every state is one that the events of the order lead to, and every event leads to such a state \
            again: an induction over sequences of any length",
        harnesses: &["steps_order"],
        searches: &[Search { name: "steps-search", run: search::breadth_first }],
        models: &[],
        mutants: &[
            Mutant {
                name: "the spindle starts in either direction",
                file: FILE,
                find: "if direction as u8 == turning.direction as u8 {",
                put: "if direction as u8 <= turning.direction as u8 {",
                killer: "steps_order",
            },
            Mutant {
                name: "a second pause moves the breakpoint",
                file: FILE,
                find: "(Some((latch, step)), event) => (*latch,",
                put: "(Some((_, step)), InterruptionEvent::Pause(latch)) => (latch, Self::transition(&latch, *step, \
                    event)),\n            (Some((latch, step)), event) => (*latch,",
                killer: "steps_order",
            },
            Mutant {
                name: "a refused word changes the step",
                file: FILE,
                find: "            Err(reason) => Err(reason),",
                put: "            Err(reason) => {\n                self.breakpoint = Some((latch, \
                    Step::SpindleStopped));\n                Err(reason)\n            }",
                killer: "steps-search",
            },
            Mutant {
                name: "the counts are compared in 32 bits",
                file: FILE,
                find: "if wanted[axis] != counts[axis] {",
                put: "if wanted[axis] as i32 != counts[axis] as i32 {",
                killer: "steps-search",
            },
        ],
    },
    Row {
        name: "dnc-way-back",
        says: "The program is read again by *arrived* alone, at exactly the latched counts, and since the last pause \
            the spindle was stopped and started (where it turned), on-line mode restored and the cycle started with \
            the same program, in this order",
        requirement: "DNC-3 … DNC-8",
        bound: "none, as dnc-order",
        assumes: "as dnc-order",
        suffices: "each accepted event leads to the next step, to itself, or back, from every state; so the events \
            since the last pause are the whole order wherever reading begins",
        harnesses: &["steps_way_back"],
        searches: &[],
        models: &[],
        mutants: &[
            Mutant {
                name: "cycle start before on-line mode is restored",
                file: FILE,
                find: "(Step::SpindleRestored, InterruptionEvent::CycleStart { .. }) => \
                    Err(InterruptionError::NotOnline)",
                put: "(Step::SpindleRestored, InterruptionEvent::CycleStart { .. }) => Ok((Step::Approaching, \
                    InterruptionAction::Approach(latch.counts)))",
                killer: "steps_way_back",
            },
            Mutant {
                name: "another program may take the place of the first",
                file: FILE,
                find: "if program != latch.program =>",
                put: "if program < latch.program =>",
                killer: "steps_way_back",
            },
            Mutant {
                name: "the last axis need not have arrived",
                file: FILE,
                find: "while axis < A {",
                put: "while axis + 1 < A {",
                killer: "steps_way_back",
            },
            Mutant {
                name: "a standing spindle is not a hindrance",
                file: FILE,
                find: "(Step::SpindleStopped, _) => Err(InterruptionError::SpindleNotRunning)",
                put: "(Step::SpindleStopped, _) => Ok((Step::OnlineRestored, InterruptionAction::Online))",
                killer: "steps_way_back",
            },
        ],
    },
];
