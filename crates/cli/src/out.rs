//! Standard output.
//!
//! Invariant: a reader that has gone away stops neither the command nor the machine.

use std::fmt;
use std::io::Write;

/// Writes one line to standard output. Whoever closed it does not want to know, so an error is passed over.
pub fn line(text: impl fmt::Display) {
    let _ = writeln!(std::io::stdout().lock(), "{}", crate::escape::lines(&text.to_string()));
}

/// Writes one formatted line to standard output.
macro_rules! say {
    ($($text:tt)*) => { $crate::out::line(format_args!($($text)*)) };
}
