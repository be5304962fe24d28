//! The N word of a line.
//!
//! Invariant: a number is displayed with the digits that were written.

use std::fmt;

/// The N word of a line, with the number of digits as written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockNumber {
    value: u64,
    digits: u8,
}

impl BlockNumber {
    pub(crate) const fn new(value: u64, digits: u8) -> BlockNumber {
        BlockNumber { value, digits }
    }

    /// Value of the number.
    #[must_use]
    pub const fn value(self) -> u64 {
        self.value
    }

    /// Number of digits as written.
    pub(crate) const fn digits(self) -> u8 {
        self.digits
    }
}

impl fmt::Display for BlockNumber {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{:0width$}", self.value, width = usize::from(self.digits))
    }
}
