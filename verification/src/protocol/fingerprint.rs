//! Fingerprints of states: 128 bits, by which a search knows the states that it has seen.
//!
//! Invariant: equal states have equal fingerprints. Different ones have equal fingerprints by chance only: among a
//! million states with a probability of about 2⁻⁸⁸.

use std::hash::Hasher;

/// Hasher of two lanes, each with its own odd factor, folded after every word.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fingerprint(u64, u64);

impl Fingerprint {
    pub(super) const fn new() -> Self {
        Self(0x9E37_79B9_7F4A_7C15, 0xD1B5_4A32_D192_ED03)
    }

    pub(super) const fn finish_wide(self) -> u128 {
        (Self::fold(self.0, self.1 | 1) as u128) << 64 | Self::fold(self.1, self.0 | 1) as u128
    }

    const fn fold(a: u64, b: u64) -> u64 {
        let product = a as u128 * b as u128;
        product as u64 ^ (product >> 64) as u64
    }

    const fn word(&mut self, word: u64) {
        self.0 = Self::fold(self.0 ^ word, 0xA076_1D64_78BD_642F).wrapping_add(word);
        self.1 = Self::fold(self.1.rotate_left(29) ^ word, 0xE703_7ED1_A0B4_28DB).wrapping_sub(word);
    }
}

impl Hasher for Fingerprint {
    fn write(&mut self, bytes: &[u8]) {
        self.word(bytes.len() as u64);
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.word(u64::from_le_bytes(word));
        }
    }

    fn write_u8(&mut self, value: u8) {
        self.word(u64::from(value));
    }

    fn write_u16(&mut self, value: u16) {
        self.word(u64::from(value));
    }

    fn write_u32(&mut self, value: u32) {
        self.word(u64::from(value));
    }

    fn write_u64(&mut self, value: u64) {
        self.word(value);
    }

    fn finish(&self) -> u64 {
        self.finish_wide() as u64
    }
}
