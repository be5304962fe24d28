//! A tool length that is entered while the program is paused (a broken tool was changed): who proposes it, and who has to agree.
//!
//! Records are differences, so a tool of another length needs no new plan: the same path is run, moved along the tool axis by the difference
//! of the lengths. That holds up to the first move to machine coordinates, tool change, or change of the tool offset, which is planned from
//! where the machine then stands. Only the planning thread knows what it has planned and which offset is in force; only the motion path knows
//! where the machine stands, and what is in the ring. So the motion path proposes, the planning thread offers, the motion path
//! decides, and the planning thread keeps it.
//!
//! Invariant: nothing moves by a length that was entered before it is durable; neither side waits for the other but in virtual time.

use std::fmt;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};

/// A tool length as the operator enters it, mm along the tool axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EnteredLength {
    /// The tool length offset of the new tool, in the place of the one in force.
    To(f64),
    /// The new tool is longer by so much; shorter where it is negative.
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

/// A length that was entered and holds from behind a block on, until the program changes its tool offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LengthChange {
    /// Number of the block of the decoder, from 1, behind which it holds; 0 is the program's beginning.
    pub block: u64,
    /// By how much the path is moved along the tool axis, pulses.
    pub pulses: i64,
}

/// What the motion path says.
#[derive(Clone, Copy, Debug, PartialEq)]
enum LengthRequest {
    Propose(LengthProposal),
    Decide(bool),
}

/// A length that the operator wants to enter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LengthProposal {
    pub(crate) length: EnteredLength,
    /// The record that the machine stands in, or before.
    pub(crate) place: u32,
}

/// What entering a length would come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LengthOffer {
    /// By how much the path would be moved along the tool axis, pulses.
    pub(crate) pulses: i64,
    /// The records up to here are in the ring and would be moved: whoever decides looks whether that goes.
    pub(crate) planned: u32,
    /// The tool length offset that there would be, mm; none where no offset is in force.
    pub(crate) length_mm: Option<f64>,
}

/// Why there is no offer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ToolLengthError {
    /// The machine has no tool axis.
    NoToolAxis,
    /// No tool length offset is in force that a new one could take the place of.
    NoOffset,
    /// A move to machine coordinates, or another offset, is planned already and not passed yet.
    Planned,
    /// Moves that are planned would leave the soft limits of the axis.
    BeyondLimit(char),
}

impl fmt::Display for ToolLengthError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoToolAxis => write!(f, "the machine has no tool axis: tool_axis in the machine file names it"),
            Self::NoOffset => write!(
                f,
                "no tool length offset (G43) is in force: enter how much longer the new tool is, as in `tool length by 1.5`"
            ),
            Self::Planned => write!(
                f,
                "a move to machine coordinates (G53, G28, G30), a tool change or another tool offset is planned already: go on until it is \
                 passed, or stop the job"
            ),
            Self::BeyondLimit(axis) => {
                write!(f, "with this tool axis {} would go beyond its soft limit", axis.to_ascii_uppercase())
            }
        }
    }
}

/// An answer of the planning thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum LengthAnswer {
    Offer(LengthOffer),
    No(ToolLengthError),
    /// What was decided is durable, and in force.
    Kept,
}

/// The two ends between the motion path and the planning thread.
pub(crate) fn entry() -> (LengthEntry, LengthOffers) {
    let ((said, heard), (answers, answered)) = (sync_channel(2), sync_channel(2));
    (LengthEntry { said, answered }, LengthOffers { heard, answers })
}

/// The motion path's end.
#[derive(Debug)]
pub(crate) struct LengthEntry {
    said: SyncSender<LengthRequest>,
    answered: Receiver<LengthAnswer>,
}

impl LengthEntry {
    /// Proposes a length; one at a time.
    pub(crate) fn propose(&mut self, proposal: LengthProposal) {
        let _ = self.said.try_send(LengthRequest::Propose(proposal));
    }

    /// Decides on the offer that was answered.
    pub(crate) fn decide(&mut self, taken: bool) {
        let _ = self.said.try_send(LengthRequest::Decide(taken));
    }

    /// The answer, once there is one.
    pub(crate) fn answer(&mut self) -> Option<LengthAnswer> {
        self.answered.try_recv().ok()
    }
}

/// The planning thread's end.
#[derive(Debug)]
pub(crate) struct LengthOffers {
    heard: Receiver<LengthRequest>,
    answers: SyncSender<LengthAnswer>,
}

impl LengthOffers {
    pub(crate) fn proposal(&mut self) -> Option<LengthProposal> {
        match self.heard.try_recv() {
            Ok(LengthRequest::Propose(proposal)) => Some(proposal),
            _ => None,
        }
    }

    /// The decision, once there is one; whoever should decide and is gone takes nothing.
    pub(crate) fn decision(&mut self) -> Option<bool> {
        match self.heard.try_recv() {
            Ok(LengthRequest::Decide(taken)) => Some(taken),
            Ok(LengthRequest::Propose(_)) | Err(TryRecvError::Disconnected) => Some(false),
            Err(TryRecvError::Empty) => None,
        }
    }

    pub(crate) fn answer(&mut self, answer: LengthAnswer) {
        let _ = self.answers.try_send(answer);
    }
}
