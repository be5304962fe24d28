//! Analysis of a program that was not checked before: it is decoded once, and its threads are planned beside it.
//!
//! Invariant: a program that passes has the analysis that it has behind a check. Why another one does not pass is found
//! by its check.

use std::sync::mpsc;
use std::thread;

use retrace_config::MachineConfig;

use crate::block_decoder::BlockDecoder;
use crate::program_analysis::{Analysed, ProgramAnalysis, analyse};
use crate::thread_plans::{ThreadPlans, plan_queued};

/// Maximum number of stretches of threads that wait to be planned.
const MAX_QUEUED: usize = 256;

/// Analyses a whole program that was not checked before; its threads are planned in a thread of their own. Returns the
/// number of blocks, the findings, and the analysis. Returns `None` where a thread cannot be planned, or the planner
/// does not accept the limits: a check, or [`crate::analyse_program`], has the reason.
pub fn analyse_unchecked<'m, const A: usize>(
    machine: &'m MachineConfig,
    program: &mut impl BlockDecoder,
) -> Option<Analysed<'m, A>> {
    let mut analysis = ProgramAnalysis::new(machine).ok()?;
    if machine.encoder.is_none() {
        return analyse(machine, program, analysis, &mut drop).ok();
    }
    thread::scope(|scope| {
        let (sender, queue) = mpsc::sync_channel(MAX_QUEUED);
        let planner = scope.spawn(move || plan_queued(machine, &queue));
        analysis.thread_plans = ThreadPlans::Beside(sender);
        let (blocks, findings, mut analysis) = analyse(machine, program, analysis, &mut drop).ok()?;
        // Nothing more is sent, so that the other thread ends.
        analysis.thread_plans = ThreadPlans::Known;
        let planned = planner.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)).ok()?;
        planned.iter().for_each(|(line, run_mm)| analysis.threads.add(line, run_mm));
        Some((blocks, findings, analysis))
    })
}
