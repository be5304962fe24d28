//! The lines of a program, one after the other.
//!
//! Invariant: one line is held; a line that is too long is never held whole.

use crate::bytes::line_feed;
use crate::parse::LONGEST_LINE;
use std::io::{self, BufRead, Read as _};
use std::sync::Arc;

/// Bytes of a line that are held: one more than the longest shows that it is too long, two are its end.
const MOST_HELD: usize = LONGEST_LINE + 3;

/// The text of a file, shared.
#[derive(Clone, Debug, Default)]
pub struct Text(Arc<Vec<u8>>);

impl From<Vec<u8>> for Text {
    fn from(bytes: Vec<u8>) -> Text {
        Text(Arc::new(bytes))
    }
}

impl From<&[u8]> for Text {
    fn from(bytes: &[u8]) -> Text {
        Text::from(bytes.to_vec())
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Text {
        Text::from(text.as_bytes())
    }
}

impl std::ops::Deref for Text {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.0
    }
}

/// Where lines come from.
#[derive(Debug)]
enum Input<R> {
    /// A text that is at hand, and where its next line begins.
    Text(Text, usize),
    /// A program that arrives, and the line that has been taken.
    Arriving(R, Vec<u8>),
}

/// The lines of a program.
#[derive(Debug)]
pub(crate) struct Lines<R> {
    input: Input<R>,
    /// The line that was taken last, from 1; 0 before the first.
    current: u32,
    /// Where it stands in a text that is at hand.
    place: (usize, usize),
}

impl<R: BufRead> Lines<R> {
    pub(crate) fn new(input: R) -> Lines<R> {
        Lines { input: Input::Arriving(input, Vec::new()), current: 0, place: (0, 0) }
    }

    /// The lines of a text.
    pub(crate) fn of_text(text: Text) -> Lines<R> {
        Lines { input: Input::Text(text, 0), current: 0, place: (0, 0) }
    }

    /// Takes the next line; false when there is none.
    ///
    /// # Errors
    /// Those of the reader.
    #[inline]
    pub(crate) fn advance(&mut self) -> io::Result<bool> {
        let found = match &mut self.input {
            Input::Text(text, next) => match split(text.get(*next..).unwrap_or_default()) {
                Some((line, taken)) => {
                    self.place = (*next, *next + line);
                    *next += taken;
                    true
                }
                None => false,
            },
            Input::Arriving(input, line) => arrive(input, line)?,
        };
        self.current = self.current.saturating_add(u32::from(found));
        Ok(found)
    }

    /// Passes over lines, so that `line` is the next one.
    ///
    /// # Errors
    /// Those of the reader.
    pub(crate) fn skip_to(&mut self, line: u32) -> io::Result<()> {
        while self.current.saturating_add(1) < line && self.advance()? {}
        Ok(())
    }

    /// The line taken last, without its end; cut off when it is too long.
    #[inline]
    pub(crate) fn text(&self) -> &[u8] {
        match &self.input {
            Input::Text(text, _) => text.get(self.place.0..self.place.1).unwrap_or_default(),
            Input::Arriving(_, line) => line,
        }
    }

    /// The number of the line taken last, from 1.
    pub(crate) fn number(&self) -> u32 {
        self.current
    }
}

fn arrive(input: &mut impl BufRead, line: &mut Vec<u8>) -> io::Result<bool> {
    line.clear();
    if input.by_ref().take(MOST_HELD as u64).read_until(b'\n', line)? == 0 {
        return Ok(false);
    }
    if line.last() == Some(&b'\n') {
        line.pop();
        if line.last() == Some(&b'\r') {
            line.pop();
        }
    } else if line.len() == MOST_HELD {
        input.skip_until(b'\n')?;
    }
    Ok(true)
}

/// Length of the first line, without its end and cut off when it is too long, and with all of it; none of an empty text.
#[inline]
fn split(text: &[u8]) -> Option<(usize, usize)> {
    if text.is_empty() {
        return None;
    }
    let taken = line_feed(text).map_or(text.len(), |at| at + 1);
    let held = text.get(..taken.min(MOST_HELD)).unwrap_or_default();
    let line = match held {
        [line @ .., b'\r', b'\n'] | [line @ .., b'\n'] => line.len(),
        line => line.len(),
    };
    Some((line, taken))
}

/// The lines of a text, without their ends, cut off when they are too long: the same as [`Lines`] gives.
#[derive(Clone, Debug)]
pub(crate) struct Split<'a> {
    rest: &'a [u8],
}

impl<'a> Split<'a> {
    pub(crate) fn new(text: &'a [u8]) -> Split<'a> {
        Split { rest: text }
    }
}

impl<'a> Iterator for Split<'a> {
    type Item = &'a [u8];

    #[inline]
    fn next(&mut self) -> Option<&'a [u8]> {
        let (line, taken) = split(self.rest)?;
        let text = self.rest;
        self.rest = text.get(taken..).unwrap_or_default();
        text.get(..line)
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
            let mut at_hand = Lines::<&[u8]>::of_text(text.as_slice().into());
            for line in all(&text) {
                prop_assert!(at_hand.advance().expect("a text"));
                prop_assert_eq!(at_hand.text(), line);
            }
            prop_assert!(!at_hand.advance().expect("a text"));
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
