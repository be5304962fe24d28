//! Range of the numbers in a program.
//!
//! Invariant: sums and squares of numbers in the range stay finite.

/// Maximum magnitude of a word and of an offset. Sums and squares of such values stay finite.
pub(crate) const LARGEST: f64 = 1e15;
