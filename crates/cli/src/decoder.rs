//! Program decoder, block by block, for planning and for checks.
//!
//! Invariant: an error at the program's end is reported once; the outputs of a run are stored only at the program's
//! end, and only in a run.

use std::io::BufRead;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use retrace_controller::{BlockDecoder, DecodedBlock, Identify, MachineResult};
use retrace_gcode::{ActiveCodes, Canon, CanonStep, ProgramLocation, Progress, Severity};
use retrace_journal::FileHash;

use crate::check_progress::CheckProgress;
use crate::run_outputs::RunOutputs;

/// Program in the interpreter.
pub type Source = retrace_gcode::Program<Box<dyn BufRead + Send>>;

/// Program that is being decoded.
pub struct Decoder {
    pub(super) name: String,
    pub(super) program: Source,
    /// Cancel token of a stream.
    pub(super) given_up: Option<Arc<AtomicBool>>,
    /// File that it is read from, to be compared with what was read.
    pub(super) file: Option<PathBuf>,
    /// Whether a tool length offset was called.
    pub(super) length_offset: bool,
    /// Whether the program has ended and its last error has been reported.
    pub(super) end_is_reported: bool,
    /// Outputs of a run; `None` in a check.
    pub(super) outputs: Option<RunOutputs>,
    /// Maximum number of blocks in loops and calls; `None` in a run.
    pub(super) max_loop_blocks: Option<u64>,
    /// Whether the program has ended.
    pub(super) is_at_end: bool,
    /// Progress bar; `None` in a run.
    pub(super) progress: Option<CheckProgress>,
}

/// Maximum number of blocks in loops and calls for a program with errors: more would only delay its errors.
const MAX_LOOP_BLOCKS_WITH_ERRORS: u64 = 100_000;

impl BlockDecoder for Decoder {
    fn cancel_token(&self) -> Option<Arc<AtomicBool>> {
        self.given_up.clone()
    }

    fn active(&self) -> Option<ActiveCodes> {
        Some(self.program.interpreter().state().into())
    }

    fn location(&self) -> Option<ProgramLocation> {
        Some(self.program.location())
    }

    fn identity(&self) -> Option<Identify> {
        let file = self.file.clone()?;
        Some(Box::new(move || {
            let hash = std::fs::File::open(&file).and_then(FileHash::of_reader);
            // A missing file differs from any file that exists.
            hash.map_or(0, FileHash::low_64)
        }))
    }

    fn resolve(&mut self, result: &MachineResult) {
        let interpreter = self.program.interpreter_mut();
        match result {
            MachineResult::Probe(probed) => {
                interpreter.resolve_probe(&probed.touch, &probed.rest, probed.touched);
                if let Some(outputs) = self.outputs.as_mut().filter(|_| probed.touched) {
                    outputs.write_probed_point(&probed.touch);
                }
            }
            MachineResult::Input(value) => interpreter.resolve_input(*value),
        }
    }

    fn next_block(&mut self, steps: &mut Vec<CanonStep>) -> DecodedBlock {
        if self.has_looped_too_long() {
            self.end_is_reported = true;
            return DecodedBlock::End;
        }
        let first = steps.len();
        let progress = self.program.advance(steps);
        if let Some(shown) = &mut self.progress {
            let program = &self.program;
            shown.block(|| (program.lines_read(), program.loop_blocks()));
        }
        self.is_at_end |= progress == Progress::End;
        self.length_offset |= steps[first..].iter().any(|s| matches!(s.canon, Canon::UseToolLengthOffset(_)));
        if let Some(left) = &mut self.outputs {
            left.write_log(&steps[first..]);
            if progress == Progress::End {
                let interpreter = self.program.interpreter();
                left.end(interpreter.parameters(), interpreter.tools());
            }
        }
        let refused = || {
            let diagnostics = self.program.interpreter().diagnostics().iter();
            let mut errors = diagnostics.filter(|d| d.severity() == Severity::Error);
            errors.next_back().map(|d| self.program.render(d, &self.name))
        };
        match progress {
            Progress::Line => DecodedBlock::Block,
            Progress::BlockError => DecodedBlock::BlockError(refused().unwrap_or_default()),
            Progress::End if self.end_is_reported => DecodedBlock::End,
            Progress::End => {
                let why = refused();
                self.end_is_reported = true;
                why.map_or(DecodedBlock::End, DecodedBlock::BlockError)
            }
        }
    }
}

impl Decoder {
    /// Whether the check ends here; a warning reports it, unless there are errors.
    fn has_looped_too_long(&mut self) -> bool {
        let Some(max) = self.max_loop_blocks else { return false };
        let blocks = self.program.loop_blocks();
        if blocks < max.min(MAX_LOOP_BLOCKS_WITH_ERRORS) {
            return false;
        }
        let diagnostics = self.program.interpreter().diagnostics();
        if diagnostics.iter().any(|found| found.severity() == Severity::Error) {
            return true;
        }
        let is_too_long = blocks >= max && !self.program.is_without_motion();
        if is_too_long {
            self.program.report_check_stopped();
        }
        is_too_long
    }
}
