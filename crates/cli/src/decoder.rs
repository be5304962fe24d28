//! A program being decoded, block by block, for whoever plans it or looks through it.
//!
//! Invariant: an error at the program's end is told once; what the program leaves behind is noted only at its end, and only where it is run.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use retrace_controller::job::{Decode, Decoded};
use retrace_controller::journal::hash::Hash;
use retrace_controller::manual::hand::Identify;
use retrace_gcode::{Active, Canon, Progress, Severity, Step};

use crate::left::Left;
use crate::program::Source;

/// A program being decoded.
pub struct Decoder {
    pub(super) name: String,
    pub(super) program: Source,
    /// For a program that arrives.
    pub(super) given_up: Option<Arc<AtomicBool>>,
    /// The file that it is read from, to be held against what was read.
    pub(super) file: Option<PathBuf>,
    /// A tool length offset was called for.
    pub(super) length_offset: bool,
    /// The program is at its end, and why it is there has been told.
    pub(super) is_told: bool,
    /// What it leaves behind; none while it is only looked at.
    pub(super) left: Option<Left>,
}

impl Decode for Decoder {
    fn given_up(&self) -> Option<Arc<AtomicBool>> {
        self.given_up.clone()
    }

    fn active(&self) -> Option<Active> {
        Some(self.program.interpreter().state().into())
    }

    fn identity(&self) -> Option<Identify> {
        let file = self.file.clone()?;
        Some(Box::new(move || {
            let hash = std::fs::File::open(&file).and_then(Hash::of_reader);
            // One that is not there is another one than any that is.
            hash.map_or(0, Hash::half)
        }))
    }

    fn next_block(&mut self, steps: &mut Vec<Step>) -> Decoded {
        let first = steps.len();
        let progress = self.program.advance(steps);
        self.length_offset |= steps[first..].iter().any(|s| matches!(s.canon, Canon::UseToolLengthOffset(_)));
        if let Some(left) = &mut self.left {
            left.take(&steps[first..]);
            if progress == Progress::End {
                let interpreter = self.program.interpreter();
                left.end(interpreter.parameters(), interpreter.tools());
            }
        }
        let refused = || {
            let diagnostics = self.program.interpreter().diagnostics().iter();
            let mut errors = diagnostics.filter(|d| d.severity() == Severity::Error);
            errors.next_back().map(|d| d.render(&self.name, &self.program.text_of(d)))
        };
        match progress {
            Progress::Line => Decoded::Block,
            Progress::Refused => Decoded::Refused(refused().unwrap_or_default()),
            Progress::End if self.is_told => Decoded::End,
            Progress::End => {
                let why = refused();
                self.is_told = true;
                why.map_or(Decoded::End, Decoded::Refused)
            }
        }
    }
}
