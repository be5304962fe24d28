//! One file on its way through the pre-scan: where its stretches begin and end, and compiling them.
//!
//! Invariant: every line of a stretch is compiled once; a stretch without an end is told and left out, and what follows its first line is
//! looked at anew.

use crate::code::{Code, Jump};
use crate::codes::Code as Number;
use crate::control::{Control, Keyword, Label, may_be};
use crate::diag::{Fault, Span};
use crate::lines::Split;
use crate::nest::Nest;
use crate::parse::LineReader;
use crate::prescan::{Prescan, Region, Sub};

/// Lines of O numbers that M98 calls, with the line of the M99 that follows.
fn called_starts(text: &[u8], called: Option<u64>) -> Vec<(u32, u32)> {
    let mut reader = LineReader::new(crate::pose::AxisSet::ALL, false, None);
    let mut called: Vec<Option<u64>> = called.into_iter().map(Some).collect();
    let (mut starts, mut ranges) = (Vec::new(), Vec::new());
    let mut open: Vec<(u32, u64)> = Vec::new();
    for (index, line) in Split::new(text).enumerate() {
        if !may_be(line) || reader.read(line).is_err() {
            continue;
        }
        let Some(Control { label, keyword, .. }) = reader.block.control.take() else { continue };
        match (keyword, label) {
            (Keyword::Start, Label::Number(number)) => open.push((index as u32, number)),
            (Keyword::M99, _) => starts.extend(open.drain(..).map(|(line, number)| (line, number, index as u32))),
            (Keyword::M98, Label::Number(number)) => called.push(Some(number)),
            (Keyword::M98, _) => called.push(None),
            _ => {}
        }
    }
    for (line, number, end) in starts {
        if called.contains(&None) || called.contains(&Some(number)) {
            ranges.push((line + 1, end + 1));
        }
    }
    ranges
}

/// One file on its way through the pre-scan.
pub(crate) struct FileScan<'a> {
    prescan: &'a mut Prescan,
    file: u16,
    code: Code,
    nest: Nest,
    /// The number that M98 of another file looks for.
    called: Option<u64>,
    /// Stretches that M98 calls: their first and their last line; looked for when the first O number alone is met.
    starts: Option<Vec<(u32, u32)>>,
    text: &'a [u8],
}

impl<'a> FileScan<'a> {
    /// A file before its first line; `called` is the number that M98 of another file looks for in it.
    pub(crate) fn new(prescan: &'a mut Prescan, file: u16, text: &'a [u8], called: Option<u64>) -> FileScan<'a> {
        let (code, nest) = (Code::new(file), Nest::default());
        FileScan { prescan, file, code, nest, called, starts: None, text }
    }

    /// Compiles its stretches, and tells the pre-scan of them.
    pub(crate) fn scan(mut self) -> Code {
        self.all();
        self.code
    }

    fn all(&mut self) {
        let mut lines = Split::new(self.text);
        let mut line = 0;
        let mut percent = false;
        loop {
            let before = lines.clone();
            let Some(this) = lines.next() else { return };
            line += 1;
            if this.first().is_some_and(|byte| matches!(byte, b'%' | b' ' | b'\t')) && this.trim_ascii() == b"%" {
                if percent {
                    return;
                }
                percent = true;
                continue;
            }
            if !may_be(this) || !self.is_region(line, this) {
                continue;
            }
            lines = before;
            match self.region(line, &mut lines) {
                Some(behind) => line = behind - 1,
                None => {
                    lines.next();
                }
            }
            if self.prescan.has_too_many_errors() {
                return;
            }
        }
    }

    /// Whether a stretch begins in this line.
    fn is_region(&mut self, line: u32, text: &[u8]) -> bool {
        // What is wrong with a line that is no part of a stretch is told when the program comes to it.
        let Ok(true) = self.prescan.reader.read(text) else { return false };
        let Some(control) = &self.prescan.reader.block.control else { return false };
        match control.keyword {
            Keyword::Start => {
                let starts = self.starts.get_or_insert_with(|| called_starts(self.text, self.called));
                starts.iter().any(|(first, _)| *first == line)
            }
            Keyword::M99 => false,
            _ => true,
        }
    }

    /// Compiles the stretch that begins with the line that has just been read; the line behind it, or none if it has no end.
    fn region(&mut self, first: u32, lines: &mut Split<'_>) -> Option<u32> {
        let start = self.code.len();
        let known = self.prescan.found();
        let from = lines.clone();
        let mut line = first;
        // Of stretches that overlap the last end counts.
        let mut last = first;
        loop {
            let Some(text) = lines.next() else {
                let open = self.nest.give_up();
                self.code.truncate(start);
                self.nest.found.clear();
                self.nest.faults.clear();
                self.prescan.forget(known);
                *lines = from;
                if let Some(open) = open {
                    self.prescan.report(self.file, open.line, *open.without_end());
                }
                return None;
            };
            if let Some((_, end)) = self.starts.iter().flatten().find(|(start, _)| *start == line) {
                last = last.max(*end);
            }
            let read = if line == first { Ok(true) } else { self.prescan.reader.read(text) };
            match read {
                Ok(_) => self.nest.take(&mut self.code, line, text, &self.prescan.reader.block),
                Err(fault) => {
                    self.code.push(line, text, &self.prescan.reader.block, Jump::Faulty);
                    self.prescan.report(self.file, line, *fault);
                }
            }
            for (line, fault) in self.nest.faults.drain(..) {
                self.prescan.report(self.file, line, *fault);
            }
            line += 1;
            if self.nest.is_closed() && line > last {
                break;
            }
        }
        self.take_found();
        if self.file == 0 {
            self.prescan.regions.push(Region { line: first, end_line: line, start, end: self.code.len() });
        }
        Some(line)
    }

    fn take_found(&mut self) {
        for found in std::mem::take(&mut self.nest.found) {
            let sub = Sub { code: self.file.into(), entry: found.entry, for_m98: found.for_m98 };
            if !self.prescan.subs.add(self.file, found.label.clone(), sub) {
                let message = format!("{} has been defined before", found.label);
                let fault = Fault::new(Number::SubTwice, Span::default(), message);
                self.prescan.report(self.file, found.line, fault);
            }
        }
    }
}
