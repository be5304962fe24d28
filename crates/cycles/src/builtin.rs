//! The sources of the cycles that are shipped with retrace.
//!
//! Invariant: all of them compile without a warning, which a test checks.

/// Names and sources, sorted by name.
pub(crate) const SOURCES: &[(&str, &str)] = &[
    ("CYCLE81", include_str!("../cycles/CYCLE81.SPF")),
    ("CYCLE82", include_str!("../cycles/CYCLE82.SPF")),
    ("CYCLE83", include_str!("../cycles/CYCLE83.SPF")),
    ("CYCLE84", include_str!("../cycles/CYCLE84.SPF")),
    ("CYCLE85", include_str!("../cycles/CYCLE85.SPF")),
    ("CYCLE86", include_str!("../cycles/CYCLE86.SPF")),
    ("CYCLE87", include_str!("../cycles/CYCLE87.SPF")),
    ("CYCLE88", include_str!("../cycles/CYCLE88.SPF")),
    ("CYCLE89", include_str!("../cycles/CYCLE89.SPF")),
    ("CYCLE95", include_str!("../cycles/CYCLE95.SPF")),
    ("HOLES1", include_str!("../cycles/HOLES1.SPF")),
    ("HOLES2", include_str!("../cycles/HOLES2.SPF")),
];

/// Returns the source of a shipped cycle, by its name in either case.
#[must_use]
pub fn shipped_source(name: &str) -> Option<&'static str> {
    SOURCES.iter().find(|(known, _)| known.eq_ignore_ascii_case(name)).map(|(_, source)| *source)
}
