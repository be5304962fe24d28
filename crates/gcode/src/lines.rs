//! The lines of a program, one after another.
//!
//! Invariant: one line is held; a line that is too long is never held whole. In a streamed program, a line without its
//! end is returned only where it ends the program: the sender may have been cut off inside it (DNC-10).

use crate::bytes::{byte_order_mark, line_feed};
use crate::diag::{BlockError, Span};
use crate::error_codes::ErrorCode;
use crate::line_split::MAX_HELD_LINE;
use crate::text::{Text, TextLines};
use std::io::{self, BufRead, Read as _};

/// Maximum number of bytes skipped in a line; a longer line is not a program.
const MAX_SKIPPED: usize = 1 << 20;

/// Source of lines.
#[derive(Debug)]
enum LineSource<R> {
    /// A text that is available.
    Text(TextLines),
    /// A streamed program, and its current line.
    Arriving(R, Vec<u8>),
}

/// The lines of a program.
#[derive(Debug)]
pub(crate) struct Lines<R> {
    input: LineSource<R>,
    /// Number of the current line, from 1; 0 before the first.
    current: u32,
    /// Whether a streamed program ended inside a line.
    is_cut_off: bool,
}

impl<R: BufRead> Lines<R> {
    pub(crate) fn new(input: R) -> Lines<R> {
        Lines { input: LineSource::Arriving(input, Vec::new()), current: 0, is_cut_off: false }
    }

    /// Creates the lines of a text.
    pub(crate) fn of_text(text: Text) -> Lines<R> {
        Lines { input: LineSource::Text(TextLines::new(text)), current: 0, is_cut_off: false }
    }

    /// Reads the next line; false when there is none.
    ///
    /// # Errors
    /// Errors of the reader.
    #[inline]
    pub(crate) fn advance(&mut self) -> io::Result<bool> {
        let found = match &mut self.input {
            LineSource::Text(lines) => lines.advance()?,
            LineSource::Arriving(input, line) => match arrive(input, line)? {
                LineArrival::Line => true,
                LineArrival::Nothing => false,
                LineArrival::CutOff => {
                    self.is_cut_off = true;
                    false
                }
            },
        };
        self.current = self.current.saturating_add(u32::from(found));
        Ok(found)
    }

    /// Skips lines, so that `line` is the next one.
    ///
    /// # Errors
    /// Errors of the reader.
    pub(crate) fn skip_to(&mut self, line: u32) -> io::Result<()> {
        while self.current.saturating_add(1) < line && self.advance()? {}
        Ok(())
    }

    /// Returns the current line, without its end; truncated when it is too long.
    #[inline]
    pub(crate) fn text(&self) -> &[u8] {
        match &self.input {
            LineSource::Text(lines) => lines.line(),
            LineSource::Arriving(_, line) => line,
        }
    }

    /// Returns the beginning of the line inside which a streamed program has ended; it is not executed.
    pub(crate) fn cut_off(&self) -> Option<&[u8]> {
        match &self.input {
            LineSource::Arriving(_, line) if self.is_cut_off => Some(line),
            _ => None,
        }
    }

    /// Returns the error that the program ended inside a line, if it did.
    pub(crate) fn cut_off_fault(&self) -> Option<Box<BlockError>> {
        let cut_off = String::from_utf8_lossy(self.cut_off()?);
        let message = format!("the streamed program ends inside a line: nothing of \"{cut_off}\" is executed");
        Some(Box::new(BlockError::new(ErrorCode::NoProgramEnd, Span::default(), message)))
    }

    /// Returns the number of the current line, from 1.
    pub(crate) fn number(&self) -> u32 {
        self.current
    }
}

/// Result of reading from a streamed program.
enum LineArrival {
    /// A line.
    Line,
    /// The end, after a line.
    Nothing,
    /// The end, inside a line.
    CutOff,
}

fn arrive(input: &mut impl BufRead, line: &mut Vec<u8>) -> io::Result<LineArrival> {
    line.clear();
    if input.by_ref().take(MAX_HELD_LINE as u64).read_until(b'\n', line)? == 0 {
        return Ok(LineArrival::Nothing);
    }
    if line.last() == Some(&b'\n') {
        line.pop();
        if line.last() == Some(&b'\r') {
            line.pop();
        }
    } else if line.len() == MAX_HELD_LINE {
        skip_line(input)?;
    } else if !is_program_end(line) {
        return Ok(LineArrival::CutOff);
    }
    Ok(LineArrival::Line)
}

/// Skips the rest of a line that is too long.
fn skip_line(input: &mut impl BufRead) -> io::Result<()> {
    let mut skipped = 0;
    loop {
        let waiting = input.fill_buf()?;
        let (count, is_over) = match line_feed(waiting) {
            Some(at) => (at + 1, true),
            None => (waiting.len(), waiting.is_empty()),
        };
        input.consume(count);
        skipped += count;
        if is_over {
            return Ok(());
        }
        if skipped > MAX_SKIPPED {
            let what = "E2311: a line of more than a mebibyte; the input is not a program";
            return Err(io::Error::new(io::ErrorKind::InvalidData, what));
        }
    }
}

/// Returns the error that the program cannot be read any further.
pub(crate) fn unreadable(error: &std::io::Error) -> BlockError {
    BlockError::new(ErrorCode::Unreadable, Span::default(), format!("{}: {error}", ErrorCode::Unreadable.title()))
}

/// Whether a line has a percent sign and nothing else.
pub(crate) fn is_percent(text: &[u8]) -> bool {
    text.contains(&b'%') && text[byte_order_mark(text)..].trim_ascii() == b"%"
}

/// Whether a last line without its end is nevertheless complete: exactly `M2`, `M30` or `%`, so that nothing relevant
/// can be missing.
pub(crate) fn is_program_end(line: &[u8]) -> bool {
    let line = line.strip_suffix(b"\r").unwrap_or(line);
    line == b"%" || line.eq_ignore_ascii_case(b"M2") || line.eq_ignore_ascii_case(b"M30")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line_split::SplitLines;
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
        fn a_text_has_the_same_lines_at_once_and_as_it_arrives(
            text in prop::collection::vec(prop::sample::select(b"\r\nab".to_vec()), 0..40), long in 0_usize..600,
        ) {
            let text = [&text[..], &vec![b'x'; long], b"\r\n", &text, b"\n"].concat();
            let mut at_hand = Lines::<&[u8]>::of_text(text.as_slice().into());
            for line in all(&text) {
                prop_assert!(at_hand.advance().expect("a text"));
                prop_assert_eq!(at_hand.text(), line);
            }
            prop_assert!(!at_hand.advance().expect("a text"));
            prop_assert_eq!(all(&text), SplitLines::new(&text).map(<[u8]>::to_vec).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_line_that_never_ends_is_refused() {
        let mut lines = Lines::new(io::BufReader::new(io::repeat(0)));
        assert!(lines.advance().expect_err("endless").to_string().contains("E2311"));
    }

    #[test]
    fn a_last_line_without_its_end_is_given_only_where_it_ends_the_program() {
        for end in ["M2", "m30", "%", "M30\r"] {
            assert_eq!(all(format!("G0 X1\n{end}").as_bytes()).len(), 2, "{end:?}");
        }
        for cut in ["G0 Z1", "M3", "M", " ", "N9 M30", "M2 "] {
            let text = format!("G0 X1\n{cut}");
            let mut lines = Lines::new(text.as_bytes());
            assert!(lines.advance().expect("a line") && lines.cut_off().is_none());
            assert!(!lines.advance().expect("the end"));
            assert_eq!((lines.number(), lines.cut_off()), (1, Some(cut.as_bytes())));
        }
    }

    #[test]
    fn lines_are_passed_over_and_a_long_one_is_cut_off() {
        let text = format!("a\nb\n{}\nG0\n", "x".repeat(100_000));
        let mut lines = Lines::new(text.as_bytes());
        lines.skip_to(3).expect("a slice");
        assert!(lines.advance().expect("the long one") && lines.text().len() == MAX_HELD_LINE);
        assert!(lines.advance().expect("the next one"));
        assert_eq!((lines.number(), lines.text()), (4, &b"G0"[..]));
        assert!(!lines.advance().expect("the end"));
    }
}
