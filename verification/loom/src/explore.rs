//! Runs a model through every execution that loom generates, counts them, and collects their outcomes.
//!
//! Invariant: a report always has more than one execution; a model that loom explores only once checks nothing.

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Result of the exploration of a model.
#[derive(Debug)]
pub struct Report<O> {
    /// Executions explored.
    pub executions: u64,
    /// Every outcome of any of them.
    pub outcomes: BTreeSet<O>,
}

/// Whether the full exploration is requested (`RETRACE_FULL=1`), not the quick one.
#[must_use]
pub fn is_full() -> bool {
    std::env::var_os("RETRACE_FULL").is_some_and(|value| value == "1")
}

/// Explores `model` with at most `bound` preemptions in an execution (`None`: unlimited), prints one line and reports.
///
/// # Panics
/// Where an execution panics, races or blocks for ever, and where there is one execution only.
pub fn explore<O>(name: &str, bound: Option<usize>, model: impl Fn() -> O + Send + Sync + 'static) -> Report<O>
where
    O: Ord + Debug + Send + 'static,
{
    let seen = Arc::new(Mutex::new(Report { executions: 0, outcomes: BTreeSet::new() }));
    let collector = Arc::clone(&seen);
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = bound;
    builder.max_branches = 100_000;
    let started = Instant::now();
    builder.check(move || {
        let outcome = model();
        let mut report = collector.lock().expect("no execution panics and goes on");
        report.executions += 1;
        report.outcomes.insert(outcome);
    });
    let report = Arc::into_inner(seen).expect("the model is gone").into_inner().expect("no execution panicked");
    let Report { executions, outcomes } = &report;
    let bound = bound.map_or_else(|| "none".to_owned(), |bound| bound.to_string());
    let seconds = started.elapsed().as_secs_f64();
    println!("LOOM {name}: {executions} executions, outcomes {outcomes:?}, {seconds:.2} s, preemption bound {bound}");
    assert!(*executions > 1, "{name}: loom saw one execution only, which checks nothing");
    report
}
