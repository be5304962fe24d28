//! The lines of a program, one after the other.
//!
//! Invariant: one line is held; a line that is too long is never held whole.

use crate::parse::LONGEST_LINE;
use std::io::{self, BufRead, Read as _};

/// Bytes of a line that are held: one more than the longest shows that it is too long, two are its end.
const MOST_HELD: usize = LONGEST_LINE + 3;

/// The lines of a program that arrives.
#[derive(Debug)]
pub(crate) struct Lines<R> {
    input: R,
    /// The line that was taken last, from 1; 0 before the first.
    current: u32,
    text: Vec<u8>,
}

impl<R: BufRead> Lines<R> {
    pub(crate) fn new(input: R) -> Lines<R> {
        Lines { input, current: 0, text: Vec::new() }
    }

    /// Takes the next line; false when there is none.
    ///
    /// # Errors
    /// Those of the reader.
    #[inline]
    pub(crate) fn advance(&mut self) -> io::Result<bool> {
        self.text.clear();
        if self.input.by_ref().take(MOST_HELD as u64).read_until(b'\n', &mut self.text)? == 0 {
            return Ok(false);
        }
        if self.text.last() == Some(&b'\n') {
            self.text.pop();
            if self.text.last() == Some(&b'\r') {
                self.text.pop();
            }
        } else if self.text.len() == MOST_HELD {
            self.input.skip_until(b'\n')?;
        }
        self.current = self.current.saturating_add(1);
        Ok(true)
    }

    /// Passes over lines, so that `line` is the next one.
    ///
    /// # Errors
    /// Those of the reader.
    pub(crate) fn skip_to(&mut self, line: u32) -> io::Result<()> {
        while self.current.saturating_add(1) < line && self.input.skip_until(b'\n')? > 0 {
            self.current += 1;
        }
        Ok(())
    }

    /// The line taken last, without its end; cut off when it is too long.
    pub(crate) fn text(&self) -> &[u8] {
        &self.text
    }

    /// The number of the line taken last, from 1.
    pub(crate) fn number(&self) -> u32 {
        self.current
    }
}

/// The lines of a text, without their ends, cut off when they are too long: the same as [`Lines`] gives.
#[derive(Clone, Debug)]
pub(crate) struct Split<'a> {
    rest: Option<&'a [u8]>,
}

impl<'a> Split<'a> {
    pub(crate) fn new(text: &'a [u8]) -> Split<'a> {
        Split { rest: (!text.is_empty()).then_some(text) }
    }
}

impl<'a> Iterator for Split<'a> {
    type Item = &'a [u8];

    #[inline]
    fn next(&mut self) -> Option<&'a [u8]> {
        let text = self.rest?;
        let mut reader = text;
        // The slice's own search for the end is the standard library's fast one.
        let taken = reader.skip_until(b'\n').unwrap_or(text.len());
        let (line, rest) = text.split_at(taken);
        self.rest = (!rest.is_empty()).then_some(rest);
        Some(match line.get(..MOST_HELD).unwrap_or(line) {
            [line @ .., b'\r', b'\n'] | [line @ .., b'\n'] => line,
            line => line,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all(text: &[u8]) -> Vec<Vec<u8>> {
        let mut lines = Lines::new(text);
        let mut texts = Vec::new();
        while lines.advance().expect("a slice") {
            texts.push(lines.text().to_vec());
        }
        texts
    }

    proptest! {
        #[test]
        fn a_text_has_the_same_lines_at_once_and_as_it_arrives(text in prop::collection::vec(prop::sample::select(b"\r\nab".to_vec()), 0..40), long in 0_usize..600) {
            let text = [&text[..], &vec![b'x'; long], b"\r\n", &text].concat();
            prop_assert_eq!(all(&text), Split::new(&text).map(<[u8]>::to_vec).collect::<Vec<_>>());
        }
    }

    #[test]
    fn lines_are_passed_over_and_a_long_one_is_cut_off() {
        let text = format!("a\nb\n{}\nG0\n", "x".repeat(100_000));
        let mut lines = Lines::new(text.as_bytes());
        lines.skip_to(3).expect("a slice");
        assert!(lines.advance().expect("the long one") && lines.text().len() == MOST_HELD);
        assert!(lines.advance().expect("the next one"));
        assert_eq!((lines.number(), lines.text()), (4, &b"G0"[..]));
        assert!(!lines.advance().expect("the end"));
    }
}
