//! EIA RS-244, the code of older tapes: eight tracks with odd parity (SHP-33).
//!
//! Invariant: every code except the blank has odd parity, and no code means two characters.

use super::TapeError;

/// Characters and their codes. Letters are those of lower case; the end of block is a line feed.
const TABLE: [(u8, u8); 46] = [
    (b'0', 0x20),
    (b'1', 0x01),
    (b'2', 0x02),
    (b'3', 0x13),
    (b'4', 0x04),
    (b'5', 0x15),
    (b'6', 0x16),
    (b'7', 0x07),
    (b'8', 0x08),
    (b'9', 0x19),
    (b'a', 0x61),
    (b'b', 0x62),
    (b'c', 0x73),
    (b'd', 0x64),
    (b'e', 0x75),
    (b'f', 0x76),
    (b'g', 0x67),
    (b'h', 0x68),
    (b'i', 0x79),
    (b'j', 0x51),
    (b'k', 0x52),
    (b'l', 0x43),
    (b'm', 0x54),
    (b'n', 0x45),
    (b'o', 0x46),
    (b'p', 0x57),
    (b'q', 0x58),
    (b'r', 0x49),
    (b's', 0x32),
    (b't', 0x23),
    (b'u', 0x34),
    (b'v', 0x25),
    (b'w', 0x26),
    (b'x', 0x37),
    (b'y', 0x38),
    (b'z', 0x29),
    (b'.', 0x6B),
    (b'-', 0x40),
    (b'+', 0x70),
    (b'/', 0x31),
    (b',', 0x3B),
    (b' ', 0x10),
    (b'\t', 0x3E),
    (b'%', 0x0B),
    (b'\n', 0x80),
    (0x7F, 0x7F),
];

/// The character of a code; the blank is NUL.
///
/// # Errors
/// The parity is wrong, or there is no such code.
pub(super) fn character(code: u8) -> Result<u8, TapeError> {
    if code == 0 {
        return Ok(0);
    }
    if code.count_ones().is_multiple_of(2) {
        return Err(TapeError::Damaged);
    }
    TABLE.iter().find(|(_, of)| *of == code).map(|(character, _)| *character).ok_or(TapeError::UnknownEiaCode(code))
}

/// The code of a character, of lower case; none where the code does not have it.
pub(super) fn code(character: u8) -> Option<u8> {
    TABLE.iter().find(|(of, _)| *of == character).map(|(_, code)| *code)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_codes_have_odd_parity_and_none_stands_twice() {
        for (at, (letter, code)) in TABLE.iter().enumerate() {
            assert_eq!(code.count_ones() % 2, 1, "{letter}");
            assert!(TABLE[..at].iter().all(|(l, c)| l != letter && c != code), "{letter}");
            assert_eq!(character(*code), Ok(*letter));
        }
        assert_eq!(character(0), Ok(0));
        assert_eq!(character(0x03), Err(TapeError::Damaged));
        assert_eq!(character(0x0E), Err(TapeError::UnknownEiaCode(0x0E)));
    }
}
