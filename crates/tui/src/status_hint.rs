//! Status of the machine: a word or two, why, and the actions that apply.
//!
//! Invariant: nothing here decides what applies.

use crate::keys::KeyAction;

/// Severity of a status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum HintLevel {
    /// Normal operation.
    Normal,
    /// Waits for the operator.
    Waiting,
    /// Alarm.
    Alarm,
}

/// Status of the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StatusHint {
    /// Status in a word or two.
    pub status: &'static str,
    /// Reason, in one line.
    pub reason: String,
    /// Severity.
    pub level: HintLevel,
    /// Actions that apply, the most useful first.
    pub actions: Vec<KeyAction>,
}

/// A status with its reason, and the actions that apply.
pub(crate) fn hint(level: HintLevel, word: &'static str, why: impl Into<String>, actions: &[KeyAction]) -> StatusHint {
    StatusHint { status: word, reason: why.into(), level, actions: actions.to_vec() }
}
