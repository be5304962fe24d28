//! What plans the threads of a program that is analysed: the analysis as it comes to them, or another thread beside it.
//!
//! Invariant: the run-in and run-out of a thread do not depend on when it is planned.

use std::sync::mpsc::{Receiver, SyncSender};

use retrace_config::{EncoderConfig, MachineConfig};

use crate::thread_plan::{ThreadCheck, ThreadError, ThreadRuns, ThreadStretch};

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
pub(crate) fn plan_queued<const A: usize>(
    machine: &MachineConfig,
    queue: &Receiver<QueuedStretch<A>>,
) -> Result<ThreadRuns, ThreadError> {
    let (mut check, mut threads) = (ThreadCheck::default(), ThreadRuns::default());
    for QueuedStretch { stretch, encoder, from_mm } in queue {
        threads.add(stretch.line(), check.run_mm(&stretch, machine, &encoder, from_mm)?);
    }
    Ok(threads)
}
