//! A program as a source of canonical functions, block by block.
//!
//! Invariant: a decoder knows no machine and no port; blocks come in the order of their execution.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use retrace_gcode::{ActiveCodes, CanonStep, ProgramLocation};

use crate::jog_planner::Identify;
use crate::question::MachineResult;

/// A program as a source of canonical functions.
pub trait BlockDecoder {
    /// Decodes the next block and appends its steps to `steps`.
    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock;

    /// Replaces the assumed result of the last question to the machine by the machine's.
    fn resolve(&mut self, _result: &MachineResult) {}

    /// The modal state behind the last block, where the source has one.
    fn active(&self) -> Option<ActiveCodes> {
        None
    }

    /// The place of the last block with the calls and loops around it, where the source has one.
    fn location(&self) -> Option<ProgramLocation> {
        None
    }

    /// The token to set when the program is not needed any more, so that a source that waits for bytes stops waiting.
    fn cancel_token(&self) -> Option<Arc<AtomicBool>> {
        None
    }

    /// Determines which program would be read now if it were read again. Called in its own thread before a paused
    /// program resumes (DNC-6). None where the program cannot be read a second time.
    fn identity(&self) -> Option<Identify> {
        None
    }
}

/// Result of decoding a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DecodedBlock {
    /// The block is decoded; more may follow.
    Block,
    /// The end of the program.
    End,
    /// The block has errors: rendered, with place, source line and remedy.
    BlockError(String),
}
