//! Errors of the command outside of programs: usage, machine files, operator scripts; with number, cause and remedy.
//!
//! Invariant: every number used here is in `docs/errors.md`.

use std::fmt;

/// An error with its number in `docs/errors.md`. Nothing has moved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NumberedError {
    /// Number, `E2…`.
    pub number: &'static str,
    /// What is wrong, and where.
    pub cause: String,
    /// What to do about it.
    pub remedy: String,
}

impl NumberedError {
    /// Creates an error.
    #[must_use]
    pub fn new(number: &'static str, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { number, cause: what.into(), remedy: remedy.into() }
    }
}

impl fmt::Display for NumberedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "error[{}]: {}\n  help: {}", self.number, self.cause, self.remedy)
    }
}

impl std::error::Error for NumberedError {}

/// The candidate nearest to `word`, if it is near enough to be a typing error.
#[must_use]
pub fn nearest<'c>(word: &str, candidates: impl IntoIterator<Item = &'c str>) -> Option<&'c str> {
    let limit = 1 + word.len() / 4;
    candidates.into_iter().map(|c| (distance(word, c), c)).filter(|(d, _)| *d <= limit).min().map(|(_, c)| c)
}

/// Number of letters to change, insert or remove to get from `a` to `b`.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_slip_and_nothing_far_fetched() {
        let keys = ["max_velocity_mm_per_s", "max_jerk_mm_per_s3", "name"];
        assert_eq!(nearest("max_velocty_mm_per_s", keys), Some("max_velocity_mm_per_s"));
        assert_eq!(nearest("colour", keys), None);
        assert_eq!((distance("abc", "abc"), distance("abc", "acb"), distance("", "ab")), (0, 2, 2));
    }
}
