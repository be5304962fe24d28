//! The user codes that a machine has declared.
//!
//! Invariant: only M100 to M199 can be declared.

/// User codes that a machine has declared, of M100 … M199.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UserCodes(u128);

impl UserCodes {
    /// Adds a code. A number that is not a user code is ignored.
    #[must_use]
    pub const fn with(self, number: u8) -> UserCodes {
        match number {
            100..=199 => UserCodes(self.0 | 1 << (number - 100)),
            _ => self,
        }
    }

    /// Whether a code is declared.
    #[must_use]
    pub const fn has(self, number: u8) -> bool {
        matches!(number, 100..=199) && self.0 & 1 << (number - 100) != 0
    }
}
