//! Serial number of this card, and a number for this start of it.
//!
//! Invariant: two starts have the same number only by chance, with a probability of about one in the number of cycles
//! by which the host's first byte may arrive earlier or later.

/// Returns the serial number mixed from the words of a microcontroller's unique number; it is never 0.
#[must_use]
pub fn serial_number(unique: [u32; 3]) -> u32 {
    unique.iter().fold(0, |mixed, &word| mix(mixed ^ word)).max(1)
}

/// Returns the number of this start: from the count of starts, if that count survived the last one, and from the
/// clock's count at the host's first byte, whose arrival time is arbitrary.
#[must_use]
pub fn boot_number(starts: u32, first_byte_at: u32) -> u32 {
    mix(mix(starts) ^ first_byte_at)
}

/// A bijection that spreads small differences over all bits: the 32-bit finalizer of MurmurHash3 (Appleby, 2011; public
/// domain).
const fn mix(word: u32) -> u32 {
    let word = (word ^ word >> 16).wrapping_mul(0x85eb_ca6b);
    let word = (word ^ word >> 13).wrapping_mul(0xc2b2_ae35);
    word ^ word >> 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_a_cycle_apart_differ() {
        let mut numbers: Vec<u32> =
            (0..50).flat_map(|starts| (0..1000).map(move |at| boot_number(starts, 80_000 + at))).collect();
        numbers.sort_unstable();
        numbers.dedup();
        // 50 000 of 2³² at random: 0.3 pairs expected
        assert!(numbers.len() >= 49_990, "{}", numbers.len());
        assert_ne!(serial_number([1, 2, 3]), serial_number([3, 2, 1]));
        assert_ne!(serial_number([0; 3]), 0);
    }
}
