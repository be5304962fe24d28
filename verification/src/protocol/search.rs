//! Breadth-first search over the states of the model.
//!
//! Invariant: each layer has every state that is reached by so many steps and by no fewer. A failing state is therefore
//! at the end of a shortest trace, which is printed.

use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Instant;

use super::STARTS;
use super::world::{Begin, Budget, Step, World};

/// Where a search begins and how far it goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    pub(super) name: &'static str,
    pub(super) begin: Begin,
    pub(super) budget: Budget,
    /// Depth for each of the first [`super::STARTS`].
    pub(super) depths: &'static [u32],
}

/// The steps that lead to a state, the last one first.
struct Trace {
    step: Step,
    before: Option<Rc<Trace>>,
}

impl Trace {
    fn words(trace: Option<&Rc<Self>>) -> String {
        let mut steps = Vec::new();
        let mut at = trace;
        while let Some(trace) = at {
            steps.push(format!("{:?}", trace.step));
            at = trace.before.as_ref();
        }
        steps.reverse();
        steps.join(", ")
    }
}

/// What a search saw.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    pub(super) states: usize,
    pub(super) steps: usize,
    /// Most periods until everything was settled.
    pub(super) periods: u32,
}

/// Reaches every state of the plan from one of the starts, or ends when another search has `failed`.
fn reach(plan: &Plan, start: usize, failed: &AtomicBool) -> Seen {
    let ((numbers, last_epoch), most) = (STARTS[start], plan.depths[start]);
    let start = World::begin(plan.begin, numbers, last_epoch, plan.budget);
    let mut known = HashSet::from([start.fingerprint()]);
    // states from which everything settles
    let mut settled = HashSet::new();
    let mut layer: Vec<(World, Option<Rc<Trace>>)> = vec![(start, None)];
    let mut seen = Seen { states: 1, ..Seen::default() };
    for depth in 0..=most {
        let mut next = Vec::new();
        for (world, trace) in layer {
            if failed.load(Ordering::Relaxed) {
                return seen;
            }
            let found = catch_unwind(AssertUnwindSafe(|| {
                let periods = world.clone().settle(&mut |state| settled.insert(state));
                (periods, if depth < most { world.steps() } else { Vec::new() })
            }));
            let (periods, steps) = found.unwrap_or_else(|panic| {
                failed.store(true, Ordering::Relaxed);
                let claim = panic.downcast_ref::<String>().map(String::as_str);
                let claim = claim.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or_default();
                let steps = Trace::words(trace.as_ref());
                panic!("{} from {numbers:?}, in the step after [{steps}] or at rest after it: {claim}", plan.name);
            });
            seen.periods = seen.periods.max(periods);
            seen.steps += steps.len();
            for (step, after) in steps {
                if known.insert(after.fingerprint()) {
                    seen.states += 1;
                    next.push((after, Some(Rc::new(Trace { step, before: trace.clone() }))));
                }
            }
        }
        layer = next;
    }
    seen
}

/// Runs every plan from every start, on as many threads as there are processors, and describes what was seen.
pub(super) fn run(plans: &[Plan]) -> String {
    let begun = Instant::now();
    let jobs: Vec<(usize, usize)> =
        plans.iter().enumerate().flat_map(|(plan, of)| (0..of.depths.len()).map(move |start| (plan, start))).collect();
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let work = || {
        let mut results = Vec::new();
        while let Some(&(plan, start)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
            results.push((plan, reach(&plans[plan], start, &failed)));
        }
        results
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let results: Vec<(usize, Seen)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    let mut words = Vec::new();
    for (number, plan) in plans.iter().enumerate() {
        let seen = || results.iter().filter(|(of, _)| *of == number).map(|(_, seen)| seen);
        let (states, steps) = (seen().map(|seen| seen.states).sum::<usize>(), seen().map(|s| s.steps).sum::<usize>());
        let periods = seen().map(|seen| seen.periods).max().unwrap_or(0);
        let depths = plan.depths.iter().map(u32::to_string).collect::<Vec<_>>().join("/");
        words.push(format!(
            "{}: {states} states, {steps} steps, depth {depths}, at rest after {periods} periods",
            plan.name
        ));
    }
    format!("{}; {:.1} s", words.join("; "), begun.elapsed().as_secs_f64())
}
