//! Compiled lines: the regions of a file that may be executed more than once, stored one after another.
//!
//! Invariant: a packed block equals the block that its line compiled to. Every jump stays within its region or goes to
//! its end. Executing packed lines copies them into one working block and allocates nothing.

use crate::block::{DeferredValue, NcBlock, PackedWord};
use crate::block_number::BlockNumber;
use crate::comment::Comment;
use crate::control::Label;
use crate::cycle_call::CycleCall;
use crate::expr::Op;
use crate::line_numbers::LineNumbers;
use std::ops::Range;

/// Index of a subprogram in the list of all subprograms that a program calls.
pub(crate) type SubId = u32;

/// Control flow of a line, in addition to its block. Positions count compiled lines, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Jump {
    /// A block; execution continues with the next line.
    None,
    /// Refused when it was compiled.
    Faulty,
    /// Nothing: a deleted line, do, endif, or a label.
    Pass,
    /// The definition of a subprogram, which is skipped to its end.
    Over {
        to: u32,
    },
    /// Index into [`CompiledCode::calls`].
    Call {
        call: u32,
    },
    If {
        otherwise: u32,
    },
    ElseIf {
        otherwise: u32,
        end: u32,
    },
    Else {
        end: u32,
    },
    While {
        end: u32,
    },
    /// The end of a do.
    WhileOfDo {
        begin: u32,
    },
    Repeat {
        end: u32,
    },
    EndRepeat {
        begin: u32,
    },
    /// endwhile, break, continue: loops that do not contain the line `to` are left.
    Leave {
        to: u32,
    },
    /// return, endsub, M99.
    Return,
    /// Index into [`CompiledCode::cycles`].
    Cycle {
        call: u32,
    },
    /// MCALL with a cycle.
    ModalCall {
        call: u32,
    },
    /// MCALL alone.
    ModalEnd,
    /// GOTO. With [`BY_NUMBER`], the line is looked up by its number, the last value of the block.
    GoTo {
        to: u32,
        /// Whether the first value of the block is a condition.
        is_conditional: bool,
    },
    /// The first value of the block is the condition for the rest of it.
    IfThen,
}

/// Marks a line that is not known before the program reaches the GOTO.
pub(crate) const BY_NUMBER: u32 = u32::MAX;

/// A call: the name, and the subprogram once it is known.
#[derive(Clone, Debug)]
pub(crate) struct CallSite {
    pub(crate) label: Label,
    pub(crate) is_m98: bool,
    pub(crate) sub: Option<SubId>,
    pub(crate) line: u32,
    pub(crate) at: crate::diag::Span,
}

#[derive(Clone, Debug)]
struct CompiledLine {
    /// Line number in the file, from 1.
    line: u32,
    number: Option<BlockNumber>,
    jump: Jump,
    /// End of its parts; they begin where those of the previous line end.
    text: u32,
    items: u32,
    ops: u32,
    deferred: u32,
    /// Index of its comment.
    comment: Option<u32>,
}

/// Compiled lines of one file, with their text for diagnostics.
#[derive(Clone, Debug, Default)]
pub(crate) struct CompiledCode {
    /// Number of the file, 0 for the program itself.
    pub(crate) file: u16,
    pub(crate) calls: Vec<CallSite>,
    /// Calls of cycles, with their lines.
    pub(crate) cycles: Vec<(u32, CycleCall)>,
    /// Positions of the numbered lines that GOTO may go to.
    pub(crate) line_numbers: LineNumbers,
    lines: Vec<CompiledLine>,
    text: Vec<u8>,
    items: Vec<PackedWord>,
    ops: Vec<Op>,
    deferred: Vec<DeferredValue>,
    comments: Vec<Comment>,
}

impl CompiledCode {
    pub(crate) fn new(file: u16) -> CompiledCode {
        CompiledCode { file, ..CompiledCode::default() }
    }

    /// Number of lines.
    pub(crate) fn len(&self) -> u32 {
        self.lines.len() as u32
    }

    /// Length of the text in bytes.
    pub(crate) fn text_len(&self) -> usize {
        self.text.len()
    }

    /// Appends line `line` of the file.
    pub(crate) fn push(&mut self, line: u32, text: &[u8], block: &NcBlock, jump: Jump) {
        self.text.extend_from_slice(text);
        block.words.pack(&mut self.items);
        self.ops.extend_from_slice(&block.ops);
        self.deferred.extend_from_slice(&block.deferred);
        let comment = block.comment.clone().map(|comment| {
            self.comments.push(comment);
            self.comments.len() as u32 - 1
        });
        self.lines.push(CompiledLine {
            line,
            number: block.number,
            jump,
            text: self.text.len() as u32,
            items: self.items.len() as u32,
            ops: self.ops.len() as u32,
            deferred: self.deferred.len() as u32,
            comment,
        });
    }

    pub(crate) fn jump(&self, line: u32) -> Option<Jump> {
        self.lines.get(line as usize).map(|line| line.jump)
    }

    pub(crate) fn set_jump(&mut self, line: u32, jump: Jump) {
        if let Some(line) = self.lines.get_mut(line as usize) {
            line.jump = jump;
        }
    }

    /// Removes this line, all lines after it, and the calls in them.
    pub(crate) fn truncate(&mut self, line: u32) {
        self.lines.truncate(line as usize);
        let (text, items, ops, deferred) =
            self.lines.last().map_or((0, 0, 0, 0), |last| (last.text, last.items, last.ops, last.deferred));
        self.text.truncate(text as usize);
        self.items.truncate(items as usize);
        self.ops.truncate(ops as usize);
        self.deferred.truncate(deferred as usize);
        let last = self.lines.last().map_or(0, |last| last.line);
        self.calls.retain(|call| call.line <= last);
        self.cycles.retain(|(line, _)| *line <= last);
    }

    /// Returns the N word of a line.
    pub(crate) fn block_number(&self, line: u32) -> Option<u64> {
        self.lines.get(line as usize)?.number.map(BlockNumber::value)
    }

    /// Returns the number of a line in its file.
    pub(crate) fn line_number(&self, line: u32) -> u32 {
        self.lines.get(line as usize).map_or(0, |line| line.line)
    }

    /// Returns the text of a line.
    pub(crate) fn text(&self, line: u32) -> &[u8] {
        self.text.get(self.range(line, |line| line.text)).unwrap_or_default()
    }

    /// Loads the compiled line into `block`.
    #[inline]
    pub(crate) fn load(&self, line: u32, block: &mut NcBlock) {
        let Some(packed) = self.lines.get(line as usize) else { return };
        block.number = packed.number;
        block.control = None;
        block.comment = packed.comment.and_then(|comment| self.comments.get(comment as usize)).cloned();
        block.words.unpack(self.items.get(self.range(line, |line| line.items)).unwrap_or_default());
        block.ops.clear();
        block.deferred.clear();
        let deferred = self.range(line, |line| line.deferred);
        if !deferred.is_empty() {
            block.ops.extend_from_slice(self.ops.get(self.range(line, |line| line.ops)).unwrap_or_default());
            block.deferred.extend_from_slice(self.deferred.get(deferred).unwrap_or_default());
        }
    }

    fn range(&self, line: u32, end: impl Fn(&CompiledLine) -> u32) -> Range<usize> {
        let index = line as usize;
        let start = index.checked_sub(1).and_then(|before| self.lines.get(before)).map_or(0, &end);
        start as usize..self.lines.get(index).map_or(start, end) as usize
    }
}

impl LineNumbers {
    /// Collects the numbers of all lines of `code`. `starts` are the first lines of its subprograms for M98, in order.
    pub(crate) fn collect(code: &CompiledCode, starts: Vec<u32>) -> LineNumbers {
        let mut numbers = LineNumbers { lines: Vec::new(), parts: starts, loops: Vec::new() };
        for line in 0..code.len() {
            if let Some(number) = code.block_number(line) {
                numbers.lines.push((numbers.part_of(line), number, line));
            }
            if let Some(Jump::While { end }) = code.jump(line) {
                numbers.loops.push(line..end);
            }
        }
        numbers.lines.sort_unstable();
        numbers
    }
}
