//! Buffered text output and formatting of numbers, for every line of the canonical functions.
//!
//! Invariant: a number is formatted as by `printf`. A short piece is copied with a fixed length, of which only its own
//! part counts: the bytes after the end of the text have no meaning.

use std::io::{self, Write};

/// Number of buffered bytes at which they are written.
const ENOUGH: usize = 1 << 15;

/// Length with which short pieces are copied.
const PIECE: usize = 16;

/// All pairs of digits, the first in the lower byte.
const PAIRS: [u16; 100] = {
    let mut pairs = [0; 100];
    let mut value = 0;
    while value < 100 {
        pairs[value] = digit(value / 10) as u16 | (digit(value % 10) as u16) << 8;
        value += 1;
    }
    pairs
};

/// The numbers below 1 000 without leading zeros: the first digit in the lowest byte, the number of digits in the
/// highest.
const SHORT: [u32; 1000] = {
    let mut texts = [0; 1000];
    let mut value = 0;
    while value < 1000 {
        let (hundreds, tens, ones) = (digit(value / 100), digit(value / 10 % 10), digit(value % 10));
        texts[value] = match value {
            0..10 => ones | 1 << 24,
            10..100 => tens | ones << 8 | 2 << 24,
            _ => hundreds | tens << 8 | ones << 16 | 3 << 24,
        };
        value += 1;
    }
    texts
};

const fn digit(value: usize) -> u32 {
    b'0' as u32 + value as u32
}

fn pair(value: u32) -> u32 {
    PAIRS[(value % 100) as usize].into()
}

/// A short text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct TextPiece {
    text: [u8; PIECE],
    length: u8,
}

impl TextPiece {
    /// Creates a piece from characters, the first in the lowest byte.
    #[inline]
    fn from_chars(text: u128, length: u32) -> TextPiece {
        TextPiece { text: text.to_le_bytes(), length: length as u8 }
    }

    /// Formats a number with four decimals, rounded as `printf` does: from the exact value, ties to even. Returns
    /// `None` where that takes more than the nearest of two whole numbers, or more digits than fit.
    #[inline]
    pub(crate) fn format_number(value: f64) -> Option<TextPiece> {
        let scaled = value.abs() * 10_000.0;
        // For a value that is not a number or too large, the conversion saturates, and the rest is then not a fraction.
        let whole = scaled as u32;
        let fraction = scaled - f64::from(whole);
        // The product is off by less than 10⁻⁶ where it is below 10⁹, so a value farther from a tie rounds as the exact
        // value does.
        if !(scaled < 999_999_999.0 && (fraction - 0.5).abs() >= 1e-6) {
            return None;
        }
        let rounded = whole + u32::from(fraction > 0.5);
        let (integer, decimals) = (rounded / 10_000, rounded % 10_000);
        let decimals = u64::from(b'.') | u64::from(pair(decimals / 100) | pair(decimals) << 16) << 8;
        let (text, length) = match integer {
            0..1000 => {
                let short = SHORT[integer as usize];
                let length = short >> 24;
                (u128::from(u64::from(short & 0xff_ffff) | decimals << (8 * length)), length)
            }
            _ => {
                let (thousands, rest) = (SHORT[(integer / 1000) as usize % 1000], integer % 1000);
                let rest = u128::from(digit((rest / 100) as usize)) | u128::from(pair(rest)) << 8;
                let length = thousands >> 24;
                let whole = u128::from(thousands & 0xff_ffff) | rest << (8 * length);
                (whole | u128::from(decimals) << (8 * (length + 3)), length + 3)
            }
        };
        let sign = value.is_sign_negative();
        let text = if sign { text << 8 | u128::from(b'-') } else { text };
        Some(TextPiece::from_chars(text, length + 5 + u32::from(sign)))
    }
}

/// Text before it is written.
#[derive(Debug)]
pub(crate) struct TextBuffer {
    /// Longer than the text, so that pieces of a fixed length can be copied to its end.
    bytes: Vec<u8>,
    length: usize,
}

impl TextBuffer {
    pub(crate) fn new() -> TextBuffer {
        TextBuffer { bytes: vec![0; ENOUGH + 1024], length: 0 }
    }

    /// Returns the buffered text.
    pub(crate) fn text(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }

    pub(crate) fn clear(&mut self) {
        self.length = 0;
    }

    /// Whether the buffer should be written.
    #[inline]
    pub(crate) fn should_flush(&self) -> bool {
        self.length >= ENOUGH
    }

    /// Appends a text whose length is known at compile time.
    #[inline]
    pub(crate) fn push_fixed<const N: usize>(&mut self, text: &[u8; N]) {
        self.push_copied(text, N);
    }

    /// Appends a short text.
    #[inline]
    pub(crate) fn push_piece(&mut self, piece: &TextPiece) {
        self.push_copied(&piece.text, piece.length.into());
    }

    /// Appends the first `length` of these characters.
    #[inline]
    fn push_copied<const N: usize>(&mut self, text: &[u8; N], length: usize) {
        match self.bytes.get_mut(self.length..).and_then(|rest| rest.first_chunk_mut::<N>()) {
            Some(place) => *place = *text,
            None => self.grow(text),
        }
        self.length += length;
    }

    /// Appends a text of any length.
    pub(crate) fn push_text(&mut self, text: &[u8]) {
        match self.bytes.get_mut(self.length..self.length + text.len()) {
            Some(place) => place.copy_from_slice(text),
            None => self.grow(text),
        }
        self.length += text.len();
    }

    #[cold]
    fn grow(&mut self, text: &[u8]) {
        self.bytes.truncate(self.length);
        self.bytes.extend_from_slice(text);
    }

    /// Appends a number with four decimals.
    #[inline]
    pub(crate) fn push_number(&mut self, value: f64) -> io::Result<()> {
        match TextPiece::format_number(value) {
            Some(piece) => {
                self.push_piece(&piece);
                Ok(())
            }
            None => write!(self, "{value:.4}"),
        }
    }
}

impl Write for TextBuffer {
    fn write(&mut self, text: &[u8]) -> io::Result<usize> {
        self.push_text(text);
        Ok(text.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Position of the blank after the counter; the digits end before it.
const BLANK: usize = 20;

/// Text in place of a missing block number.
const NO_NUMBER: &[u8; 7] = b"N..... ";

/// Beginning of a line: the counter, five characters wide, a blank, and the number of the block, seven characters wide.
#[derive(Debug)]
pub(crate) struct LineHead {
    text: [u8; BLANK + 1 + NO_NUMBER.len()],
    /// Position of the first digit of the counter.
    first: usize,
}

impl LineHead {
    /// Creates the head before the first line.
    pub(crate) fn new() -> LineHead {
        let mut text = [b' '; BLANK + 1 + NO_NUMBER.len()];
        text[BLANK - 1] = b'0';
        text[BLANK + 1..].copy_from_slice(NO_NUMBER);
        LineHead { text, first: BLANK - 5 }
    }

    /// Increments the counter.
    #[inline]
    fn increment(&mut self) {
        let mut at = BLANK - 1;
        loop {
            let Some(place) = self.text.get_mut(at) else { return };
            match *place {
                b'9' => *place = b'0',
                b' ' => {
                    *place = b'1';
                    break;
                }
                _ => {
                    *place += 1;
                    break;
                }
            }
            at = at.wrapping_sub(1);
        }
        self.first = self.first.min(at);
    }

    /// Increments the counter and appends the beginning of a line. The number of the block is its value and its number
    /// of digits as written.
    #[inline]
    pub(crate) fn push_head(&mut self, out: &mut TextBuffer, number: Option<(u64, u8)>) {
        self.increment();
        let end = if number.is_some() { BLANK + 1 } else { self.text.len() };
        match self.text.get(self.first..).and_then(|rest| rest.first_chunk::<13>()) {
            // Up to 99 999 lines.
            Some(head) if self.first == BLANK - 5 => out.push_copied(head, end - self.first),
            _ => out.push_text(self.text.get(self.first..end).unwrap_or_default()),
        }
        if let Some((value, digits)) = number {
            block_number(out, value, digits.into());
        }
    }
}

/// Appends N and the digits, seven characters wide.
fn block_number(out: &mut TextBuffer, mut value: u64, digits: usize) {
    let mut text = [b'0'; 24];
    let mut first = text.len();
    while value >= 10 {
        first -= 2;
        text[first..first + 2].copy_from_slice(&PAIRS[(value % 100) as usize].to_le_bytes());
        value /= 100;
    }
    if value > 0 {
        first -= 1;
        text[first] = b'0' + value as u8;
    }
    first = first.min(text.len() - digits.clamp(1, 20));
    out.push_fixed(b"N");
    out.push_text(&text[first..]);
    out.push_text(b"      ".get(text.len() - first..).unwrap_or_default());
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn text(value: f64) -> String {
        let mut out = TextBuffer::new();
        out.push_number(value).expect("memory");
        String::from_utf8(out.text().to_vec()).expect("digits")
    }

    proptest! {
        #[test]
        fn a_number_is_rounded_from_its_exact_value(value in any::<f64>(), scale in -1_000_000_000..1_000_000_000_i64) {
            // Ties and their neighbours, and arbitrary values.
            let tie = scale as f64 / 20_000.0;
            for value in [value, tie, tie.next_up(), tie.next_down(), scale as f64 / 32.0, scale as f64 * 1e-9,
                tie * 1e-3] {
                prop_assert_eq!(text(value), format!("{value:.4}"));
            }
        }

        #[test]
        fn a_block_number_has_its_digits_and_seven_places(value in any::<u64>(), short in 0..2000_u64,
            digits in 1..19_u8) {
            for value in [value % 1_000_000_000_000_000_000, short] {
                let mut out = TextBuffer::new();
                block_number(&mut out, value, digits.into());
                let number = format!("N{value:0width$}", width = usize::from(digits));
                prop_assert_eq!(String::from_utf8_lossy(out.text()), format!("{number:7}"));
            }
        }

        #[test]
        fn texts_of_any_length_come_one_behind_the_other(texts in prop::collection::vec("[a-z]{0,3000}", 0..60)) {
            let mut out = TextBuffer::new();
            for text in &texts {
                out.push_text(text.as_bytes());
                out.push_fixed(b", ");
                out.push_number(1.5).expect("memory");
            }
            let whole: String = texts.iter().map(|text| format!("{text}, 1.5000")).collect();
            prop_assert_eq!(String::from_utf8_lossy(out.text()), whole);
        }
    }

    #[test]
    fn the_counter_has_five_places_or_as_many_as_it_needs() {
        let mut head = LineHead::new();
        let mut out = TextBuffer::new();
        for value in 1..=1_100_000_u64 {
            out.clear();
            head.push_head(&mut out, None);
            if value < 2000 || value % 1000 < 2 {
                assert_eq!(String::from_utf8_lossy(out.text()), format!("{value:5} N..... "));
            }
        }
        out.clear();
        head.push_head(&mut out, Some((20, 4)));
        assert_eq!(out.text(), b"1100001 N0020  ");
    }

    #[test]
    fn signs_of_zero_and_ends_of_the_fast_way() {
        for value in [0.0, -0.0, -0.00004, 0.00005, 999.9999, 1000.0, 99_999.999_95, 99_999.999_9, 100_000.0, 1e300] {
            assert_eq!(text(value), format!("{value:.4}"));
        }
        assert_eq!(text(f64::NAN), "NaN");
    }
}
