//! Text, split into lines.
//!
//! Invariant: a line is truncated where it is longer than any line of a program may be, and is refused then.

use crate::bytes::line_feed;

/// Maximum length of a line in bytes, without its end, as in LinuxCNC.
pub(crate) const MAX_LINE_LENGTH: usize = 252;
/// Maximum number of bytes held of a line: one more than the longest shows that it is too long, two are its end.
pub(crate) const MAX_HELD_LINE: usize = MAX_LINE_LENGTH + 3;

/// Returns the length of the first line without its end, truncated when it is too long, and its full length; `None` for
/// an empty text.
#[inline]
pub(crate) fn split(text: &[u8]) -> Option<(usize, usize)> {
    if text.is_empty() {
        return None;
    }
    let taken = line_feed(text).map_or(text.len(), |at| at + 1);
    let held = text.get(..taken.min(MAX_HELD_LINE)).unwrap_or_default();
    let line = match held {
        [line @ .., b'\r', b'\n'] | [line @ .., b'\n'] => line.len(),
        line => line.len(),
    };
    Some((line, taken))
}

/// Iterator over the lines of a text, without their ends, truncated when they are too long: the same as
/// [`Lines`](crate::lines::Lines)
/// returns.
#[derive(Clone, Debug)]
pub(crate) struct SplitLines<'a> {
    rest: &'a [u8],
}

impl<'a> SplitLines<'a> {
    pub(crate) fn new(text: &'a [u8]) -> SplitLines<'a> {
        SplitLines { rest: text }
    }
}

impl<'a> Iterator for SplitLines<'a> {
    type Item = &'a [u8];

    #[inline]
    fn next(&mut self) -> Option<&'a [u8]> {
        let (line, taken) = split(self.rest)?;
        let text = self.rest;
        self.rest = text.get(taken..).unwrap_or_default();
        text.get(..line)
    }
}
