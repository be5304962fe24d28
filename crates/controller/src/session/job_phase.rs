//! The phase of a job, and its stops.
//!
//! Invariant: a job that was stopped, or released after its end, executes nothing more.

/// Progress of a job. It ends when the machine is at rest in a phase that is stopping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum JobPhase {
    Running,
    /// Everything was executed once; the job waits for its release.
    ProgramEnded,
    /// The job was stopped before the end of its program.
    Stopping,
    /// The job was released after the end of its program.
    Released,
}

impl JobPhase {
    /// Stops or releases the job.
    pub(super) fn stop(&mut self) {
        *self = if self.program_has_ended() { Self::Released } else { Self::Stopping };
    }

    pub(super) fn is_stopping(self) -> bool {
        matches!(self, Self::Stopping | Self::Released)
    }

    pub(super) fn program_has_ended(self) -> bool {
        matches!(self, Self::ProgramEnded | Self::Released)
    }
}

/// Whether the machine is at rest at a program stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ProgramStop {
    No,
    /// Until cycle start.
    Waiting,
    /// Cycle start was pressed; the instruction has not been sent yet.
    Continued,
}
