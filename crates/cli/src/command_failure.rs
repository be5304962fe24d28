//! Why a command failed, and with which exit code.
//!
//! Invariant: errors of a program have been printed; those of the command have not.

use std::fmt;

use retrace_config::NumberedError;

/// Why a command failed.
#[derive(Debug)]
pub enum CommandFailure {
    /// Wrong usage, machine file or script: exit code 2.
    Input(NumberedError),
    /// Card or serial line: exit code 3.
    Card(NumberedError),
    /// The program has errors, which have been printed: exit code 1.
    Program,
}

impl fmt::Display for CommandFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(error) | Self::Card(error) => error.fmt(f),
            Self::Program => f.write_str("the program has errors"),
        }
    }
}

impl std::error::Error for CommandFailure {}

impl From<NumberedError> for CommandFailure {
    fn from(refusal: NumberedError) -> Self {
        Self::Input(refusal)
    }
}
