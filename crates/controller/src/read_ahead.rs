//! Reading ahead: a thread reads the bytes of a streamed program.
//!
//! Invariant: the decoder waits for bytes only while there are none, and not after the program is cancelled. The memory
//! is bounded, however long the program is.

use std::io::{self, BufRead, Read};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, SystemTime};

/// Size of a buffer in bytes.
const BYTES: usize = 1 << 16;
/// Number of buffers that circulate.
const BUFFERS: usize = 4;
/// Interval at which a waiting reader checks whether the program is cancelled.
const LOOKS_EVERY: Duration = Duration::from_millis(20);

/// Whether the decoder of a streamed program waits for its sender, and since when.
#[derive(Debug)]
pub struct SourceStatus {
    name: String,
    waiting_since: Mutex<Option<SystemTime>>,
}

impl SourceStatus {
    /// Creates the status of a source of this name, with no wait.
    #[must_use]
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), waiting_since: Mutex::default() }
    }

    /// Name of the source.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Time since which the decoder waits for the source. None where it does not wait.
    #[must_use]
    pub fn waiting_since(&self) -> Option<SystemTime> {
        *self.waiting_since.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records that the decoder waits. A wait in progress continues.
    pub fn begin_wait(&self) {
        self.waiting_since.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(SystemTime::now);
    }

    /// Records that the decoder does not wait any more.
    pub fn end_wait(&self) {
        *self.waiting_since.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// A reader whose input is read by another thread.
#[derive(Debug)]
pub struct ReadAhead {
    full: Receiver<io::Result<Vec<u8>>>,
    empty: SyncSender<Vec<u8>>,
    held: Vec<u8>,
    at: usize,
    ended: bool,
    given_up: Arc<AtomicBool>,
    status: Option<Arc<SourceStatus>>,
}

impl ReadAhead {
    /// Creates a reader that reads ahead of `input`. It reports the end of input when `given_up` is set: a source that
    /// stalls blocks only its own thread.
    ///
    /// # Errors
    /// The system cannot create a thread.
    pub fn of(input: impl Read + Send + 'static, given_up: Arc<AtomicBool>) -> io::Result<Self> {
        let (sends_full, full) = sync_channel(BUFFERS);
        let (empty, takes_empty) = sync_channel(BUFFERS);
        for _ in 1..BUFFERS {
            // There is space for them all.
            let _ = empty.try_send(Vec::with_capacity(BYTES));
        }
        thread::Builder::new().name("reading".into()).spawn(move || read(input, &takes_empty, &sends_full))?;
        Ok(Self { full, empty, held: Vec::with_capacity(BYTES), at: 0, ended: false, given_up, status: None })
    }

    /// Shows in `status` whether the source is waited for.
    #[must_use]
    pub fn showing(self, status: Arc<SourceStatus>) -> Self {
        Self { status: Some(status), ..self }
    }

    /// Exchanges the used buffer for one with more bytes; none at the end.
    fn next(&mut self) -> io::Result<()> {
        let buffer = loop {
            match self.full.recv_timeout(LOOKS_EVERY) {
                Ok(buffer) => break buffer?,
                Err(RecvTimeoutError::Timeout) if !self.given_up.load(Ordering::Relaxed) => {
                    self.status.iter().for_each(|status| status.begin_wait());
                }
                Err(_) => break Vec::new(),
            }
        };
        self.status.iter().for_each(|status| status.end_wait());
        self.ended = buffer.is_empty();
        self.at = 0;
        let read = std::mem::replace(&mut self.held, buffer);
        // The thread that would fill it may be gone.
        let _ = self.empty.try_send(read);
        Ok(())
    }
}

/// The reading thread: reads until the end of the input, an error, or cancellation.
fn read(mut input: impl Read, empty: &Receiver<Vec<u8>>, full: &SyncSender<io::Result<Vec<u8>>>) {
    while let Ok(mut buffer) = empty.recv() {
        buffer.resize(BYTES, 0);
        let taken = loop {
            match input.read(&mut buffer) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                taken => break taken,
            }
        };
        let is_last = !matches!(taken, Ok(1..));
        let filled = taken.map(|count| {
            buffer.truncate(count);
            buffer
        });
        if full.send(filled).is_err() || is_last {
            return;
        }
    }
}

impl BufRead for ReadAhead {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.at == self.held.len() && !self.ended {
            self.next()?;
        }
        Ok(&self.held[self.at..])
    }

    fn consume(&mut self, amount: usize) {
        self.at = (self.at + amount).min(self.held.len());
    }
}

impl Read for ReadAhead {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(into)?;
        self.consume(count);
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_comes_in_its_order() {
        let bytes: Vec<u8> = (0..1_000_003u32).map(|n| (n * 7 % 251) as u8).collect();
        let mut ahead = ReadAhead::of(io::Cursor::new(bytes.clone()), Arc::default()).expect("a thread");
        let mut read = Vec::new();
        ahead.read_to_end(&mut read).expect("no error");
        assert!(read == bytes);
        assert_eq!(ahead.read(&mut [0; 4]).expect("the end"), 0);
    }

    #[test]
    fn a_source_that_stalls_for_ever_ends_when_it_is_given_up() {
        struct Stalls(bool);
        impl Read for Stalls {
            fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
                if std::mem::replace(&mut self.0, true) {
                    loop {
                        thread::park();
                    }
                }
                into[0] = b'x';
                Ok(1)
            }
        }
        let given_up = Arc::new(AtomicBool::new(false));
        let mut ahead = ReadAhead::of(Stalls(false), Arc::clone(&given_up)).expect("a thread");
        let mut read = [0; 8];
        assert_eq!(ahead.read(&mut read).expect("a byte"), 1);
        given_up.store(true, Ordering::Relaxed);
        assert_eq!(ahead.read(&mut read).expect("the end"), 0);
    }

    #[test]
    fn an_error_comes_where_it_happened() {
        struct Breaks(u8);
        impl Read for Breaks {
            fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
                self.0 += 1;
                if self.0 < 3 {
                    into[0] = self.0;
                    return Ok(1);
                }
                Err(io::ErrorKind::ConnectionReset.into())
            }
        }
        let mut ahead = ReadAhead::of(Breaks(0), Arc::default()).expect("a thread");
        let mut read = Vec::new();
        let error = ahead.read_to_end(&mut read).expect_err("it breaks");
        assert_eq!((read, error.kind()), (vec![1, 2], io::ErrorKind::ConnectionReset));
    }
}
