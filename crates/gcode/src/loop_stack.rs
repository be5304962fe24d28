//! The loops that a program is in, and which round each of them is in.
//!
//! Invariant: the loops of a level nest, the innermost last; a loop is there from its first round to the line that leaves it. Of a do
//! the first round is not noted: nothing tells of it before its while.

use crate::compiled_code::{CompiledCode, Jump};
use crate::program_location::{CallFrame, LoopKind};
use std::ops::Range;

/// A loop that is open.
#[derive(Clone, Debug)]
struct OpenLoop {
    kind: LoopKind,
    /// Its compiled lines, with the one that begins it (of a do the one behind).
    lines: Range<u32>,
    /// From 1.
    round: u64,
    /// How many there are; 0 where that is open.
    of: u64,
}

/// All that are open, over all levels.
#[derive(Debug, Default)]
pub(crate) struct LoopStack(Vec<OpenLoop>);

impl LoopStack {
    /// How many are open.
    pub(crate) fn open(&self) -> usize {
        self.0.len()
    }

    /// Ends all but the first `kept`.
    pub(crate) fn end_all(&mut self, kept: usize) {
        self.0.truncate(kept);
    }

    /// A while has been decided; `below` are open outside of the level. Returns whether it goes on.
    pub(crate) fn decide(&mut self, kind: LoopKind, lines: Range<u32>, below: usize, goes_on: bool) -> bool {
        let is_open = self.0.len() > below && self.0.last().is_some_and(|open| open.lines == lines);
        match self.0.last_mut() {
            Some(open) if is_open && goes_on => open.round += 1,
            Some(_) if is_open => self.end_all(self.0.len() - 1),
            _ if goes_on => {
                // The first round of a do is over when its while is decided.
                let round = if kind == LoopKind::Do { 2 } else { 1 };
                self.0.push(OpenLoop { kind, lines, round, of: 0 });
            }
            _ => {}
        }
        goes_on
    }

    /// A repeat begins its first round, of `of`.
    pub(crate) fn begin_repeat(&mut self, lines: Range<u32>, of: u64) {
        self.0.push(OpenLoop { kind: LoopKind::Repeat, lines, round: 1, of });
    }

    /// The end of a repeat whose last line lies before `end`: whether there is another round.
    pub(crate) fn end_of_round(&mut self, end: u32, below: usize) -> bool {
        if self.0.len() <= below {
            return false;
        }
        match self.0.last_mut() {
            Some(open) if open.lines.end == end && open.round < open.of => {
                open.round += 1;
                true
            }
            Some(open) if open.lines.end == end => {
                self.0.pop();
                false
            }
            _ => false,
        }
    }

    /// The program goes on at `to`: loops of the level that do not hold this line are left.
    pub(crate) fn leave(&mut self, to: u32, below: usize) {
        while self.0.len() > below && self.0.last().is_some_and(|open| !open.lines.contains(&to)) {
            self.0.pop();
        }
    }

    /// Adds the loops around a line of `code`, from inside to outside; `level` are the ones of its level.
    pub(crate) fn within(&self, code: &CompiledCode, line: u32, level: Range<usize>, within: &mut Vec<CallFrame>) {
        let noted = self.0.get(level).unwrap_or_default();
        let mut around: Vec<OpenLoop> = noted.iter().filter(|open| open.lines.contains(&line)).cloned().collect();
        for end in line..code.len() {
            if let Some(Jump::WhileOfDo { begin }) = code.jump(end)
                && begin <= line
                && !around.iter().any(|open| open.lines == (begin..end + 1))
            {
                around.push(OpenLoop { kind: LoopKind::Do, lines: begin..end + 1, round: 1, of: 0 });
            }
        }
        around.sort_by_key(|open| std::cmp::Reverse(open.lines.start));
        within.extend(around.into_iter().map(|open| {
            let begin = open.lines.start - u32::from(open.kind == LoopKind::Do);
            CallFrame::Loop {
                kind: open.kind,
                line: code.line_number(begin),
                round: open.round,
                of: (open.of > 0).then_some(open.of),
            }
        }));
    }
}
