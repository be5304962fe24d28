//! What plans the threads of a program that is analysed: the analysis as it comes to them, or another thread beside it.
//!
//! Invariant: the run-in and run-out of a thread do not depend on when it is planned.

use std::sync::mpsc::{self, Receiver, SyncSender};
use std::thread;

use retrace_config::{EncoderConfig, MachineConfig};

use crate::block_decoder::BlockDecoder;
use crate::program_analysis::{Analysed, ProgramAnalysis, analyse};
use crate::thread_plan::{ThreadCheck, ThreadError, ThreadRuns, ThreadStretch};

/// Maximum number of stretches that wait to be planned.
const MAX_QUEUED: usize = 256;

/// What plans the threads of an analysis.
#[derive(Debug)]
pub(crate) enum ThreadPlans<const A: usize> {
    /// Nothing: they were planned before.
    Known,
    /// The analysis itself.
    Here(Box<ThreadCheck>),
    /// Another thread, which is given the stretches.
    Beside(SyncSender<QueuedStretch<A>>),
}

impl<const A: usize> Default for ThreadPlans<A> {
    fn default() -> Self {
        Self::Here(Box::default())
    }
}

/// A stretch that waits to be planned.
#[derive(Debug)]
pub(crate) struct QueuedStretch<const A: usize> {
    stretch: ThreadStretch<A>,
    encoder: EncoderConfig,
    from_mm: [f64; A],
}

impl<const A: usize> ThreadPlans<A> {
    /// Whether the threads were planned before.
    pub(crate) fn are_known(&self) -> bool {
        matches!(self, Self::Known)
    }

    /// Run-in and run-out of a stretch from a position at rest, mm; `None` where they are found elsewhere.
    ///
    /// # Errors
    /// The reason why the machine cannot follow a spindle there.
    pub(crate) fn run_mm(
        &mut self,
        stretch: &ThreadStretch<A>,
        machine: &MachineConfig,
        encoder: &EncoderConfig,
        from_mm: [f64; A],
    ) -> Result<Option<[f64; 2]>, ThreadError> {
        match self {
            Self::Known => Ok(None),
            Self::Here(check) => check.run_mm(stretch, machine, encoder, from_mm).map(Some),
            Self::Beside(queue) => {
                // The other thread has ended where a stretch before cannot be planned.
                let _ = queue.send(QueuedStretch { stretch: stretch.clone(), encoder: *encoder, from_mm });
                Ok(None)
            }
        }
    }
}

/// Plans the stretches of a program, until it has no more or one cannot be planned.
fn plan_queued<const A: usize>(
    machine: &MachineConfig,
    queue: &Receiver<QueuedStretch<A>>,
) -> Result<ThreadRuns, ThreadError> {
    let (mut check, mut threads) = (ThreadCheck::default(), ThreadRuns::default());
    for QueuedStretch { stretch, encoder, from_mm } in queue {
        threads.add(stretch.line(), check.run_mm(&stretch, machine, &encoder, from_mm)?);
    }
    Ok(threads)
}

/// Analyses a whole program that was not checked before; its threads are planned in a thread of their own. Returns the
/// number of blocks, the findings, and the analysis. Returns `None` where a thread, or nothing, can be planned: a check
/// has the reason.
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
