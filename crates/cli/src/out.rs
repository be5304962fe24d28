//! Standard output.
//!
//! Invariant: output that is lost stops neither the command nor the machine, and is reported at the end; a reader that has gone away has
//! seen enough, and loses nothing.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::{Mutex, PoisonError};

use retrace_controller::numbered_error::NumberedError;

use crate::console::unwritable;

/// The first error of a write; none where a reader has closed the pipe.
static LOST: Mutex<Option<io::Error>> = Mutex::new(None);

/// Writes one line to standard output. What is lost is noted, for [`lost`].
pub fn line(text: impl fmt::Display) {
    note(writeln!(io::stdout().lock(), "{}", crate::escape::lines(&text.to_string())));
}

fn note(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != ErrorKind::BrokenPipe
    {
        LOST.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }
}

/// That some of what was written to standard output so far is lost.
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
