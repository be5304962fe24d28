//! Reasons why the plan writer rejects a move.
//!
//! Invariant: a rejected move has changed nothing.

use retrace_motion::MoveError;

use crate::soft_limits::LimitFinding;
use crate::thread_plan::ThreadError;

/// The motion path has ended: planning is cancelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cancelled;

impl std::fmt::Display for Cancelled {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("planning is cancelled: the motion path has ended")
    }
}

impl std::error::Error for Cancelled {}

/// Reason why a move was rejected.
#[derive(Clone, Debug, PartialEq)]
pub enum PlanWriteError {
    /// The planner cannot run it.
    Move(MoveError),
    /// The move would leave the soft limits.
    BeyondLimit(LimitFinding),
    /// The machine cannot follow the spindle in the thread that begins in this line.
    Thread(ThreadError, u32),
    /// An answer of the machine is not one to the program's question.
    AnswerMismatch,
    /// Planning is cancelled.
    Cancelled,
}

impl std::fmt::Display for PlanWriteError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Move(error) => write!(f, "{error}"),
            Self::BeyondLimit(finding) => f.write_str(&finding.what()),
            Self::Thread(error, line) => write!(f, "line {line}: {error}"),
            Self::AnswerMismatch => f.write_str("an answer of the machine is not one to the program's question"),
            Self::Cancelled => write!(f, "{Cancelled}"),
        }
    }
}

impl std::error::Error for PlanWriteError {}

impl PlanWriteError {
    /// The error of a thread that begins in this line.
    pub(crate) const fn of_thread(error: ThreadError, line: u32) -> Self {
        match error {
            ThreadError::Move(error) => Self::Move(error),
            error => Self::Thread(error, line),
        }
    }
}

impl From<Cancelled> for PlanWriteError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<MoveError> for PlanWriteError {
    fn from(error: MoveError) -> Self {
        Self::Move(error)
    }
}
