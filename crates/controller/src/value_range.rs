//! A range of observed values.
//!
//! Invariant: the least value is not above the greatest.

/// Least and greatest of the observed values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueRange {
    /// Least.
    pub least: f64,
    /// Greatest.
    pub greatest: f64,
}

impl ValueRange {
    fn new(value: f64) -> Self {
        Self { least: value, greatest: value }
    }

    /// Extends a range by a value, or begins one.
    pub(crate) fn extend(range: &mut Option<Self>, value: f64) {
        let old = range.unwrap_or(Self::new(value));
        *range = Some(Self { least: old.least.min(value), greatest: old.greatest.max(value) });
    }
}
