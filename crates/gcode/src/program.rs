//! A whole program: lines from any reader, percent signs, and its end.
//!
//! Invariant: memory does not grow with the program; no more than one line is held, and a line that is too long is not held whole.

use crate::canon::{Canon, Step};
use crate::codes::Code;
use crate::diag::{Diagnostic, Fault, Span};
use crate::interp::{Flow, Interpreter, Setup};
use crate::parse::LONGEST_LINE;
use std::borrow::Cow;
use std::io::{BufRead, Read as _};

/// What became of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// It was carried out; there may be more.
    Line,
    /// It was refused; a diagnostic says why. Going on takes up the next line.
    Refused,
    /// There was none: the program has ended, well or not as its diagnostics say.
    End,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Opening,
    Running,
    Closed,
}

/// A program on its way through the interpreter.
#[derive(Debug)]
pub struct Program<R> {
    input: R,
    interpreter: Interpreter,
    phase: Phase,
    /// It opened with a percent sign, so it may close with one.
    percent: bool,
    text: Vec<u8>,
    /// A line that was read to see how the program begins, and is still to be carried out.
    is_held: bool,
}

impl<R: BufRead> Program<R> {
    /// A program before its first line.
    pub fn new(input: R, setup: Setup) -> Program<R> {
        let interpreter = Interpreter::new(setup);
        Program { input, interpreter, phase: Phase::Opening, percent: false, text: Vec::new(), is_held: false }
    }

    /// Takes the next line and adds its canonical functions to `steps`; the first call adds those that come before any program, the
    /// last those after.
    pub fn advance(&mut self, steps: &mut Vec<Step>) -> Progress {
        match self.phase {
            Phase::Closed => return Progress::End,
            Phase::Opening => {
                self.interpreter.begin(steps);
                if !self.open() {
                    self.phase = Phase::Closed;
                    return Progress::End;
                }
                emit(steps, Canon::OnReset);
                self.phase = Phase::Running;
            }
            Phase::Running => {}
        }
        if !std::mem::take(&mut self.is_held) && !self.read_line() {
            let code = if self.percent { Code::NoClosingPercent } else { Code::NoProgramEnd };
            self.interpreter.report(Fault::plain(code, Span::default()));
            return self.close(steps);
        }
        if self.percent && is_percent(&self.text) {
            self.interpreter.skip_line();
            emit(steps, Canon::Finish);
            return self.close(steps);
        }
        match self.interpreter.line(&self.text, steps) {
            Ok(Flow::Continue) => Progress::Line,
            Ok(Flow::ProgramEnd) => {
                if self.percent && !self.find_closing_percent() {
                    emit(steps, Canon::Note("interpreter: percent sign missing from end of file"));
                }
                self.close(steps)
            }
            Err(_) if self.interpreter.has_too_many_errors() => self.close(steps),
            Err(_) => Progress::Refused,
        }
    }

    /// Ends the program here and adds the canonical functions that come after any program.
    pub fn close(&mut self, steps: &mut Vec<Step>) -> Progress {
        if self.phase == Phase::Running {
            emit(steps, Canon::OnReset);
            emit(steps, Canon::OnReset);
        }
        self.phase = Phase::Closed;
        Progress::End
    }

    /// The line last taken.
    #[must_use]
    pub fn line_text(&self) -> Cow<'_, str> {
        String::from_utf8_lossy(&self.text)
    }

    /// The interpreter, to ask for its state and its diagnostics.
    #[must_use]
    pub fn interpreter(&self) -> &Interpreter {
        &self.interpreter
    }

    /// The interpreter, to change its state between two lines.
    pub fn interpreter_mut(&mut self) -> &mut Interpreter {
        &mut self.interpreter
    }

    /// Finds the first line that is not blank; false when there is none.
    fn open(&mut self) -> bool {
        loop {
            if !self.read_line() {
                self.interpreter.report(Fault::plain(Code::EmptyProgram, Span::default()));
                return false;
            }
            if is_percent(&self.text) {
                self.percent = true;
                self.interpreter.skip_line();
                return true;
            }
            if self.text.iter().any(|byte| !byte.is_ascii_whitespace()) {
                self.is_held = true;
                return true;
            }
            self.interpreter.skip_line();
        }
    }

    fn find_closing_percent(&mut self) -> bool {
        while self.read_line() {
            if is_percent(&self.text) {
                return true;
            }
        }
        false
    }

    /// Reads a line without its end; false at the end of the program. Of a line that is too long only so much is kept as shows that.
    fn read_line(&mut self) -> bool {
        match self.try_read_line() {
            Ok(found) => found,
            Err(error) => {
                let message = format!("{}: {error}", Code::Unreadable.title());
                self.interpreter.report(Fault::new(Code::Unreadable, Span::default(), message));
                false
            }
        }
    }

    fn try_read_line(&mut self) -> std::io::Result<bool> {
        self.text.clear();
        // One byte more than the longest line shows that it is too long; two are its end.
        let most = LONGEST_LINE as u64 + 3;
        if self.input.by_ref().take(most).read_until(b'\n', &mut self.text)? == 0 {
            return Ok(false);
        }
        if self.text.last() == Some(&b'\n') {
            self.text.pop();
            if self.text.last() == Some(&b'\r') {
                self.text.pop();
            }
        } else if self.text.len() as u64 == most {
            self.input.skip_until(b'\n')?;
        }
        Ok(true)
    }
}

fn emit(steps: &mut Vec<Step>, canon: Canon) {
    steps.push(Step { line: 0, number: None, canon });
}

/// Whether a line has a percent sign and nothing else.
fn is_percent(text: &[u8]) -> bool {
    text.contains(&b'%') && text.trim_ascii() == b"%"
}

/// Every canonical function of a program, in order, with the diagnostics at the end.
#[derive(Debug)]
pub struct Steps<R> {
    program: Program<R>,
    steps: Vec<Step>,
    next: usize,
}

impl<R: BufRead> IntoIterator for Program<R> {
    type Item = Step;
    type IntoIter = Steps<R>;

    fn into_iter(self) -> Steps<R> {
        Steps { program: self, steps: Vec::new(), next: 0 }
    }
}

impl<R> Steps<R> {
    /// What has been found wrong so far.
    #[must_use]
    pub fn diagnostics(&self) -> &[Diagnostic] {
        self.program.interpreter.diagnostics()
    }
}

impl<R: BufRead> Iterator for Steps<R> {
    type Item = Step;

    fn next(&mut self) -> Option<Step> {
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

/// Goes through a whole program and tells everything that is wrong with it; nothing moves.
pub fn check(input: impl BufRead, setup: Setup) -> Vec<Diagnostic> {
    let mut program = Program::new(input, setup);
    let mut steps = Vec::new();
    while program.advance(&mut steps) != Progress::End {
        steps.clear();
    }
    warn_of_text_after_end(&mut program);
    program.interpreter.take_diagnostics()
}

fn warn_of_text_after_end<R: BufRead>(program: &mut Program<R>) {
    if program.interpreter.has_too_many_errors() {
        return;
    }
    while program.read_line() {
        program.interpreter.skip_line();
        let text = program.text.trim_ascii();
        if !text.is_empty() && text != b"%" {
            let at = Span::new(0, program.text.len());
            program.interpreter.report(Fault::plain(Code::TextAfterEnd, at));
            return;
        }
    }
}
