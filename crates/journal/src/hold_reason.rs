//! Reason of a hold: telemetry reports it, and the journal stores it with every position.
//!
//! Invariant: its names in the journal are those of the variants in snake case.

use serde::{Deserialize, Serialize};

/// Reason why the machine is at rest in normal run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HoldReason {
    /// No hold by the operator: the machine runs, or waits for records or for an instruction.
    #[default]
    None,
    /// Feed hold.
    Hold,
    /// A program stop (M0) waits for cycle start.
    ProgramStop,
    /// Single block waits for cycle start.
    SingleBlock,
    /// The program has ended and the operator has not released the job: reverse run is still possible.
    Ended,
    /// The program is paused at a breakpoint, until the axes are back there (DNC-1 … DNC-7). Events have the details.
    Paused,
}
