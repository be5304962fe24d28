//! The pre-scan: one pass over a whole program before it runs (PRE-5 … PRE-8).
//!
//! Invariant: afterwards every subprogram, loop and branch is compiled, in the program and in all files that it calls,
//! and every jump has its target if the target can be known. What cannot be executed is reported. At run time nothing
//! is looked up by name.

use crate::branch::Branch;
use crate::compiled_code::CompiledCode;
use crate::control::Label;
use crate::control::subprogram_label;
use crate::cycle_call::CycleArgument;
use crate::diag::{BlockError, Diagnostic, Span};
use crate::error_codes::ErrorCode as Number;
use crate::file_scan::FileScan;
use crate::line_split::SplitLines;
use crate::lines::unreadable;
use crate::nearest::nearest;
use crate::parse::LineReader;
use crate::path_cache::PathCache;
use crate::probing_cycles;
use crate::setup::Setup;
use crate::sub_files::SubFiles;
use crate::subs::{Region, Subs, wrong_call};
use crate::text::{Text, TextLines};
use retrace_cycles::{Cycle, Kind};
use std::collections::{HashMap, HashSet};
use std::fmt::Debug;
use std::io;
use std::sync::Arc;

/// A file of a program.
#[derive(Clone, Debug)]
struct File {
    name: String,
    text: Text,
}

/// Maximum number of bytes between two labels, more than any contour has.
const MAX_CONTOUR: u64 = 16 << 20;

/// Positions and lines by label, sorted.
type LabelPlaces = HashMap<Box<str>, Vec<(u64, u32)>>;

/// Result of the pre-scan of a program.
#[derive(Clone, Debug)]
pub struct Prescan {
    files: Vec<File>,
    pub(crate) codes: Vec<Arc<CompiledCode>>,
    /// Regions of the program itself, in order.
    pub(crate) regions: Vec<Region>,
    pub(crate) subs: Subs,
    pub(crate) reader: LineReader,
    /// First and last lines of the contours between labels that cycles read; once all are found, sorted and without
    /// overlap.
    contours: Vec<(u32, u32)>,
    /// Positions and lines of the labels of the program, sorted; determined when the first cycle names one.
    labels: Option<LabelPlaces>,
    /// Names of the subprogram files that were searched for already.
    searched_names: HashSet<Box<str>>,
    /// Paths of cycles of the third kind.
    pub(crate) paths: PathCache,
    diagnostics: Vec<Diagnostic>,
}

impl Prescan {
    /// Pre-scans a program.
    #[must_use]
    pub fn scan(name: &str, text: Text, setup: &Setup) -> Prescan {
        let mut prescan = Prescan {
            files: Vec::new(),
            codes: Vec::new(),
            regions: Vec::new(),
            subs: Subs::default(),
            reader: LineReader::of(setup),
            contours: Vec::new(),
            labels: None,
            searched_names: HashSet::new(),
            paths: PathCache::default(),
            diagnostics: Vec::new(),
        };
        prescan.add_file(name.to_owned(), text, None);
        let change = Label::Name(probing_cycles::TOOL_CHANGE.into());
        if setup.calls_tool_change && prescan.subs.find(0, &change).is_none() {
            prescan.find_file(&change, setup.files.as_deref(), 0, 0, Span::default());
        }
        // Files that a file calls are appended after it.
        let mut file = 0;
        while file < prescan.codes.len() {
            prescan.link(file as u16, setup.files.as_deref());
            file += 1;
        }
        prescan.join_contours();
        prescan
    }

    /// Sorts the contours between labels and merges those that overlap.
    fn join_contours(&mut self) {
        self.contours.sort_unstable();
        self.contours.dedup_by(|next, before| {
            let is_joined = next.0 <= before.1;
            before.1 = if is_joined { before.1.max(next.1) } else { before.1 };
            is_joined
        });
    }

    /// Returns the diagnostics, as far as they can be determined without execution.
    #[must_use]
    pub fn diagnostics(&self) -> &[Diagnostic] {
        &self.diagnostics
    }

    /// Returns the name of a file: 0 is the program itself.
    #[must_use]
    pub fn file_name(&self, file: u16) -> &str {
        self.files.get(usize::from(file)).map_or("", |file| &file.name)
    }

    /// Returns the text of a line of a file, counted from 1; empty where it does not exist or can no longer be read.
    #[must_use]
    pub fn line_text(&self, file: u16, line: u32) -> Vec<u8> {
        let Some(file) = self.files.get(usize::from(file)) else { return Vec::new() };
        let (mut lines, mut next) = TextLines::near(file.text.clone(), u64::from(line));
        while let Ok(true) = lines.advance() {
            if next >= u64::from(line) {
                return lines.line().to_vec();
            }
            next += 1;
        }
        Vec::new()
    }

    /// Returns the program's lines in order, without their ends, as far as they can be read.
    pub fn texts(&self) -> impl Iterator<Item = Vec<u8>> {
        let mut lines = TextLines::new(self.text());
        std::iter::from_fn(move || lines.advance().is_ok_and(|more| more).then(|| lines.line().to_vec()))
    }

    /// Whether a line of the program is read as a contour.
    pub(crate) fn is_contour(&self, line: u32) -> bool {
        let behind = self.contours.partition_point(|(first, _)| *first <= line);
        behind.checked_sub(1).and_then(|index| self.contours.get(index)).is_some_and(|(_, last)| line <= *last)
    }

    /// Returns the lines between two labels of the program, and the number of the first of them.
    pub(crate) fn between(&self, start: &str, end: &str) -> Option<(u32, Vec<u8>)> {
        let text = &self.files.first()?.text;
        let places = |name: &str| self.labels.as_ref()?.get(name.trim().to_lowercase().as_str());
        let (from, line) = *places(start)?.first()?;
        let ends = places(end)?;
        let (to, _) = *ends.get(ends.partition_point(|(place, _)| *place <= from))?;
        if to - from > MAX_CONTOUR {
            return None;
        }
        let stretch = text.bytes(from, to).ok()?;
        let behind = stretch.iter().position(|byte| *byte == b'\n')? + 1;
        Some((line + 1, stretch.get(behind..)?.to_vec()))
    }

    /// Searches for the labels of the program, once.
    fn find_labels(&mut self) {
        if self.labels.is_none() {
            let labels = self.files.first().map(|file| find_label_places(&file.text));
            match labels.transpose() {
                Ok(labels) => self.labels = labels,
                Err(error) => self.report(0, 0, unreadable(&error)),
            }
        }
    }

    /// Returns the number of lines of the program.
    #[must_use]
    pub fn lines(&self) -> u64 {
        self.text().lines()
    }

    /// Returns the program's bytes, where they are held whole.
    #[must_use]
    pub fn held_text(&self) -> Option<&[u8]> {
        self.files.first()?.text.held()
    }

    /// Returns the program's text.
    pub(crate) fn text(&self) -> Text {
        self.files.first().map(|file| file.text.clone()).unwrap_or_default()
    }

    /// Returns the branch table: every jump of the program, numbered in order, with its target (PRE-5).
    #[must_use]
    pub fn branches(&self) -> Vec<Branch> {
        crate::branch::table(&self.codes, &self.subs)
    }

    /// Compiles the content of a file; `called` is the number that M98 calls in it.
    fn add_file(&mut self, name: String, text: Text, called: Option<u64>) {
        let file = self.files.len() as u16;
        self.files.push(File { name, text: text.clone() });
        let code = FileScan::new(self, file, text, called).scan();
        self.codes.push(Arc::new(code));
    }

    /// Resolves the subprogram of each call of a file, in another file if necessary.
    fn link(&mut self, file: u16, files: Option<&dyn SubFiles>) {
        let Some(code) = self.codes.get(usize::from(file)) else { return };
        let mut calls = code.calls.clone();
        for call in &mut calls {
            if call.label == Label::Calculated {
                continue;
            }
            call.sub = self.subs.find(file, &call.label);
            if call.sub.is_none() {
                self.find_file(&call.label, files, file, call.line, call.at);
                call.sub = self.subs.find(file, &call.label);
            }
            let wrong = match call.sub.and_then(|sub| self.subs.get(sub)) {
                None => {
                    let known: Vec<String> = self.subs.by_label.keys().map(|(_, label)| label.to_string()).collect();
                    let name = call.label.to_string();
                    let near = match call.label {
                        Label::Name(_) => nearest(&name, known.iter().map(String::as_str)),
                        _ => None,
                    };
                    let near = near.map_or_else(String::new, |near| format!("; did you mean {near}?"));
                    BlockError::new(Number::NoSuchSub, call.at, format!("there is no subprogram {name}{near}"))
                }
                Some(sub) if sub.for_m98 != call.is_m98 => wrong_call(&call.label, call.is_m98, call.at),
                Some(_) => continue,
            };
            self.report(file, call.line, wrong);
        }
        if let Some(code) = self.codes.get_mut(usize::from(file)) {
            Arc::make_mut(code).calls = calls;
        }
        self.find_contours(file, files);
    }

    /// Finds the contour of each call of a cycle that needs one.
    fn find_contours(&mut self, file: u16, files: Option<&dyn SubFiles>) {
        let (Some(code), Some(cycles)) = (self.codes.get(usize::from(file)).cloned(), self.reader.cycles.clone())
        else {
            return;
        };
        for (line, call) in &code.cycles {
            let Some(Kind::Contour(index)) = cycles.get(call.id).map(Cycle::kind) else { continue };
            let Some(CycleArgument::Text(name)) = call.arguments.get(index) else { continue };
            let is_there = match name.split_once(':') {
                Some((start, end)) => {
                    self.find_labels();
                    let stretch = self.between(start, end);
                    let lines = stretch.map(|(line, text)| (line - 1, line + SplitLines::new(&text).count() as u32));
                    self.contours.extend(lines);
                    lines.is_some()
                }
                None => {
                    let label = subprogram_label(name);
                    if self.subs.find(file, &label).is_none() && cycles.find(name).is_none() {
                        self.find_file(&label, files, file, *line, call.at);
                    }
                    self.subs.find(file, &label).is_some() || cycles.find(name).is_some()
                }
            };
            if !is_there && !name.is_empty() {
                let message = format!("{} names the contour {name}, which does not exist", call.name);
                self.report(file, *line, BlockError::new(Number::NoContour, call.at, message));
            }
        }
    }

    /// Reads the file of a subprogram's name, if it exists.
    fn find_file(&mut self, label: &Label, files: Option<&dyn SubFiles>, caller: u16, line: u32, at: Span) {
        let name = match label {
            Label::Number(number) => number.to_string(),
            Label::Name(name) => name.to_string(),
            Label::Calculated => return,
        };
        // A name is searched for once only: a file that calls what it should contain would otherwise be read without
        // end.
        if !self.searched_names.insert(name.clone().into()) {
            return;
        }
        let found = files.and_then(|files| files.find(&name)).or_else(|| probing_cycles::find(&name));
        let Some(found) = found else { return };
        let text = match found.text {
            Ok(text) => text,
            Err(why) => {
                let message = format!("{} cannot be read: {why}", found.name);
                return self.report(caller, line, BlockError::new(Number::SubFile, at, message));
            }
        };
        if self.files.len() >= usize::from(u16::MAX) {
            return;
        }
        let file = self.files.len() as u16;
        let called = if let Label::Number(number) = label { Some(*number) } else { None };
        self.add_file(found.name, text, called);
        match self.subs.by_label.get(&(file, label.clone())) {
            Some(id) => {
                self.subs.by_label.insert((0, label.clone()), *id);
            }
            None => {
                let message = format!("{} does not contain the subprogram {label}", self.file_name(file));
                self.report(caller, line, BlockError::new(Number::SubFile, at, message));
            }
        }
    }

    /// Whether there are so many errors that the scan stops.
    pub(crate) fn has_too_many_errors(&self) -> bool {
        self.diagnostics.len() >= crate::interp::MAX_ERRORS
    }

    /// Returns the number of diagnostics.
    pub(crate) fn diagnostic_count(&self) -> usize {
        self.diagnostics.len()
    }

    /// Discards the diagnostics after the first `found`.
    pub(crate) fn truncate_diagnostics(&mut self, found: usize) {
        self.diagnostics.truncate(found);
    }

    pub(crate) fn report(&mut self, file: u16, line: u32, fault: BlockError) {
        let BlockError { code, span, message } = fault;
        if self.diagnostics.len() < crate::interp::MAX_ERRORS {
            self.diagnostics.push(Diagnostic { code, file, line, span, message });
        }
    }
}

/// Returns the positions and numbers of the lines with labels.
fn find_label_places(text: &Text) -> io::Result<LabelPlaces> {
    let mut labels = LabelPlaces::new();
    let (mut lines, mut number) = (TextLines::new(text.clone()), 0_u32);
    loop {
        let at = lines.position();
        if !lines.advance()? {
            return Ok(labels);
        }
        number = number.saturating_add(1);
        if let Some(label) = crate::cycle_call_parser::label_of(lines.line()) {
            labels.entry(label).or_default().push((at, number));
        }
    }
}
