//! A whole program: lines from any reader, percent signs, and its end.
//!
//! Invariant: memory does not grow with the program until it jumps: lines are kept from the first O word on.

use crate::canon::{Canon, Step};
use crate::codes::Code;
use crate::diag::{Diagnostic, Fault, Span};
use crate::flow::Nesting;
use crate::interp::{Flow, Interpreter, Setup, Taken};
use crate::lines::Lines;
use std::borrow::Cow;
use std::io::BufRead;

/// Lines after which checking a program with jumps stops.
const MOST_CHECKED_LINES: u32 = 10_000_000;

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
    lines: Lines<R>,
    interpreter: Interpreter,
    nesting: Nesting,
    phase: Phase,
    /// It opened with a percent sign, so it may close with one.
    percent: bool,
    /// A line that was read to see how the program begins, and is still to be carried out.
    is_held: bool,
}

impl<R: BufRead> Program<R> {
    /// A program before its first line.
    pub fn new(input: R, setup: Setup) -> Program<R> {
        Program {
            lines: Lines::new(input),
            interpreter: Interpreter::new(setup),
            nesting: Nesting::default(),
            phase: Phase::Opening,
            percent: false,
            is_held: false,
        }
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
            self.report(Fault::plain(code, Span::default()));
            return self.close(steps);
        }
        if self.percent && is_percent(self.lines.text()) {
            self.interpreter.release(steps);
            emit(steps, Canon::Finish);
            return self.close(steps);
        }
        let progress = self.interpreter.take(self.lines.number(), self.lines.text(), steps);
        let outcome = match progress {
            Ok(Taken::Done(Flow::Continue)) => return Progress::Line,
            Ok(Taken::Done(Flow::ProgramEnd)) => {
                if self.percent && !self.find_closing_percent() {
                    emit(steps, Canon::Note("interpreter: percent sign missing from end of file"));
                }
                return self.close(steps);
            }
            Ok(Taken::Control(control)) => self.nesting.carry_out(&control, &mut self.lines, &mut self.interpreter),
            Err(fault) => Err(fault),
        };
        match outcome {
            Ok(()) => Progress::Line,
            Err(fault) => {
                self.interpreter.report(*fault);
                if self.interpreter.has_too_many_errors() { self.close(steps) } else { Progress::Refused }
            }
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
        String::from_utf8_lossy(self.lines.text())
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
                self.report(Fault::plain(Code::EmptyProgram, Span::default()));
                return false;
            }
            if is_percent(self.lines.text()) {
                self.percent = true;
                return true;
            }
            if self.lines.text().iter().any(|byte| !byte.is_ascii_whitespace()) {
                self.is_held = true;
                return true;
            }
        }
    }

    fn find_closing_percent(&mut self) -> bool {
        while self.read_line() {
            if is_percent(self.lines.text()) {
                return true;
            }
        }
        false
    }

    /// Takes the next line; false at the end of the program.
    fn read_line(&mut self) -> bool {
        match self.lines.advance() {
            Ok(found) => found,
            Err(error) => {
                let message = format!("{}: {error}", Code::Unreadable.title());
                self.report(Fault::new(Code::Unreadable, Span::default(), message));
                false
            }
        }
    }

    /// Notes something about the line last taken.
    fn report(&mut self, fault: Fault) {
        self.interpreter.set_line(self.lines.number());
        self.interpreter.report(fault);
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
    let mut lines = 0_u32;
    while program.advance(&mut steps) != Progress::End {
        steps.clear();
        lines += 1;
        if lines == MOST_CHECKED_LINES && program.nesting.has_jumped() {
            program.report(Fault::plain(Code::EndlessProgram, Span::default()));
            return program.interpreter.take_diagnostics();
        }
    }
    warn_of_text_after_end(&mut program);
    program.interpreter.take_diagnostics()
}

fn warn_of_text_after_end<R: BufRead>(program: &mut Program<R>) {
    // Subprograms may well stand after the end of the program that calls them.
    if program.interpreter.has_too_many_errors() || program.nesting.has_jumped() {
        return;
    }
    while program.read_line() {
        let text = program.lines.text();
        if !text.trim_ascii().is_empty() && !is_percent(text) {
            let at = Span::new(0, text.len());
            program.report(Fault::plain(Code::TextAfterEnd, at));
            return;
        }
    }
}
