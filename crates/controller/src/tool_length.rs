//! Entry of a tool length while the program is paused (a broken tool was changed): a proposal, an offer and a decision
//! between two threads.
//!
//! Records are differences, so a tool of another length needs no new plan: the same path is run, moved along the tool
//! axis by the difference of the lengths. That applies up to the first move to machine coordinates, tool change, or
//! change of the tool offset, which is planned from the machine's position then. Only the planning thread knows what it
//! has planned and which offset is in force; only the motion path knows the machine's position and the contents of the
//! ring. So the motion path proposes, the planning thread offers, the motion path decides, and the planning thread
//! stores the length.
//!
//! Invariant: nothing moves by an entered length before it is durable. Neither side waits for the other except in
//! virtual time.

use retrace_core::RecordIndex;
use std::fmt;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};

/// A tool length as the operator enters it, mm along the tool axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EnteredLength {
    /// The tool length offset of the new tool, which replaces the one in force.
    To(f64),
    /// The new tool is longer by this; shorter where it is negative.
    By(f64),
}

impl fmt::Display for EnteredLength {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::To(mm) => write!(f, "tool length {mm}"),
            Self::By(mm) => write!(f, "tool length by {mm}"),
        }
    }
}

/// A message from the motion path.
#[derive(Clone, Copy, Debug, PartialEq)]
enum LengthRequest {
    Propose(LengthProposal),
    Decide(bool),
}

/// A length that the operator requests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LengthProposal {
    pub(crate) length: EnteredLength,
    /// Record at or before which the machine is.
    pub(crate) place: RecordIndex,
}

/// Effect of entering a length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LengthOffer {
    /// Distance by which the path would be moved along the tool axis, pulses.
    pub(crate) pulses: i64,
    /// The records up to here are in the ring and would be moved: the motion path checks them.
    pub(crate) planned: RecordIndex,
    /// The resulting tool length offset, mm. None where no offset is in force.
    pub(crate) length_mm: Option<f64>,
}

/// Reason why there is no offer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToolLengthError {
    /// The machine has no tool axis.
    NoToolAxis,
    /// No tool length offset is in force that a new one could replace.
    NoOffset,
    /// A move to machine coordinates, or another offset, is planned already and not passed yet.
    Planned,
    /// Planned moves would leave the soft limits of the axis.
    BeyondLimit(char),
}

impl fmt::Display for ToolLengthError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoToolAxis => write!(f, "the machine has no tool axis: tool_axis in the machine file names it"),
            Self::NoOffset => write!(
                f,
                "no tool length offset (G43) is in force: enter the difference of the tool lengths, as in `tool \
                    length by 1.5`"
            ),
            Self::Planned => write!(
                f,
                "a move to machine coordinates (G53, G28, G30), a tool change or another tool offset is planned \
                    already: resume until it is \
                 passed, or stop the job"
            ),
            Self::BeyondLimit(axis) => {
                write!(f, "with this tool axis {} would go beyond its soft limit", axis.to_ascii_uppercase())
            }
        }
    }
}

impl std::error::Error for ToolLengthError {}

/// An answer of the planning thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum LengthAnswer {
    Offer(LengthOffer),
    No(ToolLengthError),
    /// The accepted length is durable, and in force.
    Stored,
}

/// Creates the motion path's and the planning thread's end.
pub(crate) fn length_channel() -> (LengthEntry, LengthOffers) {
    let ((result, heard), (answers, answered)) = (sync_channel(2), sync_channel(2));
    (LengthEntry { requests: result, answers: answered }, LengthOffers { requests: heard, answers })
}

/// The motion path's end.
#[derive(Debug)]
pub(crate) struct LengthEntry {
    requests: SyncSender<LengthRequest>,
    answers: Receiver<LengthAnswer>,
}

impl LengthEntry {
    /// Proposes a length; one at a time.
    pub(crate) fn propose(&mut self, proposal: LengthProposal) {
        let _ = self.requests.try_send(LengthRequest::Propose(proposal));
    }

    /// Decides on the offer.
    pub(crate) fn decide(&mut self, taken: bool) {
        let _ = self.requests.try_send(LengthRequest::Decide(taken));
    }

    /// The answer, once it has arrived.
    pub(crate) fn answer(&mut self) -> Option<LengthAnswer> {
        self.answers.try_recv().ok()
    }
}

/// The planning thread's end.
#[derive(Debug)]
pub(crate) struct LengthOffers {
    requests: Receiver<LengthRequest>,
    answers: SyncSender<LengthAnswer>,
}

impl LengthOffers {
    pub(crate) fn proposal(&mut self) -> Option<LengthProposal> {
        match self.requests.try_recv() {
            Ok(LengthRequest::Propose(proposal)) => Some(proposal),
            _ => None,
        }
    }

    /// The decision, once it has arrived. A motion path that is gone accepts nothing.
    pub(crate) fn decision(&mut self) -> Option<bool> {
        match self.requests.try_recv() {
            Ok(LengthRequest::Decide(taken)) => Some(taken),
            Ok(LengthRequest::Propose(_)) | Err(TryRecvError::Disconnected) => Some(false),
            Err(TryRecvError::Empty) => None,
        }
    }

    pub(crate) fn answer(&mut self, answer: LengthAnswer) {
        let _ = self.answers.try_send(answer);
    }
}
