//! The unique number of a board, from what its flash or its chip has.
//!
//! Invariant: memory that was never written, or a flash that does not know the command, is no number.

/// Makers of flash whose unique number is of 16 bytes that differ in the last ones only: Zetta.
const MAKERS_OF_LONG_NUMBERS: [u8; 1] = [0xba];

/// Returns the unique number of a flash of this maker (JEDEC) from the bytes behind the command; `None` if it has none.
#[must_use]
pub fn of_flash(maker: u8, bytes: &[u8; 16]) -> Option<[u32; 3]> {
    let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
    let first = of_words([word(0), word(4)])?;
    if MAKERS_OF_LONG_NUMBERS.contains(&maker) {
        Some([first[0] ^ word(8), first[1] ^ word(12), 0])
    } else {
        Some(first)
    }
}

/// Returns the unique number in these words, if they are one.
#[must_use]
pub const fn of_words(words: [u32; 2]) -> Option<[u32; 3]> {
    match words {
        [0, 0] | [u32::MAX, u32::MAX] => None,
        [low, high] => Some([low, high, 0]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boards_have_different_numbers_and_an_empty_memory_has_none() {
        let [winbond, zetta] = [0xef, 0xba];
        let mut bytes: [u8; 16] = core::array::from_fn(|n| n as u8 + 1);
        let [first, long] = [winbond, zetta].map(|maker| of_flash(maker, &bytes).expect("a number"));
        assert_eq!(first, [0x0403_0201, 0x0807_0605, 0]);
        bytes[15] = 0;
        assert_eq!(of_flash(winbond, &bytes), Some(first), "bytes behind its number are none of it");
        assert_ne!(of_flash(zetta, &bytes), Some(long));
        assert_eq!([[0; 16], [0xff; 16]].map(|bytes| of_flash(winbond, &bytes)), [None; 2]);
    }
}
