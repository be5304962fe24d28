//! Four ways to decode a program: line by line, with precompiled cycles, with pre-scan, with both (PRE-9).
//!
//! The plain mode caches nothing from one line to the next: a cycle is read from its file and compiled at every call, a
//! call searches the text for its subprogram and reads its lines again. All four share blocks, cycles and text output,
//! so they differ in the preprocessing alone.
//!
//! Invariant: all modes give the same canonical functions.

use retrace_gcode::cycles::CycleLibrary;
use retrace_gcode::{BlockRefusedError, CanonStep, Interpreter, Prescan, Program, ProgramFlow, Progress, Setup};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

/// Preprocessing with which a program is decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DecodingMode {
    Plain,
    PrecompiledCycles,
    Prescan,
    Both,
}

pub(crate) const DECODING_MODES: [DecodingMode; 4] =
    [DecodingMode::Plain, DecodingMode::PrecompiledCycles, DecodingMode::Prescan, DecodingMode::Both];

/// Number of subprograms after the end of the program.
const SUBS: u32 = 20;

/// Returns a program of `lines` lines before its end, with the given number of calls of a cycle and of subprograms per
/// hundred lines, spread evenly.
pub(crate) fn program(lines: u32, cycles_in_100: u32, calls_in_100: u32) -> String {
    let mut text = String::from("G21 G90 G17\nF1000\nG0 X0 Y0 Z20\n");
    for line in 0..lines {
        // 37 has no divisor in common with 100, so that the kinds are mixed.
        let kind = line * 37 % 100;
        let (x, y, number) = (line * 7919 % 10_000, line * 104_729 % 10_000, line % SUBS);
        // Writing to a string cannot fail.
        let _ = if kind < cycles_in_100 {
            writeln!(text, "CYCLE81(10, 0, 2, -{}.5)", line % 9)
        } else if kind < cycles_in_100 + calls_in_100 {
            writeln!(text, "O{} call [{}.{:02}]", 100 + number, x / 100, x % 100)
        } else {
            writeln!(text, "G1 X{}.{:02} Y{}.{:02}", x / 100, x % 100, y / 100, y % 100)
        };
    }
    text.push_str("M2\n");
    for number in 100..100 + SUBS {
        let _ = writeln!(text, "O{number} sub\nG1 X[#1] Y{}\nG1 Y[#1/2]\nO{number} endsub", number % 7);
    }
    text
}

/// The only cycle that these programs call.
const CYCLE: &str = "CYCLE81";

/// Reads the cycle from its file and compiles it.
fn library(source: &Path) -> Arc<CycleLibrary> {
    let text = std::fs::read_to_string(source).expect("the source of the cycle");
    Arc::new(CycleLibrary::of_sources(&[(CYCLE, &text)]))
}

/// Decodes a program; `source` is the file of the cycle.
pub(crate) fn decode(way: DecodingMode, text: &str, source: &Path, take: &mut dyn FnMut(&CanonStep)) {
    let setup = Setup { cycles: Some(library(source)), ..Setup::rs274() };
    let compiles_at_call = matches!(way, DecodingMode::Plain | DecodingMode::Prescan).then_some(source);
    match way {
        DecodingMode::Plain | DecodingMode::PrecompiledCycles => plain(text, setup, compiles_at_call, take),
        DecodingMode::Prescan | DecodingMode::Both => prescanned(text, setup, compiles_at_call, take),
    }
}

fn is_cycle(line: &[u8]) -> bool {
    line.starts_with(b"CYCLE")
}

fn prescanned(text: &str, setup: Setup, compiles_at_call: Option<&Path>, take: &mut dyn FnMut(&CanonStep)) {
    let prescan = Arc::new(Prescan::scan("program", text.into(), &setup));
    let cycle_lines: Vec<bool> = text.lines().map(|line| is_cycle(line.as_bytes())).collect();
    let mut program = Program::<&[u8]>::prescanned(prescan, setup);
    let mut steps = Vec::new();
    let mut last = 0;
    while program.advance(&mut steps) != Progress::End {
        steps.drain(..).for_each(|step| take(&step));
        let line = program.interpreter().line_number();
        if let Some(source) = compiles_at_call
            && line != last
            && cycle_lines.get(line as usize - 1) == Some(&true)
        {
            // Read and compiled once for each call: here for the next one.
            program.interpreter_mut().set_cycles(Some(library(source)));
        }
        last = line;
    }
    steps.drain(..).for_each(|step| take(&step));
    assert!(program.interpreter().diagnostics().is_empty(), "{:?}", program.interpreter().diagnostics());
}

fn plain(text: &str, setup: Setup, compiles_at_call: Option<&Path>, take: &mut dyn FnMut(&CanonStep)) {
    let interpreter = Interpreter::new(setup);
    let mut plain =
        Plain { text: text.as_bytes(), interpreter, steps: Vec::new(), compiles_at_call, assignment: String::new() };
    plain.interpreter.begin(&mut plain.steps);
    let mut lines = Lines { text: plain.text, next: 0 };
    while let Some(line) = lines.next() {
        let flow = plain.line(line, lines.next).expect("the program is right");
        plain.steps.drain(..).for_each(|step| take(&step));
        if flow == ProgramFlow::ProgramEnd {
            return;
        }
    }
}

/// The lines of a text from a position.
struct Lines<'a> {
    text: &'a [u8],
    next: usize,
}

impl<'a> Iterator for Lines<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let rest = self.text.get(self.next..).filter(|rest| !rest.is_empty())?;
        // The standard library's own search, which is fast.
        let length = std::io::BufRead::skip_until(&mut &*rest, b'\n').expect("memory");
        self.next += length;
        let line = &rest[..length];
        Some(line.strip_suffix(b"\n").unwrap_or(line))
    }
}

/// The plain interpreter.
struct Plain<'a> {
    text: &'a [u8],
    interpreter: Interpreter,
    steps: Vec<CanonStep>,
    compiles_at_call: Option<&'a Path>,
    assignment: String,
}

impl<'a> Plain<'a> {
    /// Executes a line; `behind` is the position of the next one.
    fn line(&mut self, line: &[u8], behind: usize) -> Result<ProgramFlow, BlockRefusedError> {
        if let Some((number, argument)) = call_of(line) {
            return self.call(number, argument, behind);
        }
        if let Some(source) = self.compiles_at_call
            && is_cycle(line)
        {
            self.interpreter.set_cycles(Some(library(source)));
        }
        self.interpreter.line(line, &mut self.steps)
    }

    /// Searches for the subprogram, from the call to the end and then from the beginning, and reads its lines.
    fn call(&mut self, number: &[u8], argument: &[u8], behind: usize) -> Result<ProgramFlow, BlockRefusedError> {
        self.assignment.clear();
        self.assignment.push_str("#1=");
        self.assignment.push_str(&String::from_utf8_lossy(argument));
        self.interpreter.line(self.assignment.as_bytes(), &mut self.steps)?;
        let mut lines = self.find(number, behind).or_else(|| self.find(number, 0)).expect("the subprogram");
        loop {
            let line = lines.next().expect("its end");
            if word_of(line, b" endsub") == Some(number) {
                return Ok(ProgramFlow::Continue);
            }
            self.line(line, lines.next)?;
        }
    }

    fn find(&self, number: &[u8], from: usize) -> Option<Lines<'a>> {
        let mut lines = Lines { text: self.text, next: from };
        while let Some(line) = lines.next() {
            if word_of(line, b" sub") == Some(number) {
                return Some(lines);
            }
        }
        None
    }
}

/// Returns number and argument of a call.
fn call_of(line: &[u8]) -> Option<(&[u8], &[u8])> {
    let rest = line.strip_prefix(b"O")?;
    let at = rest.windows(6).position(|word| word == b" call ")?;
    Some((&rest[..at], &rest[at + 6..]))
}

/// Returns the number of an O word with this keyword.
fn word_of<'t>(line: &'t [u8], keyword: &[u8]) -> Option<&'t [u8]> {
    line.strip_prefix(b"O")?.strip_suffix(keyword)
}
