//! Number of cases of a random test: a slice in the suite, and all of them in `cargo xtask campaign motion`.
//!
//! Invariant: the tests of this suite take their numbers from here.

/// So many cases, unless the campaign asks for another number.
pub(crate) fn cases(slice: u32) -> u32 {
    std::env::var("RETRACE_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(slice)
}
