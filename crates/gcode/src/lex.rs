//! Reading of the characters and numbers of one line.
//!
//! Invariant: blanks between any two characters are ignored, as in RS274/NGC. The cursor never leaves the line.

use crate::bytes::{byte_order_mark, short_number};
use crate::diag::{BlockError, BlockResult, Span, fault};
use crate::error_codes::ErrorCode;

/// A position in one line.
#[derive(Clone)]
pub(crate) struct Cursor<'a> {
    text: &'a [u8],
    at: usize,
}

/// Powers of ten that are exact as `f64`.
const POWERS_OF_TEN: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

/// Largest integer below which all are exact as `f64`.
const EXACT: u64 = 1 << 53;

const fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r')
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(text: &'a [u8]) -> Cursor<'a> {
        Cursor { text, at: byte_order_mark(text) }
    }

    /// Returns the next character that is not blank, in lower case, without consuming it; 0 at the end.
    #[inline]
    pub(crate) fn peek(&mut self) -> u8 {
        match self.text.get(self.at) {
            Some(&byte) if !is_blank(byte) => byte.to_ascii_lowercase(),
            // One blank between two words is the usual case.
            Some(_) => match self.text.get(self.at + 1) {
                Some(&byte) if !is_blank(byte) => {
                    self.at += 1;
                    byte.to_ascii_lowercase()
                }
                _ => self.peek_after_blanks(),
            },
            None => 0,
        }
    }

    #[inline(never)]
    fn peek_after_blanks(&mut self) -> u8 {
        let rest = self.text.get(self.at..).unwrap_or_default();
        let blanks = rest.iter().position(|byte| !is_blank(*byte)).unwrap_or(rest.len());
        self.at += blanks;
        rest.get(blanks).map_or(0, u8::to_ascii_lowercase)
    }

    /// Consumes the character that [`Cursor::peek`] has returned.
    #[inline]
    pub(crate) fn skip(&mut self) {
        self.at += 1;
    }

    /// Returns the character after the next one, ignoring blanks; valid after [`Cursor::peek`].
    #[inline]
    pub(crate) fn peek_next(&self) -> Option<u8> {
        self.text.get(self.at + 1..)?.iter().copied().find(|byte| !is_blank(*byte))
    }

    /// Consumes the next character if it is this one.
    #[inline]
    pub(crate) fn eat(&mut self, wanted: u8) -> bool {
        // A branch, because rustc 1.95 loses the addition of `self.at += usize::from(found)` here in optimised builds.
        if self.peek() == wanted {
            self.at += 1;
            true
        } else {
            false
        }
    }

    /// Consumes these characters, or nothing.
    pub(crate) fn eat_word(&mut self, wanted: &[u8]) -> bool {
        let start = self.at;
        let found = wanted.iter().all(|&letter| self.eat(letter));
        if !found {
            self.at = start;
        }
        found
    }

    /// Returns the position of the next character.
    #[inline]
    pub(crate) fn position(&self) -> usize {
        self.at
    }

    /// Returns the span from `start` to here.
    #[inline]
    pub(crate) fn span_from(&self, start: usize) -> Span {
        Span::new(start, self.at)
    }

    /// Returns the span of the next character alone.
    pub(crate) fn next_span(&mut self) -> Span {
        self.peek();
        Span::new(self.at, (self.at + 1).min(self.text.len()))
    }

    /// Whether the next character follows this one, blanks aside.
    pub(crate) fn follows(&mut self, before: u8) -> bool {
        self.peek();
        let taken = self.text.get(..self.at).unwrap_or_default();
        taken.iter().rev().find(|byte| !is_blank(**byte)) == Some(&before)
    }

    /// Returns the byte at a position of the line.
    pub(crate) fn byte(&self, at: usize) -> Option<u8> {
        self.text.get(at).copied()
    }

    /// Returns the text not yet consumed.
    pub(crate) fn remaining(&self) -> &'a [u8] {
        self.text.get(self.at..).unwrap_or_default()
    }

    /// Consumes everything up to and including `closing`; `None` if it does not occur.
    pub(crate) fn take_to(&mut self, closing: u8) -> Option<&'a [u8]> {
        let rest = self.text.get(self.at..).unwrap_or_default();
        let length = rest.iter().position(|&byte| byte == closing)?;
        self.at += length + 1;
        Some(&rest[..length])
    }

    /// Moves to the end of the line.
    pub(crate) fn finish(&mut self) {
        self.at = self.text.len();
    }

    /// Consumes digits. Returns their number, and their value, which saturates at 2⁶⁴ − 1.
    pub(crate) fn digits(&mut self) -> (u32, u64) {
        let (mut count, mut value) = (0, 0_u64);
        while let digit @ b'0'..=b'9' = self.peek() {
            value = value.saturating_mul(10).saturating_add(u64::from(digit - b'0'));
            count += 1;
            self.skip();
        }
        (count, value)
    }

    /// Consumes a number without a sign: digits with at most one decimal point.
    #[inline]
    pub(crate) fn number(&mut self) -> BlockResult<f64> {
        self.peek();
        if let Some(short) = short_number(self.text, self.at) {
            let end = self.at + short.length as usize;
            if !self.number_continues(end) {
                self.at = end;
                return Ok(f64::from(short.mantissa) / POWERS_OF_TEN[short.decimals as usize % POWERS_OF_TEN.len()]);
            }
        }
        self.longer_number()
    }

    /// Whether a number continues at this position, with a second point or after blanks.
    #[inline]
    fn number_continues(&self, end: usize) -> bool {
        self.text
            .get(end)
            .is_some_and(|&byte| byte == b'.' || (is_blank(byte) && number_continues_after(self.text, end)))
    }

    #[inline(never)]
    fn longer_number(&mut self) -> BlockResult<f64> {
        let text = self.text.get(self.at..).unwrap_or_default();
        let (mut at, mut mantissa) = (0, 0);
        take_digits(text, &mut at, &mut mantissa);
        let mut decimals = 0;
        let mut points = 0;
        if text.get(at) == Some(&b'.') {
            points = 1;
            at += 1;
            decimals = take_digits(text, &mut at, &mut mantissa);
        }
        // A number with a plain end and an exact value needs no further work.
        if !self.number_continues(self.at + at) && (1..=15).contains(&(at - points)) {
            self.at += at;
            return Ok(mantissa as f64 / POWERS_OF_TEN[decimals]);
        }
        self.spaced_number()
    }

    /// Reads a number with blanks among its digits, or with very many of them, or none.
    fn spaced_number(&mut self) -> BlockResult<f64> {
        let start = self.at;
        let (mut mantissa, mut digits, mut decimals, mut point) = (0_u64, 0_u32, 0_usize, false);
        let mut end = start;
        while let Some(&byte) = self.text.get(self.at) {
            match byte {
                b'0'..=b'9' => {
                    mantissa = mantissa.wrapping_mul(10).wrapping_add(u64::from(byte - b'0'));
                    digits += u32::from(mantissa != 0);
                    decimals += usize::from(point);
                    end = self.at + 1;
                }
                b'.' if !point => {
                    point = true;
                    end = self.at + 1;
                }
                b'.' => {
                    return fault(
                        ErrorCode::BadNumber,
                        Span::new(start, self.at + 1),
                        "a number has one decimal point",
                    );
                }
                blank if is_blank(blank) => {}
                _ => break,
            }
            self.at += 1;
        }
        self.at = end;
        if digits <= 18 && mantissa <= EXACT && decimals < POWERS_OF_TEN.len() && end > start {
            if end - start == 1 && point {
                return fault(ErrorCode::BadNumber, Span::new(start, end), "a decimal point alone is not a number");
            }
            return Ok(mantissa as f64 / POWERS_OF_TEN[decimals]);
        }
        self.long_number(start, end)
    }

    /// Reads a number that needs more than one division of exact values, or none.
    #[cold]
    fn long_number(&self, start: usize, end: usize) -> BlockResult<f64> {
        let span = Span::new(start, end.max((start + 1).min(self.text.len())));
        let digits: String =
            self.text[start..end].iter().filter(|byte| !is_blank(**byte)).map(|byte| char::from(*byte)).collect();
        if digits.is_empty() {
            return fault(ErrorCode::NumberMissing, span, "a number is missing here");
        }
        match digits.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => Err(Box::new(BlockError::plain(ErrorCode::NumberTooLarge, span))),
            Err(_) => Err(Box::new(BlockError::plain(ErrorCode::BadNumber, span))),
        }
    }
}

/// Consumes digits, and returns their number.
#[inline]
fn take_digits(text: &[u8], at: &mut usize, value: &mut u64) -> usize {
    let start = *at;
    while let Some(digit) = text.get(*at).map(|byte| byte.wrapping_sub(b'0')).filter(|digit| *digit < 10) {
        *value = value.wrapping_mul(10).wrapping_add(u64::from(digit));
        *at += 1;
    }
    *at - start
}

/// Whether a number continues after the blank at this position: the next character except blanks is a digit or a point.
#[inline]
fn number_continues_after(text: &[u8], at: usize) -> bool {
    let next = text.get(at..).unwrap_or_default().iter().find(|byte| !is_blank(**byte));
    next.is_some_and(|byte| matches!(byte, b'0'..=b'9' | b'.'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn number(text: &str) -> Result<f64, ErrorCode> {
        Cursor::new(text.as_bytes()).number().map_err(|fault| fault.code)
    }

    proptest! {
        /// The value read is the `f64` nearest to the decimal number, whatever its length.
        #[test]
        fn a_number_is_read_exactly(text in "[0-9]{1,24}(\\.[0-9]{0,30})?") {
            prop_assert_eq!(number(&text), Ok(text.parse::<f64>().expect("a decimal number")));
        }

        #[test]
        fn blanks_in_a_number_change_nothing(whole in "[0-9]{1,6}", decimals in "[0-9]{1,6}", blank in "[ \t]{0,2}") {
            let plain = format!("{whole}.{decimals}");
            let spaced = format!("{whole}{blank}.{blank}{decimals}");
            prop_assert_eq!(number(&spaced), number(&plain));
        }
    }

    #[test]
    fn what_is_no_number_is_refused() {
        assert_eq!(number("1.5.5"), Err(ErrorCode::BadNumber));
        assert_eq!(number("."), Err(ErrorCode::BadNumber));
        assert_eq!(number(" . "), Err(ErrorCode::BadNumber));
        assert_eq!(number(""), Err(ErrorCode::NumberMissing));
        assert_eq!(number("x"), Err(ErrorCode::NumberMissing));
        assert_eq!(number(&"9".repeat(1000)), Err(ErrorCode::NumberTooLarge));
        assert_eq!(number(&format!("0.{}", "9".repeat(1000))), Ok(1.0));
    }

    #[test]
    fn the_cursor_stops_right_after_the_last_digit() {
        let mut cursor = Cursor::new(b"12 . 5  Y");
        assert_eq!(cursor.number().ok(), Some(12.5));
        assert_eq!(cursor.position(), 6);
        assert_eq!(cursor.peek(), b'y');
    }
}
