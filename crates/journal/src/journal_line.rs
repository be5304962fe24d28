//! A line of the journal: `crc32c sequence {"…"}` and a line feed.
//!
//! The checksum covers everything behind it except the line feed. An asterisk behind the sequence number marks the
//! beginning of a batch: all lines before it were written, and where the journal is synced they were durable, before
//! this one was written. So a damaged line before the last batch was once whole, and one in the last batch may never
//! have been.
//!
//! Invariant: `parse` accepts only what `append` has written: no other spelling of a number, no additional space.

use retrace_link::crc;

/// Maximum length of a line in bytes: one line contains the machine file and the list of files.
pub const MAX_LINE: usize = 16 << 20;

/// Remainders of the generator polynomial, one per byte value.
const TABLE: [u32; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        table[byte] = crc::update(byte as u32, 0);
        byte += 1;
    }
    table
};

fn crc32c(bytes: &[u8]) -> u32 {
    let register =
        bytes.iter().fold(crc::START, |register, &byte| register >> 8 ^ TABLE[usize::from(register as u8 ^ byte)]);
    crc::finish(register)
}

/// Appends a line to `out`. `json` contains no line feed.
pub fn append(out: &mut Vec<u8>, sequence: u64, begins: bool, json: &[u8]) {
    let start = out.len();
    out.extend_from_slice(b"........ ");
    out.extend_from_slice(sequence.to_string().as_bytes());
    out.extend_from_slice(if begins { b"* " } else { b" " });
    out.extend_from_slice(json);
    let digits = format!("{:08x}", crc32c(&out[start + 9..]));
    out[start..start + 8].copy_from_slice(digits.as_bytes());
    out.push(b'\n');
}

/// A complete line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JournalLine<'l> {
    /// Sequence number, from 0.
    pub sequence: u64,
    /// Whether a batch begins with it.
    pub begins_batch: bool,
    /// Content.
    pub json: &'l [u8],
}

/// Parses the bytes of one line, line feed included. `None` if they are not a valid line.
#[must_use]
pub fn parse(bytes: &[u8]) -> Option<JournalLine<'_>> {
    let line = bytes.strip_suffix(b"\n")?;
    let (digits, rest) = line.split_at_checked(8)?;
    let rest = rest.strip_prefix(b" ")?;
    let sequence_len = rest.iter().position(|b| !b.is_ascii_digit())?;
    let (sequence, json) = rest.split_at(sequence_len);
    if sequence.is_empty() || (sequence.len() > 1 && sequence[0] == b'0') || !digits.iter().all(is_hex) {
        return None;
    }
    let (begins, json) = match json.strip_prefix(b"* ") {
        Some(json) => (true, json),
        None => (false, json.strip_prefix(b" ")?),
    };
    let result = u32::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok()?;
    let sequence = std::str::from_utf8(sequence).ok()?.parse().ok()?;
    (result == crc32c(rest)).then_some(JournalLine { sequence, begins_batch: begins, json })
}

/// The first valid line with which these bytes end. Where a line feed was damaged, a valid line follows the damaged
/// one.
#[must_use]
pub fn parse_end(bytes: &[u8]) -> Option<JournalLine<'_>> {
    let looks = |at: usize| {
        let head = &bytes[at..];
        head.len() > 10 && head[8] == b' ' && head[9].is_ascii_digit() && head[..8].iter().all(is_hex)
    };
    // The bound is for bytes that only resemble many lines.
    (0..bytes.len()).filter(|&at| looks(at)).take(1000).find_map(|at| parse(&bytes[at..]))
}

fn is_hex(byte: &u8) -> bool {
    matches!(byte, b'0'..=b'9' | b'a'..=b'f')
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn line(sequence: u64, begins: bool, json: &str) -> Vec<u8> {
        let mut out = Vec::new();
        append(&mut out, sequence, begins, json.as_bytes());
        out
    }

    #[test]
    fn a_known_line_and_the_check_of_the_link() {
        // The published check value of CRC-32C.
        assert_eq!(crc32c(b"123456789"), 0xE306_9283);
        let bytes = line(7, true, "{}");
        assert_eq!(&bytes[8..], b" 7* {}\n");
        assert_eq!(parse(&bytes), Some(JournalLine { sequence: 7, begins_batch: true, json: b"{}" }));
        assert_eq!(parse(&bytes[..bytes.len() - 1]), None, "without its line feed it is none");
    }

    #[test]
    fn a_line_is_found_behind_one_that_lost_its_line_feed() {
        let mut bytes = line(7, false, "{\"a\":12345678 9}");
        bytes.pop();
        bytes.push(b'x');
        bytes.extend(line(8, true, "{}"));
        assert_eq!(parse(&bytes), None);
        assert_eq!(parse_end(&bytes).map(|l| (l.sequence, l.begins_batch)), Some((8, true)));
        assert_eq!(parse_end(b"\n"), None);
    }

    proptest! {
        #[test]
        fn what_is_put_is_taken_and_no_bit_of_it_can_be_another(
            sequence: u64, begins: bool, json in "[ -~]{0,40}", byte: prop::sample::Index, bit in 0..8_u32,
        ) {
            let mut bytes = line(sequence, begins, &json);
            prop_assert_eq!(parse(&bytes), Some(JournalLine { sequence, begins_batch: begins, json: json.as_bytes() }));
            let at = byte.index(bytes.len());
            bytes[at] ^= 1_u8 << bit;
            prop_assert_eq!(parse(&bytes), None);
        }

        #[test]
        fn bytes_of_any_kind_are_no_line(bytes: Vec<u8>) {
            prop_assert_eq!(parse(&bytes), None);
            prop_assert_eq!(parse_end(&bytes), None);
        }
    }
}
