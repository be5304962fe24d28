//! Standard output.
//!
//! Invariant: lost output stops neither the command nor the machine, and is reported at the end. A reader that closed
//! the pipe has read enough: that is no loss.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::{Mutex, PoisonError};

use retrace_config::NumberedError;

use crate::files::unwritable;

/// First write error; none where a reader has closed the pipe.
static LOST: Mutex<Option<io::Error>> = Mutex::new(None);

/// Writes one line to standard output. An error is recorded for [`lost`].
pub fn line(text: impl fmt::Display) {
    note(writeln!(io::stdout().lock(), "{}", crate::escape::lines(&text.to_string())));
}

/// Draws lines over those that were drawn on the terminal before. An error is recorded for [`lost`].
pub fn redraw(text: &str) {
    let lines: String = text.lines().map(|line| format!("{}\u{1b}[K\n", crate::escape::name(line))).collect();
    let mut out = io::stdout().lock();
    note(write!(out, "\u{1b}[H{lines}\u{1b}[J").and_then(|()| out.flush()));
}

fn note(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
    {
        LOST.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }
}

/// Error where some of the output so far was lost.
#[must_use]
pub fn lost() -> Option<NumberedError> {
    note(io::stdout().lock().flush());
    let lost = LOST.lock().unwrap_or_else(PoisonError::into_inner);
    lost.as_ref().map(|error| unwritable("standard output", error))
}

/// Writes one formatted line to standard output.
macro_rules! say {
    ($($text:tt)*) => { $crate::out::line(format_args!($($text)*)) };
}
