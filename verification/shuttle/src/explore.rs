//! Runs a model under many schedules, counts them, and collects their outcomes.
//!
//! Invariant: the seed is fixed, so a run that fails once fails always (`SHUTTLE_RANDOM_SEED` sets another one).

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use shuttle::scheduler::{PctScheduler, RandomScheduler, Scheduler};
use shuttle::{Config, MaxSteps, Runner};

/// Seed of every exploration.
const SEED: u64 = 0x5eed_0003;
/// Number of places at which the PCT scheduler changes priorities: a failure may need that many ordering constraints.
const DEPTH: usize = 3;

/// Result of the exploration of a model.
#[derive(Debug)]
pub struct Report<O> {
    /// Schedules run.
    pub schedules: usize,
    /// Every outcome of any of them.
    pub outcomes: BTreeSet<O>,
}

/// Whether the full exploration is requested (`RETRACE_FULL=1`), not the quick one.
#[must_use]
pub fn is_full() -> bool {
    std::env::var_os("RETRACE_FULL").is_some_and(|value| value == "1")
}

/// Runs `model` under `schedules` schedules of either kind, random and PCT (priorities that change at a few places),
/// prints one line and reports.
///
/// # Panics
/// Where a schedule panics or blocks for ever.
pub fn explore<O>(name: &str, schedules: usize, model: impl Fn() -> O + Send + Sync + 'static) -> Report<O>
where
    O: Ord + Debug + Send + 'static,
{
    let started = Instant::now();
    let outcomes = Arc::new(Mutex::new(BTreeSet::new()));
    let model = Arc::new(model);
    let run = |scheduler: Box<dyn Scheduler + Send>| {
        let (model, outcomes) = (Arc::clone(&model), Arc::clone(&outcomes));
        let mut config = Config::new();
        config.max_steps = MaxSteps::FailAfter(1_000_000);
        Runner::new(scheduler, config).run(move || {
            let outcome = model();
            outcomes.lock().expect("no schedule panics and goes on").insert(outcome);
        })
    };
    let schedules = run(Box::new(RandomScheduler::new_from_seed(SEED, schedules)))
        + run(Box::new(PctScheduler::new_from_seed(SEED, DEPTH, schedules)));
    let outcomes = Arc::into_inner(outcomes).expect("the model is gone").into_inner().expect("no schedule panicked");
    let shown = match (outcomes.first(), outcomes.last()) {
        (Some(first), Some(last)) if outcomes.len() > 16 => {
            format!("{{{first:?} … {last:?}}}, {} of them", outcomes.len())
        }
        _ => format!("{outcomes:?}"),
    };
    println!("SHUTTLE {name}: {schedules} schedules, outcomes {shown}, {:.2} s", started.elapsed().as_secs_f64());
    Report { schedules, outcomes }
}
