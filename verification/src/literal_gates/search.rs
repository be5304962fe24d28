//! Breadth-first search over every state that a model can reach.
//!
//! Invariant: states are numbered in the order in which they are reached, so the first failing one is at the end of a
//! shortest trace.

use std::collections::HashMap;
use std::hash::Hash;

use super::{Counts, Failure, Trace};

/// A machine of several parts, each of which may take its next step at any time.
pub(super) trait Model {
    type State: Copy + Eq + Hash;
    type Step: Copy;

    fn start(&self) -> Self::State;
    /// Every possible next step, in a fixed order, with its result.
    fn steps(&self, state: &Self::State) -> Vec<(Self::Step, Self::State)>;
    fn failure(&self, state: &Self::State) -> Option<Failure>;
    /// Whether the program is at its end.
    fn is_end(&self, state: &Self::State) -> bool;
    fn program(&self) -> String;
    /// Description of the step, as taken from `state`.
    fn words(&self, state: &Self::State, step: Self::Step) -> String;
}

/// States reached, and how.
struct Reached<M: Model> {
    states: Vec<M::State>,
    /// The state and step by which each was reached first; none for the start.
    from: Vec<Option<(usize, M::Step)>>,
    /// Every step, as the numbers of two states.
    edges: Vec<(usize, usize)>,
    failing: Option<usize>,
}

/// A shortest trace to that failure.
pub(super) fn shortest<M: Model>(model: &M, failure: Failure) -> Option<Trace> {
    let reached = reach(model, |found| found == failure);
    reached.failing.map(|failing| trace(model, &reached, failing, failure))
}

/// Explores every state: whether there is a failure, and whether the end can be reached from all of them.
pub(super) fn everything<M: Model>(model: &M) -> Counts {
    let reached = reach(model, |_| true);
    let failure = reached.failing.and_then(|failing| {
        let failure = model.failure(&reached.states[failing])?;
        Some(trace(model, &reached, failing, failure))
    });
    // a search that failed stopped there, and did not find the other states
    let stuck = if failure.is_none() { stuck(model, &reached) } else { 0 };
    Counts { programs: 1, states: reached.states.len(), steps: reached.edges.len(), stuck, failure }
}

/// Reaches every state, or those up to the first failure that is `wanted`. Nothing follows another failure.
fn reach<M: Model>(model: &M, wanted: impl Fn(Failure) -> bool) -> Reached<M> {
    let start = model.start();
    let mut numbers = HashMap::from([(start, 0)]);
    let mut reached = Reached { states: vec![start], from: vec![None], edges: Vec::new(), failing: None };
    let mut next = 0;
    while let Some(state) = reached.states.get(next).copied() {
        match model.failure(&state) {
            Some(found) if wanted(found) => {
                reached.failing = Some(next);
                break;
            }
            Some(_) => {}
            None => {
                for (step, after) in model.steps(&state) {
                    let number = *numbers.entry(after).or_insert_with(|| {
                        reached.states.push(after);
                        reached.from.push(Some((next, step)));
                        reached.states.len() - 1
                    });
                    reached.edges.push((next, number));
                }
            }
        }
        next += 1;
    }
    reached
}

fn trace<M: Model>(model: &M, reached: &Reached<M>, failing: usize, failure: Failure) -> Trace {
    let mut steps = Vec::new();
    let mut at = failing;
    while let Some((before, step)) = reached.from[at] {
        steps.push(model.words(&reached.states[before], step));
        at = before;
    }
    steps.reverse();
    Trace { program: model.program(), steps, failure }
}

/// Number of states from which the end cannot be reached.
fn stuck<M: Model>(model: &M, reached: &Reached<M>) -> usize {
    let mut before = vec![Vec::new(); reached.states.len()];
    for (from, to) in &reached.edges {
        before[*to].push(*from);
    }
    let mut gets_there: Vec<bool> = reached.states.iter().map(|state| model.is_end(state)).collect();
    let mut open: Vec<usize> = (0..gets_there.len()).filter(|number| gets_there[*number]).collect();
    while let Some(number) = open.pop() {
        for from in &before[number] {
            if !gets_there[*from] {
                gets_there[*from] = true;
                open.push(*from);
            }
        }
    }
    gets_there.iter().filter(|gets_there| !**gets_there).count()
}
