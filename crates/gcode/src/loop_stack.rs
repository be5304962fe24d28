//! The loops around the current line, and the iteration of each.
//!
//! Invariant: the loops of a level nest, the innermost last. A loop is listed from its first iteration to the line that
//! leaves it. The first iteration of a do is not listed: nothing marks it before its while.

use crate::compiled_code::{CompiledCode, Jump};
use crate::program_location::{CallFrame, LoopKind};
use std::ops::Range;

/// An open loop.
#[derive(Clone, Debug)]
struct OpenLoop {
    kind: LoopKind,
    /// Compiled lines, with the one that begins it; of a do, from the one after it.
    lines: Range<u32>,
    /// Iteration, from 1.
    iteration: u64,
    /// Number of iterations; 0 where it is not known.
    iterations: u64,
}

/// All open loops, over all levels.
#[derive(Clone, Debug, Default)]
pub(crate) struct LoopStack(Vec<OpenLoop>);

impl LoopStack {
    /// Returns the number of open loops.
    pub(crate) fn open_count(&self) -> usize {
        self.0.len()
    }

    /// Removes all loops except the first `count`.
    pub(crate) fn truncate(&mut self, count: usize) {
        self.0.truncate(count);
    }

    /// Records the decision of a while; `below` loops are open outside of the level. Returns whether it continues.
    pub(crate) fn decide(&mut self, kind: LoopKind, lines: Range<u32>, below: usize, goes_on: bool) -> bool {
        let is_open = self.0.len() > below && self.0.last().is_some_and(|open| open.lines == lines);
        match self.0.last_mut() {
            Some(open) if is_open && goes_on => open.iteration += 1,
            Some(_) if is_open => self.truncate(self.0.len() - 1),
            _ if goes_on => {
                // The first iteration of a do is over when its while is decided.
                let iteration = if kind == LoopKind::Do { 2 } else { 1 };
                self.0.push(OpenLoop { kind, lines, iteration, iterations: 0 });
            }
            _ => {}
        }
        goes_on
    }

    /// Begins the first of `of` iterations of a repeat.
    pub(crate) fn begin_repeat(&mut self, lines: Range<u32>, iterations: u64) {
        self.0.push(OpenLoop { kind: LoopKind::Repeat, lines, iteration: 1, iterations });
    }

    /// Ends an iteration of the repeat whose last line is before `end`. Returns whether another follows.
    pub(crate) fn end_iteration(&mut self, end: u32, below: usize) -> bool {
        if self.0.len() <= below {
            return false;
        }
        match self.0.last_mut() {
            Some(open) if open.lines.end == end && open.iteration < open.iterations => {
                open.iteration += 1;
                true
            }
            Some(open) if open.lines.end == end => {
                self.0.pop();
                false
            }
            _ => false,
        }
    }

    /// Removes the loops of the level that do not contain the line `to`, at which the program continues.
    pub(crate) fn leave(&mut self, to: u32, below: usize) {
        while self.0.len() > below && self.0.last().is_some_and(|open| !open.lines.contains(&to)) {
            self.0.pop();
        }
    }

    /// Appends the loops around a line of `code`, from inside to outside; `level` is the range of its level.
    pub(crate) fn push_frames(&self, code: &CompiledCode, line: u32, level: Range<usize>, frames: &mut Vec<CallFrame>) {
        let noted = self.0.get(level).unwrap_or_default();
        let mut around: Vec<OpenLoop> = noted.iter().filter(|open| open.lines.contains(&line)).cloned().collect();
        for end in line..code.len() {
            if let Some(Jump::WhileOfDo { begin }) = code.jump(end)
                && begin <= line
                && !around.iter().any(|open| open.lines == (begin..end + 1))
            {
                around.push(OpenLoop { kind: LoopKind::Do, lines: begin..end + 1, iteration: 1, iterations: 0 });
            }
        }
        around.sort_by_key(|open| std::cmp::Reverse(open.lines.start));
        frames.extend(around.into_iter().map(|open| {
            let begin = open.lines.start - u32::from(open.kind == LoopKind::Do);
            CallFrame::Loop {
                kind: open.kind,
                line: code.line_number(begin),
                iteration: open.iteration,
                iterations: (open.iterations > 0).then_some(open.iterations),
            }
        }));
    }
}
