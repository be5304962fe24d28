//! Search for characters and parsing of short numbers, eight characters at a time.
//!
//! Invariant: the first character is the lowest byte of a `u64`. No byte outside the text is read.

use std::borrow::Cow;

const ONES: u64 = 0x0101_0101_0101_0101;
const HIGH: u64 = 0x8080_8080_8080_8080;

/// Returns the first eight characters.
#[inline]
fn word(text: &[u8]) -> Option<u64> {
    text.first_chunk().map(|bytes| u64::from_le_bytes(*bytes))
}

/// Returns the position of the first line feed.
#[inline]
pub(crate) fn line_feed(text: &[u8]) -> Option<usize> {
    let mut at = 0;
    while let Some(word) = text.get(at..).and_then(word) {
        let differs = word ^ (ONES * b'\n' as u64);
        // The lowest byte that becomes 128 or more is the first that was 0; those above it may be wrong.
        let found = differs.wrapping_sub(ONES) & !differs & HIGH;
        if found != 0 {
            return Some(at + (found.trailing_zeros() / 8) as usize);
        }
        at += 8;
    }
    let rest = text.get(at..).unwrap_or_default();
    rest.iter().position(|byte| *byte == b'\n').map(|found| at + found)
}

/// Whether every character is printable ASCII.
#[inline]
pub(crate) fn is_plain(text: &[u8]) -> bool {
    // Below a blank, above a tilde, or not ASCII at all.
    let strange = |word: u64| (word.wrapping_sub(ONES * 0x20) | word.wrapping_add(ONES) | word) & HIGH;
    let mut found = 0;
    let mut at = 0;
    while let Some(word) = text.get(at..).and_then(word) {
        found |= strange(word);
        at += 8;
    }
    let rest = text.get(at..).unwrap_or_default();
    found == 0 && rest.iter().all(|byte| (b' '..0x7f).contains(byte))
}

/// A number at the beginning of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ShortNumber {
    /// Digits, without the decimal point.
    pub(crate) mantissa: u32,
    /// Number of digits after the decimal point.
    pub(crate) decimals: u32,
    /// Number of characters.
    pub(crate) length: u32,
}

/// Parses a number of at most seven characters that begins at `at`. It is followed by another character within eight
/// characters, or by the end of the text. Returns `None` for longer numbers and for those without a digit.
#[inline]
pub(crate) fn short_number(text: &[u8], at: usize) -> Option<ShortNumber> {
    let word = match text.get(at..).and_then(word) {
        Some(word) => word,
        None => {
            // The last eight characters of the text, without those before the number.
            let before = 8_usize.checked_sub(text.len().checked_sub(at)?)?;
            let last = u64::from_le_bytes(*text.last_chunk()?);
            last.checked_shr(8 * before as u32)?
        }
    };
    // Digits become 0 … 9; any other byte gets its highest bit set.
    let values = word ^ (ONES * u64::from(b'0'));
    let others = |values: u64| ((values & !HIGH).wrapping_add(ONES * 0x76) | values) & HIGH;
    let whole = (others(values).trailing_zeros() / 8).min(8);
    if whole == 8 {
        return None;
    }
    let is_point = (word >> (8 * whole)) & 0xff == u64::from(b'.');
    let (digits, count) = if is_point {
        let low = (1_u64 << (8 * whole)) - 1;
        // Removes the point. The byte shifted in from above is not a digit.
        let merged = (values & low) | (values >> 8 & !low) | 0x80 << 56;
        (merged, others(merged).trailing_zeros() / 8)
    } else {
        (values, whole)
    };
    let length = count + u32::from(is_point);
    if count == 0 || length > 7 {
        return None;
    }
    // Leading zeros fill the digits up to eight.
    let digits = digits << (64 - 8 * count);
    let pairs = (digits.wrapping_mul(10) + (digits >> 8)) & 0x00ff_00ff_00ff_00ff;
    let fours = (pairs.wrapping_mul(100) + (pairs >> 16)) & 0x0000_ffff_0000_ffff;
    let mantissa = (fours.wrapping_mul(10_000) + (fours >> 32)) as u32;
    Some(ShortNumber { mantissa, decimals: count - whole, length })
}

/// Returns the length of the UTF-8 byte-order mark at the beginning of the text, or 0.
#[inline]
pub(crate) fn byte_order_mark(text: &[u8]) -> usize {
    if text.first() == Some(&0xef) && text.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 }
}

/// Converts bytes to text: as UTF-8, otherwise as Latin-1, in which every byte is a character.
pub(crate) fn shown(text: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(text) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(text.iter().map(|byte| char::from(*byte)).collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_first_line_feed_is_found(text in prop::collection::vec(prop::sample::select(b"\n\x0b\t\x8a \
            a".to_vec()), 0..40), blanks in 0_usize..40) {
            let text = [&vec![b' '; blanks][..], &text].concat();
            prop_assert_eq!(line_feed(&text), text.iter().position(|byte| *byte == b'\n'));
        }

        #[test]
        fn what_is_not_printable_is_seen(text in "[ \
            -~]{0,40}", strange in any::<u8>(), at in any::<prop::sample::Index>()) {
            prop_assert!(is_plain(text.as_bytes()));
            let mut text = text.into_bytes();
            text.insert(at.index(text.len() + 1), strange);
            prop_assert_eq!(is_plain(&text), (b' '..0x7f).contains(&strange));
        }

        #[test]
        fn a_short_number_is_what_its_characters_say(before in "[a-z]{0,9}", text in "[0-9.]{0,9}", behind in "[ \
            -/:-~]?[ -~\u{e9}]{0,9}") {
            let whole = format!("{before}{text}{behind}");
            let at = before.len();
            let run: String = whole[at..].chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect();
            let end = run.match_indices('.').nth(1).map_or(run.len(), |(second, _)| second);
            let number = &run[..end];
            if let Some(short) = short_number(whole.as_bytes(), at) {
                prop_assert_eq!(short.length as usize, number.len());
                let value = f64::from(short.mantissa) / 10_f64.powi(short.decimals as i32);
                prop_assert_eq!(value, number.parse::<f64>().expect("a number"));
            } else {
                prop_assert!(number.len() > 7 || number.is_empty() || number == "." || whole.len() < 8, "{}", whole);
            }
        }
    }
}
