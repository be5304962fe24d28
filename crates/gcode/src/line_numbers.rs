//! Targets of GOTO: line numbers (N words) and the compiled lines that have them.
//!
//! Invariant: a GOTO stays within its part of the file (the program or one subprogram of M98), and never enters a WHILE
//! loop from outside. Of several lines with one number, the next one ahead counts, or otherwise the first.

use crate::diag::{BlockError, Span};
use crate::error_codes::ErrorCode;
use crate::lex::Cursor;
use std::fmt;
use std::ops::Range;

/// Line numbers of compiled lines.
#[derive(Clone, Debug, Default)]
pub(crate) struct LineNumbers {
    /// Part of the file, number, compiled line; sorted.
    pub(crate) lines: Vec<(u32, u64, u32)>,
    /// First lines of the parts of the file after the first.
    pub(crate) parts: Vec<u32>,
    /// WHILE loops, with the lines that begin them.
    pub(crate) loops: Vec<Range<u32>>,
}

/// Reason why a GOTO has no target; the number is that of its line number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GotoError {
    /// No line of this part of the file has the number.
    Missing(u64),
    /// The line is inside a WHILE loop, and the GOTO outside of it.
    InLoop(u64),
}

impl fmt::Display for GotoError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing(number) => write!(f, "there is no line N{number} here"),
            Self::InLoop(number) => write!(f, "N{number} is inside a WHILE loop"),
        }
    }
}

impl std::error::Error for GotoError {}

impl GotoError {
    /// Returns the error for the line with the GOTO.
    pub(crate) fn fault(self, at: Span) -> BlockError {
        let code = match self {
            Self::Missing(_) => ErrorCode::NoSuchLineNumber,
            Self::InLoop(_) => ErrorCode::GoToIntoLoop,
        };
        BlockError::new(code, at, self.to_string())
    }
}

/// Returns the N word of a line, from its text alone.
pub(crate) fn parse_n_word(text: &[u8]) -> Option<u64> {
    let mut cursor = Cursor::new(text);
    cursor.eat(b'/');
    if !cursor.eat(b'n') {
        return None;
    }
    match cursor.digits() {
        (1..=18, number) => Some(number),
        _ => None,
    }
}

/// Line numbers that a streamed program has passed.
#[derive(Debug, Default)]
pub(crate) struct SeenNumbers(Vec<u64>);

/// Maximum number of stored line numbers.
const MAX_SEEN: usize = 1 << 16;

impl SeenNumbers {
    /// Records that a line with this number was passed.
    pub(crate) fn record(&mut self, number: u64) {
        // They usually arrive in order.
        let place = match self.0.last() {
            Some(&last) if last < number => Err(self.0.len()),
            _ => self.0.binary_search(&number),
        };
        if let Err(place) = place
            && self.0.len() < MAX_SEEN
        {
            self.0.insert(place, number);
        }
    }

    /// Whether a line with this number was passed.
    pub(crate) fn has(&self, number: u64) -> bool {
        self.0.binary_search(&number).is_ok()
    }
}

impl LineNumbers {
    pub(crate) fn part_of(&self, line: u32) -> u32 {
        self.parts.partition_point(|start| *start <= line) as u32
    }

    /// Returns the line that a GOTO in line `from` goes to.
    pub(crate) fn find(&self, from: u32, number: u64) -> Result<u32, GotoError> {
        let part = self.part_of(from);
        let first = self.lines.partition_point(|line| *line < (part, number, 0));
        let ahead = self.lines.partition_point(|line| *line <= (part, number, from));
        let at = |index: usize| self.lines.get(index).filter(|line| (line.0, line.1) == (part, number));
        let &(_, _, to) = at(ahead).or_else(|| at(first)).ok_or(GotoError::Missing(number))?;
        let enters = |of: &&Range<u32>| of.start < to && to < of.end && !of.contains(&from);
        if self.loops.iter().any(|of| enters(&of)) { Err(GotoError::InLoop(number)) } else { Ok(to) }
    }
}
