//! Questions of a program to the machine, and what the program learns (PRB-7, PRB-11, PRB-12).
//!
//! Invariant: a question is whole numbers, so that a resumed job asks the same one.

use retrace_gcode::WaitFor;

use crate::probe_move::{ProbeMove, ProbeResult};
use crate::tap_move::TapQuestion;

/// A question to the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Question {
    /// Where does the probe respond?
    Probe(ProbeMove),
    /// When does an input change, or what is its level?
    Input(InputQuestion),
    /// Tap, and come back.
    Tap(TapQuestion),
}

/// An input that a program reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadInput {
    /// A digital input, by its number.
    Digital(u8),
    /// An analog input.
    Analog {
        /// Its number.
        number: u8,
        /// Control periods at rest after which what the card has reported was read at this place.
        report_periods: u64,
    },
}

/// A wait for an input (M66).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputQuestion {
    /// The input.
    pub input: ReadInput,
    /// Condition that ends the wait.
    pub wait_for: WaitFor,
    /// Control periods after which it ends without.
    pub timeout_periods: u64,
}

impl Question {
    /// Its code in the program.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::Probe(question) => question.code(),
            Self::Input(_) => "M66",
            Self::Tap(_) => "rigid tap",
        }
    }
}

/// What the program learns.
#[derive(Clone, Debug, PartialEq)]
pub enum MachineResult {
    /// Of a probing move.
    Probe(ProbeResult),
    /// Of M66: the level of the input, 1 or 0, or the amount of an analog one; −1 where the time was over.
    Input(f64),
}
