//! What an error that ends a run on a card says of itself.
//!
//! Invariant: every such error has a number in the table of errors, and a remedy.

/// Error that ends a run on a card.
pub trait CardFailure: core::fmt::Display {
    /// Returns its number in the table of errors.
    fn number(&self) -> &'static str;

    /// Returns the remedy.
    fn remedy(&self) -> &'static str;
}
