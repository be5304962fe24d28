//! Pre-scan of one file: finds and compiles its regions.
//!
//! Invariant: every line of a region is compiled once. A region without an end is reported and left out, and scanning
//! continues at the line after its first one.

use crate::bytes::byte_order_mark;
use crate::compiled_code::{CompiledCode, Jump};
use crate::control::{Control, Keyword, Label};
use crate::control_flow::ControlFlowBuilder;
use crate::control_parser::may_be;
use crate::diag::{BlockError, Span};
use crate::error_codes::ErrorCode as Number;
use crate::lines::{is_percent, unreadable};
use crate::parse::LineReader;
use crate::prescan::Prescan;
use crate::subs::{Region, Sub};
use crate::text::{Text, TextLines};
use std::io;

/// Maximum length of a file with GOTO, in bytes.
const MAX_WHOLE: u64 = 16 << 20;

/// Maximum length of the compiled text of a file, in bytes, so that memory is bounded. Lines outside of subprograms,
/// loops and branches are not compiled.
const MAX_COMPILED: usize = if cfg!(test) { 1 << 20 } else { 128 << 20 };

/// Returns the lines of O numbers that M98 calls, each with the line of the M99 that follows.
fn called_starts(text: &Text, called: Option<u64>) -> io::Result<Vec<(u32, u32)>> {
    let mut reader = LineReader::new(crate::pose::AxisSet::ALL, false, None);
    let mut called: Vec<Option<u64>> = called.into_iter().map(Some).collect();
    let (mut starts, mut ranges) = (Vec::new(), Vec::new());
    let mut open: Vec<(u32, u64)> = Vec::new();
    let (mut lines, mut index) = (TextLines::new(text.clone()), 0_u32);
    while lines.advance()? {
        index = index.saturating_add(1);
        let line = lines.line();
        if !may_be(line, None) || reader.read(line).is_err() {
            continue;
        }
        let Some(Control { label, keyword, .. }) = reader.block.control.take() else { continue };
        match (keyword, label) {
            (Keyword::Start, Label::Number(number)) => open.push((index - 1, number)),
            (Keyword::M99, _) => starts.extend(open.drain(..).map(|(line, number)| (line, number, index - 1))),
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
    Ok(ranges)
}

/// Whether the line begins with an O word, after a block delete mark and a line number.
fn has_o_word(text: &[u8]) -> bool {
    let text = text[byte_order_mark(text)..].trim_ascii_start();
    let text = text.strip_prefix(b"/").unwrap_or(text).trim_ascii_start();
    let behind_number = match text {
        [b'N' | b'n', rest @ ..] => {
            let digits = rest.iter().take_while(|byte| byte.is_ascii_digit() || **byte == b' ').count();
            &rest[digits..]
        }
        _ => text,
    };
    matches!(behind_number.first(), Some(b'O' | b'o'))
}

/// Pre-scan of one file.
pub(crate) struct FileScan<'a> {
    prescan: &'a mut Prescan,
    file: u16,
    code: CompiledCode,
    control_flow: ControlFlowBuilder,
    /// Number that M98 of another file calls.
    called: Option<u64>,
    /// First and last lines of the regions that M98 calls; determined when the first O number alone is found.
    starts: Option<Vec<(u32, u32)>>,
    /// Whether the whole file is one region, because a GOTO may go anywhere in it.
    is_single_region: bool,
    /// Whether the limit of compiled text is reached; the rest of the file is not scanned.
    is_full: bool,
    /// Whether a line with an O word could not be read. Such a line may hold a missing beginning or end.
    has_unread_control: bool,
    text: Text,
}

impl<'a> FileScan<'a> {
    /// Creates a scan before the first line. `called` is the number that M98 of another file calls.
    pub(crate) fn new(prescan: &'a mut Prescan, file: u16, text: Text, called: Option<u64>) -> FileScan<'a> {
        let (code, control_flow) = (CompiledCode::new(file), ControlFlowBuilder::default());
        FileScan {
            prescan,
            file,
            code,
            control_flow,
            called,
            starts: None,
            is_single_region: false,
            is_full: false,
            has_unread_control: false,
            text,
        }
    }

    /// Compiles the regions, and adds them to the pre-scan.
    pub(crate) fn scan(mut self) -> CompiledCode {
        let (mut line, found, subs) = (0, self.prescan.diagnostic_count(), self.prescan.subs.list.len());
        let mut scanned = self.scan_lines(&mut line);
        if self.control_flow.has_goto && scanned.is_ok() {
            self.prescan.truncate_diagnostics(found);
            self.prescan.subs.truncate(subs);
            if self.file == 0 {
                self.prescan.regions.clear();
            }
            (self.code, self.control_flow) = (CompiledCode::new(self.file), ControlFlowBuilder::default());
            (self.is_single_region, self.has_unread_control, line) = (true, false, 0);
            scanned = self.scan_whole(&mut line);
        }
        if let Err(error) = scanned {
            self.prescan.report(self.file, line + 1, unreadable(&error));
        }
        self.code
    }

    /// Compiles the file as one region, from its first line that is not blank or a percent sign to its end or the next
    /// percent sign.
    fn scan_whole(&mut self, line: &mut u32) -> io::Result<()> {
        if self.text.len() > MAX_WHOLE {
            let message = "a file with GOTO may have at most 16 MiB";
            self.prescan.report(
                self.file,
                1,
                BlockError::new(Number::StorageFull, Span::default(), message.to_owned()),
            );
            return Ok(());
        }
        self.starts = Some(called_starts(&self.text, self.called)?);
        let mut lines = TextLines::new(self.text.clone());
        loop {
            let before = lines.position();
            if !lines.advance()? {
                return Ok(());
            }
            *line += 1;
            let this = lines.line();
            if !this.trim_ascii().is_empty() && !is_percent(this) {
                lines.seek(before);
                return self.compile_region(*line, &mut lines).map(drop);
            }
        }
    }

    /// Scans all lines; `line` is the current one.
    fn scan_lines(&mut self, line: &mut u32) -> io::Result<()> {
        let mut lines = TextLines::new(self.text.clone());
        let mut percent = false;
        loop {
            let before = lines.position();
            if !lines.advance()? {
                return Ok(());
            }
            *line += 1;
            let this = lines.line();
            let content = &this[byte_order_mark(this)..];
            if content.first().is_some_and(|byte| matches!(byte, b'%' | b' ' | b'\t')) && content.trim_ascii() == b"%" {
                if percent {
                    return Ok(());
                }
                percent = true;
                continue;
            }
            if !may_be(this, self.prescan.reader.cycles.as_deref()) || !self.is_region(*line, this)? {
                continue;
            }
            lines.seek(before);
            match self.compile_region(*line, &mut lines)? {
                Some(behind) => *line = behind - 1,
                None => _ = lines.advance()?,
            }
            if self.control_flow.has_goto || self.is_full {
                return Ok(());
            }
            if self.prescan.has_too_many_errors() {
                return Ok(());
            }
        }
    }

    /// Whether a region begins in this line.
    fn is_region(&mut self, line: u32, text: &[u8]) -> io::Result<bool> {
        // An error in a line outside of all regions is reported when the program reaches it.
        let read = self.prescan.reader.read(text);
        self.has_unread_control |= read.is_err() && has_o_word(text);
        let Ok(true) = read else { return Ok(false) };
        let Some(control) = &self.prescan.reader.block.control else { return Ok(false) };
        Ok(match control.keyword {
            Keyword::Start => {
                if self.starts.is_none() {
                    self.starts = Some(called_starts(&self.text, self.called)?);
                }
                self.starts.iter().flatten().any(|(first, _)| *first == line)
            }
            Keyword::M99 => false,
            _ => true,
        })
    }

    /// Compiles the region that begins with the line read last. Returns the line after it, or `None` if it has no end.
    fn compile_region(&mut self, first: u32, lines: &mut TextLines) -> io::Result<Option<u32>> {
        let start = self.code.len();
        let known = self.prescan.diagnostic_count();
        let from = lines.position();
        let mut line = first;
        // Of overlapping regions, the last end counts.
        let mut last = first;
        loop {
            let is_end = !lines.advance()? || self.is_single_region && is_percent(lines.line());
            if is_end && self.is_single_region {
                let open = self.control_flow.abandon().filter(|_| !self.has_unread_control);
                open.into_iter().for_each(|open| self.prescan.report(self.file, open.line, *open.missing_end_error()));
                break;
            }
            if is_end {
                let open = self.control_flow.abandon();
                self.code.truncate(start);
                self.control_flow.found.clear();
                self.control_flow.faults.clear();
                self.prescan.truncate_diagnostics(known);
                lines.seek(from);
                if let Some(open) = open.filter(|_| !self.has_unread_control) {
                    self.prescan.report(self.file, open.line, *open.missing_end_error());
                }
                return Ok(None);
            }
            let text = lines.line();
            if let Some((_, end)) = self.starts.iter().flatten().find(|(start, _)| *start == line) {
                last = last.max(*end);
            }
            let read = if line == first && !self.is_single_region { Ok(true) } else { self.prescan.reader.read(text) };
            match read {
                Ok(_) => self.control_flow.push(&mut self.code, line, text, &self.prescan.reader.block),
                Err(fault) => {
                    self.has_unread_control |= has_o_word(text);
                    self.code.push(line, text, &self.prescan.reader.block, Jump::Faulty);
                    self.prescan.report(self.file, line, *fault);
                }
            }
            self.report_faults();
            if self.code.text_len() > MAX_COMPILED {
                let message = "the subprograms, loops and branches of a file may have at most 128 MiB together";
                self.prescan.report(
                    self.file,
                    first,
                    BlockError::new(Number::StorageFull, Span::default(), message.to_owned()),
                );
                self.control_flow.abandon();
                self.control_flow.found.clear();
                self.code.truncate(start);
                self.is_full = true;
                return Ok(None);
            }
            line += 1;
            if !self.is_single_region && self.control_flow.is_closed() && line > last {
                break;
            }
        }
        if self.is_single_region {
            self.control_flow.find_lines(&mut self.code, true);
            self.report_faults();
        }
        self.add_found_subs();
        if self.file == 0 {
            self.prescan.regions.push(Region { line: first, end_line: line, start, end: self.code.len() });
        }
        Ok(Some(line))
    }

    /// Reports blocks that do not nest, and every GOTO without a line.
    fn report_faults(&mut self) {
        for (line, fault) in self.control_flow.faults.drain(..) {
            if !(self.has_unread_control && fault.code == Number::ControlWithoutBegin) {
                self.prescan.report(self.file, line, *fault);
            }
        }
    }

    fn add_found_subs(&mut self) {
        for found in std::mem::take(&mut self.control_flow.found) {
            let sub = Sub { code: self.file.into(), entry: found.entry, for_m98: found.for_m98 };
            if !self.prescan.subs.add(self.file, found.label.clone(), sub) {
                let message = format!("{} has been defined before", found.label);
                let fault = BlockError::new(Number::SubTwice, Span::default(), message);
                self.prescan.report(self.file, found.line, fault);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setup::Setup;

    /// Memory is bounded however long a loop is. Lines outside of regions are not limited.
    #[test]
    fn what_is_compiled_of_a_file_is_bounded() {
        let found = |text: String| {
            let prescan = Prescan::scan("part", text.into_bytes().into(), &Setup::default());
            prescan.diagnostics().iter().map(|found| (found.number(), found.line)).collect::<Vec<_>>()
        };
        let moves = "G1 X1.2345 Y2.3456\n".repeat(MAX_COMPILED / 18 + 10);
        assert_eq!(found(format!("F1\nO1 repeat [2]\n{moves}O1 endrepeat\nM2\n")), [("E1812", 2)]);
        assert_eq!(found(format!("F1\n{moves}O1 repeat [2]\nG1 X1\nO1 endrepeat\nM2\n")), []);
        let goto = format!("F1\nGOTO 5\n{moves}N5 M2\n");
        assert_eq!(found(goto), [("E1812", 1)]);
    }
}
