//! The lines of a program, and those that may be needed again.
//!
//! Invariant: one line is held, until a program asks to keep lines because it jumps; from there on all are held. A line that is too
//! long is never held whole.

use crate::parse::LONGEST_LINE;
use std::io::{self, BufRead, Read as _};

/// The lines of a program, taken one after the other, with jumps among those that are kept.
#[derive(Debug)]
pub(crate) struct Lines<R> {
    input: R,
    /// Lines read from the input so far.
    read: u32,
    /// The line that was taken last, from 1; 0 before the first.
    current: u32,
    text: Vec<u8>,
    /// Number of the first line that is kept; none before the first jump.
    kept_from: Option<u32>,
    kept: Vec<u8>,
    /// End of each kept line in `kept`.
    ends: Vec<usize>,
}

impl<R: BufRead> Lines<R> {
    pub(crate) fn new(input: R) -> Lines<R> {
        let (text, kept, ends) = (Vec::new(), Vec::new(), Vec::new());
        Lines { input, read: 0, current: 0, text, kept_from: None, kept, ends }
    }

    /// Takes the next line; false when there is none.
    ///
    /// # Errors
    /// Those of the reader.
    pub(crate) fn advance(&mut self) -> io::Result<bool> {
        if self.current < self.read {
            self.current += 1;
            let range = self.kept_range(self.current);
            self.text.clear();
            self.text.extend_from_slice(self.kept.get(range).unwrap_or_default());
            return Ok(true);
        }
        if !self.read_text()? {
            return Ok(false);
        }
        self.read = self.read.saturating_add(1);
        self.current = self.read;
        if self.kept_from.is_some() {
            self.keep_text();
        }
        Ok(true)
    }

    /// The line taken last, without its end; cut off when it is too long.
    pub(crate) fn text(&self) -> &[u8] {
        &self.text
    }

    /// The number of the line taken last, from 1.
    pub(crate) fn number(&self) -> u32 {
        self.current
    }

    /// Keeps this line and all that follow.
    pub(crate) fn keep(&mut self) {
        if self.kept_from.is_none() {
            self.kept_from = Some(self.current);
            self.keep_text();
        }
    }

    /// Makes `line` the one taken last, so that the one behind it is next. Either of them must have been kept.
    pub(crate) fn go_to(&mut self, line: u32) {
        let range = self.kept_range(line);
        if let Some(text) = self.kept.get(range) {
            self.current = line;
            self.text.clear();
            self.text.extend_from_slice(text);
        }
    }

    fn keep_text(&mut self) {
        self.kept.extend_from_slice(&self.text);
        self.ends.push(self.kept.len());
    }

    fn kept_range(&self, line: u32) -> std::ops::Range<usize> {
        let index = line.saturating_sub(self.kept_from.unwrap_or(u32::MAX)) as usize;
        let start = if index == 0 { 0 } else { self.ends.get(index - 1).copied().unwrap_or(usize::MAX) };
        start..self.ends.get(index).copied().unwrap_or(start)
    }

    fn read_text(&mut self) -> io::Result<bool> {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn rest(lines: &mut Lines<&[u8]>) -> Vec<String> {
        let mut texts = Vec::new();
        while lines.advance().expect("a slice") {
            texts.push(format!("{} {}", lines.number(), String::from_utf8_lossy(lines.text())));
        }
        texts
    }

    #[test]
    fn a_jump_back_gives_the_same_lines_again() {
        let mut lines = Lines::new("a\r\nb\n\nd".as_bytes());
        assert!(lines.advance().expect("a") && lines.advance().expect("b"));
        lines.keep();
        assert_eq!(rest(&mut lines), ["3 ", "4 d"]);
        lines.go_to(2);
        assert_eq!(lines.text(), b"b");
        assert_eq!(rest(&mut lines), ["3 ", "4 d"]);
    }

    #[test]
    fn a_line_that_is_too_long_is_cut_off_and_the_next_one_is_whole() {
        let text = format!("{}\nG0\n", "x".repeat(100_000));
        let mut lines = Lines::new(text.as_bytes());
        assert!(lines.advance().expect("the long one"));
        assert_eq!(lines.text().len(), LONGEST_LINE + 3);
        assert_eq!(rest(&mut lines), ["2 G0"]);
    }
}
