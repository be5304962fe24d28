//! Sequence numbers of 16 bits: of commands, rates and entries of reports.
//!
//! Invariant: two numbers that are compared are less than 2¹⁵ apart. The endpoints have at most 128 commands and 16 384
//! entries outstanding, and a rate is confirmed long before 32 767 others are requested.

/// First numbers of an epoch. Both endpoints of a line use the same ones; the protocol begins at 0. Other numbers are
/// for tests and models, so that each crosses the wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct FirstNumbers {
    /// Of the commands.
    pub command: u16,
    /// Of the entries.
    pub entry: u16,
    /// Of the rates: the first one that is sent has the number after it.
    pub rate: u16,
}

impl FirstNumbers {
    /// Returns the numbers of the protocol.
    #[must_use]
    pub const fn protocol() -> Self {
        Self { command: 0, entry: 0, rate: 0 }
    }
}

/// Whether `number` comes after `other`. Of two numbers less than 2¹⁵ apart, at most one comes after the other.
#[must_use]
pub const fn is_after(number: u16, other: u16) -> bool {
    number.wrapping_sub(other) as i16 > 0
}

/// Returns how many items the acknowledgement of everything before `number` covers, of the `count` outstanding ones
/// from number `first` on; `None` if it is stale, or covers items that do not exist.
#[must_use]
pub const fn acknowledged_items(number: u16, first: u16, count: u16) -> Option<u16> {
    let items = number.wrapping_sub(first);
    if items <= count { Some(items) } else { None }
}
