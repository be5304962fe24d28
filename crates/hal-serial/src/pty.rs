//! A pseudo-terminal, seen from the card's side: a simulated card behind it looks like one on a cable.
//!
//! Invariant: it behaves like a UART. The card cannot detect whether a host is connected; what nobody reads is lost;
//! writing never waits.

use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serialport::{SerialPort as _, TTYPort};

use crate::port::MAX_WHOLE_WRITE;

/// Largest number of bytes that may wait for the host, as far as the system reports: it forwards them in a thread of
/// its own and does not count those that it has yet to forward, some 16 KiB at most.
const MAX_UNREAD: usize = 2048;

/// The card's end of a pseudo-terminal.
#[derive(Debug)]
pub struct Pty {
    card: TTYPort,
    /// The host's end, held open, so that it stays raw and a host that connects or disconnects is not an event.
    host: TTYPort,
    path: PathBuf,
    dropped: u64,
}

impl Pty {
    /// Opens a pseudo-terminal; hosts open [`Pty::path`].
    ///
    /// # Errors
    /// The system has none, or no more of them.
    pub fn open() -> io::Result<Self> {
        let (card, host) = TTYPort::pair()?;
        let path = PathBuf::from(host.name().ok_or(ErrorKind::NotFound)?);
        Ok(Self { card, host, path, dropped: 0 })
    }

    /// The device file that a host opens.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of bytes that were lost because nobody read them.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Reads what the host has written, or waits up to `wait` for it; 0 where nothing arrived.
    ///
    /// # Errors
    /// The system reports a fault.
    pub fn read(&mut self, bytes: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.card.set_timeout(wait)?;
        match self.card.read(bytes) {
            Err(error) if is_nothing(&error) => Ok(0),
            done => done,
        }
    }

    /// Sends bytes to the host. What nobody reads is lost.
    ///
    /// # Errors
    /// The system reports a fault.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let room = MAX_UNREAD.saturating_sub(self.host.bytes_to_read()? as usize).min(bytes.len());
        let mut sent = 0;
        self.card.set_timeout(Duration::ZERO)?;
        while sent < room {
            match self.card.write(&bytes[sent..room.min(sent + MAX_WHOLE_WRITE)]) {
                Ok(count) => sent += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if is_nothing(&error) => break,
                Err(error) => return Err(error),
            }
        }
        self.dropped += (bytes.len() - sent) as u64;
        Ok(())
    }
}

/// Whether the error only means that nothing was ready.
fn is_nothing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    /// Where the system has forwarded everything, so many bytes are buffered and no more.
    #[test]
    fn what_nobody_reads_is_dropped_beyond_what_is_kept() {
        let mut pty = Pty::open().expect("a pseudo-terminal");
        let mut kept = 0;
        for _ in 0..30 {
            pty.write(&[0xAA; 100]).expect("a line");
            kept = (kept + 100).min(MAX_UNREAD);
            let begun = Instant::now();
            while pty.host.bytes_to_read().expect("a line") as usize != kept {
                assert!(begun.elapsed() < Duration::from_secs(20), "{:?} of {kept}", pty.host.bytes_to_read());
            }
        }
        assert_eq!((kept, pty.dropped()), (MAX_UNREAD, 3000 - MAX_UNREAD as u64));
    }
}
