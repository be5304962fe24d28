//! The unique number of a Pico 2: the first rows of the chip's memory that is written once (RP2350 data sheet, 13.5.2).
//!
//! Invariant: the rows are read corrected, two of 16 bits in a word.

use super::registers::{CHIP_NUMBER, Register};
use retrace_firmware::rp2040::unique_number;

/// Returns the unique number.
pub(super) fn read() -> Option<[u32; 3]> {
    unique_number::of_words(CHIP_NUMBER.map(Register::read))
}
