//! A person at a terminal: the command on a pseudo-terminal of a given size, keys in, cells out.
//!
//! Invariant: it is ended with the test, however that ends; no call waits longer for a text than a minute.

use std::io::{Read, Write};
use std::process::Child;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

use pty_process::Size;
use pty_process::blocking::{Command, Pty};
use tempfile::TempDir;
use vt100::Parser;

use crate::command::binary;

/// Longest time until a text appears.
const TEXT_TIMEOUT: Duration = Duration::from_secs(60);

/// A terminal with the command in it.
pub struct Terminal {
    child: Child,
    pty: Arc<Pty>,
    cells: Arc<Mutex<Parser>>,
    /// Every byte that was written to it.
    written: Arc<Mutex<Vec<u8>>>,
    /// Its state folder, unless the environment sets another one.
    _state: TempDir,
}

impl Terminal {
    /// Runs `retrace` with these arguments on a terminal of `columns` columns and `rows` rows.
    ///
    /// # Panics
    /// Where it cannot be run.
    #[must_use]
    pub fn running(arguments: &[&str], columns: u16, rows: u16) -> Self {
        Self::with(arguments, columns, rows, &[])
    }

    /// Runs `retrace` with these arguments and environment variables.
    ///
    /// # Panics
    /// Where it cannot be run.
    #[must_use]
    pub fn with(arguments: &[&str], columns: u16, rows: u16, environment: &[(&str, &str)]) -> Self {
        // A test runner in the background of a shell ignores Ctrl-C, and hands that down; a terminal does not.
        let command = Command::new("env").arg("--default-signal=INT").arg(binary()).args(arguments);
        Self::spawned(command, columns, rows, environment)
    }

    /// Runs a line of the shell, with job control; `$RETRACE` is the command.
    ///
    /// # Panics
    /// Where it cannot be run.
    #[must_use]
    pub fn shell(line: &str, columns: u16, rows: u16) -> Self {
        let command = Command::new("bash").args(["--norc", "-m", "-c", line]).env("RETRACE", binary());
        Self::spawned(command, columns, rows, &[])
    }

    fn spawned(command: Command, columns: u16, rows: u16, environment: &[(&str, &str)]) -> Self {
        let (pty, pts) = pty_process::blocking::open().expect("a pseudo-terminal");
        pty.resize(Size::new(rows, columns)).expect("a size");
        let command = command.current_dir(crate::command::root());
        let state = TempDir::new().expect("a temporary folder");
        let command = command.env("TERM", "xterm-256color").env_remove("NO_COLOR").env("XDG_STATE_HOME", state.path());
        let command = command.envs(environment.iter().copied());
        let child = command.spawn(pts).expect("the retrace command runs");
        let (pty, cells) = (Arc::new(pty), Arc::new(Mutex::new(Parser::new(rows, columns, 0))));
        let (from, to) = (Arc::clone(&pty), Arc::clone(&cells));
        let written = Arc::new(Mutex::new(Vec::new()));
        let transcript = Arc::clone(&written);
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            let mut pending = Vec::new();
            // The terminal reports that it is closed when the command has ended.
            while let Ok(count @ 1..) = (&*from).read(&mut bytes) {
                pending.extend_from_slice(&bytes[..count]);
                transcript.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(&bytes[..count]);
                let whole = whole_updates(&pending);
                to.lock().unwrap_or_else(PoisonError::into_inner).process(&pending[..whole]);
                pending.drain(..whole);
            }
            to.lock().unwrap_or_else(PoisonError::into_inner).process(&pending);
        });
        Self { child, pty, cells, written, _state: state }
    }

    /// Presses these keys, in the encoding of a terminal.
    ///
    /// # Panics
    /// Where the terminal is closed.
    pub fn keys(&self, keys: &str) {
        (&*self.pty).write_all(keys.as_bytes()).expect("an open terminal");
    }

    /// Changes its size.
    ///
    /// # Panics
    /// Where the terminal is closed.
    pub fn resize(&self, columns: u16, rows: u16) {
        let mut cells = self.cells.lock().unwrap_or_else(PoisonError::into_inner);
        cells.screen_mut().set_size(rows, columns);
        self.pty.resize(Size::new(rows, columns)).expect("an open terminal");
    }

    /// Text on the terminal.
    #[must_use]
    pub fn text(&self) -> String {
        self.cells.lock().unwrap_or_else(PoisonError::into_inner).screen().contents()
    }

    /// Everything that was written to it, with the escape sequences; [`Terminal::text`] is what is left of it.
    #[must_use]
    pub fn transcript(&self) -> String {
        String::from_utf8_lossy(&self.written.lock().unwrap_or_else(PoisonError::into_inner)).into_owned()
    }

    /// Whether the alternate screen is active, which a full-screen command uses.
    #[must_use]
    pub fn is_full_screen(&self) -> bool {
        self.cells.lock().unwrap_or_else(PoisonError::into_inner).screen().alternate_screen()
    }

    /// Whether any cell is coloured.
    #[must_use]
    pub fn is_coloured(&self) -> bool {
        let cells = self.cells.lock().unwrap_or_else(PoisonError::into_inner);
        let (rows, columns) = cells.screen().size();
        let mut all = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
        all.any(|(row, column)| {
            let cell = cells.screen().cell(row, column);
            cell.is_some_and(|cell| cell.fgcolor() != vt100::Color::Default || cell.bgcolor() != vt100::Color::Default)
        })
    }

    /// Waits until these words are on it; returns the whole text.
    ///
    /// # Panics
    /// Where they do not appear.
    pub fn wait_for_text(&self, words: &str) -> String {
        self.wait_until(words, |text| text.contains(words))
    }

    /// Waits until the line of state begins with this word and these words are on it. A position is shown a moment
    /// before its order is done, and the next order is refused until then (E2421).
    ///
    /// # Panics
    /// Where that does not come.
    pub fn wait_for_state(&self, state: &str, words: &str) -> String {
        let state = format!(" {state} ");
        self.wait_until(&format!("{state}· {words}"), |text| text.starts_with(&state) && text.contains(words))
    }

    /// Waits until the text on it satisfies `is_so`.
    ///
    /// # Panics
    /// Where it does not.
    pub fn wait_until(&self, what: &str, is_so: impl Fn(&str) -> bool) -> String {
        let started = Instant::now();
        loop {
            let text = self.text();
            if is_so(&text) {
                return text;
            }
            assert!(started.elapsed() < TEXT_TIMEOUT, "`{what}` did not come:\n{text}");
            sleep(Duration::from_millis(10));
        }
    }

    /// Closes it, as when its window is closed: the command receives a signal.
    ///
    /// # Panics
    /// Where `kill` does not exist.
    pub fn hang_up(&self) {
        let number = self.child.id().to_string();
        let told = std::process::Command::new("kill").args(["-HUP", &number]).status();
        assert!(told.is_ok_and(|status| status.success()));
    }

    /// Waits until the command has ended; returns its exit code.
    ///
    /// # Panics
    /// Where it does not end.
    pub fn wait_for_end(&mut self) -> Option<i32> {
        let started = Instant::now();
        while started.elapsed() < TEXT_TIMEOUT {
            if let Some(status) = self.child.try_wait().expect("a child") {
                return status.code();
            }
            sleep(Duration::from_millis(10));
        }
        panic!("the command did not end:\n{}\n{:?}", self.text(), self.transcript())
    }
}

/// Number of leading bytes that can be shown: all but a synchronized update whose end has not arrived. So a test never
/// sees half a redraw.
fn whole_updates(bytes: &[u8]) -> usize {
    const BEGIN: &[u8] = b"\x1b[?2026h";
    const END: &[u8] = b"\x1b[?2026l";
    let last = |mark: &[u8]| bytes.windows(mark.len()).rposition(|window| window == mark);
    match (last(BEGIN), last(END)) {
        (Some(begin), None) => begin,
        (Some(begin), Some(end)) if begin > end => begin,
        // The beginning itself may have arrived in part.
        _ => (1..BEGIN.len())
            .find(|&count| bytes.ends_with(&BEGIN[..count]))
            .map_or(bytes.len(), |count| bytes.len() - count),
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_redraw_is_not_shown() {
        assert_eq!(whole_updates(b"text"), 4);
        assert_eq!(whole_updates(b"old\x1b[?2026hnew"), 3);
        assert_eq!(whole_updates(b"\x1b[?2026hnew\x1b[?2026l"), 19);
        assert_eq!(whole_updates(b"\x1b[?2026hnew\x1b[?2026l\x1b[?2026hhalf"), 19);
        assert_eq!(whole_updates(b"old\x1b[?20"), 3);
        assert_eq!(whole_updates(b"old\x1b[?25h"), 9);
    }
}
