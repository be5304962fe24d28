//! A program as an iterator over its canonical functions.
//!
//! Invariant: the functions come in the order of their execution, each once.

use crate::canon::CanonStep;
use crate::diag::Diagnostic;
use crate::program::{Program, Progress};
use std::io::BufRead;

/// Iterator over every canonical function of a program, in order. The diagnostics are complete at the end.
#[derive(Debug)]
pub struct Steps<R> {
    program: Program<R>,
    steps: Vec<CanonStep>,
    next: usize,
}

impl<R: BufRead> IntoIterator for Program<R> {
    type Item = CanonStep;
    type IntoIter = Steps<R>;

    fn into_iter(self) -> Steps<R> {
        Steps { program: self, steps: Vec::new(), next: 0 }
    }
}

impl<R: BufRead> Steps<R> {
    /// Returns the diagnostics so far.
    #[must_use]
    pub fn diagnostics(&self) -> &[Diagnostic] {
        self.program.interpreter().diagnostics()
    }
}

impl<R: BufRead> Iterator for Steps<R> {
    type Item = CanonStep;

    fn next(&mut self) -> Option<CanonStep> {
        while self.next == self.steps.len() {
            self.steps.clear();
            self.next = 0;
            if self.program.advance(&mut self.steps) == Progress::End && self.steps.is_empty() {
                return None;
            }
        }
        self.next += 1;
        self.steps.get(self.next - 1).cloned()
    }
}
