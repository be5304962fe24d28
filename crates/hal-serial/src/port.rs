//! The host's serial port.
//!
//! Invariant: no call waits for longer than its timeout, and at most about 4 ms of bytes wait in the operating system.

use std::fmt;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::{Duration, Instant};

use retrace_link::{BytePort, CardFailure};

use crate::enumerate::{find_device, ports, usb_of};
use crate::latency_timer::{LatencyTimer, set_low_latency};
use crate::port_error::{group_of, holder_of};
use crate::{Address, PortError, UsbDevice, write_pacing::WritePacing};

/// Largest number of unread bytes on a pseudo-terminal. Linux buffers about 18 KiB for the other end and then blocks
/// the writer; so bytes that nobody reads are dropped before, as on a cable where nobody listens.
const MAX_UNREAD: usize = 8 * 1024;

/// Largest number of bytes of one write to a pseudo-terminal. Linux accepts this many as a whole where it reports that
/// it accepts any; of more it may accept a part and block with the rest.
pub(crate) const MAX_WHOLE_WRITE: usize = 512;

/// Interval of the attempts to find a port that was lost.
const RETRY_INTERVAL: Duration = Duration::from_millis(50);

/// The serial line is gone: unplugged, or its other end closed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortLost {
    /// Path of the port.
    pub port: String,
    /// Cause as the operating system reports it.
    pub why: String,
}

impl fmt::Display for PortLost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the line to {} is lost ({})", self.port, self.why)
    }
}

impl CardFailure for PortLost {
    fn number(&self) -> &'static str {
        "E3009"
    }

    fn remedy(&self) -> &'static str {
        "check cable and power; the card stops by itself, on the path, and reports its position when it is connected \
            again"
    }
}

impl std::error::Error for PortLost {}

/// A serial port or pseudo-terminal, opened exclusively, with eight data bits, no parity, no flow control.
pub struct SerialPort {
    address: Address,
    /// `None` while the line is lost: a port that is held open would keep its device number from being used again.
    port: Option<Box<dyn serialport::SerialPort>>,
    usb: Option<UsbDevice>,
    is_pty: bool,
    /// Time at which the pseudo-terminal of this path was made; `None` for another device, and for a link.
    pty_made: Option<PtyTime>,
    latency: LatencyTimer,
    started: Instant,
    budget: WritePacing,
    unanswered: usize,
}

impl fmt::Debug for SerialPort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SerialPort({}, {})", self.address, if self.port.is_some() { "open" } else { "lost" })
    }
}

impl SerialPort {
    /// Opens a port, and discards the bytes that were received before.
    ///
    /// # Errors
    /// `E2141` absent, `E2144` busy, `E2145` forbidden, `E2146` not a serial port, or not at this baud rate.
    pub fn open(address: &Address) -> Result<Self, PortError> {
        let port = open(address, &address.path)?;
        Ok(Self {
            usb: usb_of(&address.path),
            is_pty: address.path.canonicalize().is_ok_and(|path| path.starts_with("/dev/pts")),
            pty_made: pty_made(&address.path),
            latency: set_low_latency(&address.path),
            address: address.clone(),
            port: Some(port),
            started: Instant::now(),
            budget: WritePacing::new(address.byte_ns()),
            unanswered: 0,
        })
    }

    /// Address under which it was opened.
    #[must_use]
    pub const fn address(&self) -> &Address {
        &self.address
    }

    /// USB device behind it, if there is one.
    #[must_use]
    pub const fn usb(&self) -> Option<&UsbDevice> {
        self.usb.as_ref()
    }

    /// Delay of received bytes in the adapter.
    #[must_use]
    pub const fn latency(&self) -> &LatencyTimer {
        &self.latency
    }

    /// Whether the line is connected, as of the last call.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.port.is_some()
    }

    /// Opens the port again after it was lost, in one attempt: under the same path, or, where the adapter has a serial
    /// number, under its current path. The number of a pseudo-terminal is given away again when it is gone: another one
    /// is not opened. The clock continues. The card behind it may be another one, so its position has to be queried
    /// again.
    ///
    /// # Errors
    /// As [`SerialPort::open`].
    pub fn reopen(&mut self) -> Result<(), PortError> {
        self.port = None;
        if self.pty_made.is_some() && pty_made(&self.address.path) != self.pty_made {
            return Err(PortError::absent(&self.address.path, &[]));
        }
        let path = match &self.usb {
            None => self.address.path.clone(),
            Some(usb) => {
                let there = ports();
                let names = || there.iter().map(|port| port.path.clone()).collect::<Vec<_>>();
                let found = find_device(usb, &self.address.path, &there);
                found.ok_or_else(|| PortError::absent(&self.address.path, &names()))?.into()
            }
        };
        self.port = Some(open(&self.address, &path)?);
        self.latency = set_low_latency(&path);
        // a link, as in /dev/serial/by-id, is retained; a number that has changed is followed
        if !path.canonicalize().is_ok_and(|new| self.address.path.canonicalize().is_ok_and(|old| old == new)) {
            self.address.path = path;
        }
        self.budget = WritePacing::new(self.address.byte_ns());
        self.unanswered = 0;
        Ok(())
    }

    /// Tries to open the port again for up to `time`.
    ///
    /// # Errors
    /// `E2147`: it did not reappear, with the last cause.
    pub fn reopen_within(&mut self, time: Duration) -> Result<(), PortError> {
        let until = Instant::now() + time;
        loop {
            match self.reopen() {
                Ok(()) => return Ok(()),
                Err(why) if Instant::now() + RETRY_INTERVAL > until => {
                    return Err(self.address.gone(time.as_secs_f64(), &why));
                }
                Err(_) => std::thread::sleep(RETRY_INTERVAL),
            }
        }
    }

    fn now_ns(&self) -> u64 {
        u64::try_from(self.started.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    /// Calls `action` with the port; returns 0 where the port was not ready in time. An error closes it.
    fn with(
        &mut self,
        wait: Duration,
        act: impl FnOnce(&mut dyn serialport::SerialPort) -> io::Result<usize>,
    ) -> Result<usize, PortLost> {
        let lost = |why: String| PortLost { port: self.address.path.display().to_string(), why };
        let Some(port) = self.port.as_deref_mut() else { return Err(lost("it is closed".to_owned())) };
        let done = port.set_timeout(wait).map_err(io::Error::from).and_then(|()| act(port));
        match done {
            Ok(count) => Ok(count),
            Err(error)
                if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted) =>
            {
                Ok(0)
            }
            Err(error) => {
                self.port = None;
                Err(lost(error.to_string()))
            }
        }
    }
}

impl BytePort for SerialPort {
    type Fault = PortLost;

    fn now_us(&self) -> u64 {
        self.now_ns() / 1000
    }

    fn writable_bytes(&mut self) -> usize {
        let Some(port) = &self.port else { return 0 };
        if self.is_pty && self.unanswered >= MAX_UNREAD {
            // On a pseudo-terminal this discards what the other end has not read.
            let _ = port.clear(serialport::ClearBuffer::Output);
            self.unanswered = 0;
        }
        let queued = port.bytes_to_write().unwrap_or(0);
        self.budget.writable_bytes(self.now_ns(), u64::from(queued))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, PortLost> {
        let room = self.writable_bytes().min(bytes.len());
        if room == 0 && self.port.is_some() {
            return Ok(0);
        }
        let room = if self.is_pty { room.min(MAX_WHOLE_WRITE) } else { room };
        let count = self.with(Duration::ZERO, |port| port.write(&bytes[..room]))?;
        self.budget.spend(self.now_ns(), count);
        self.unanswered += count;
        Ok(count)
    }

    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, PortLost> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let count = self.with(Duration::from_micros(u64::from(wait_us)), |port| match port.read(bytes) {
            // a port that is ready and has nothing to read is gone
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            done => done,
        })?;
        if count > 0 {
            self.unanswered = 0;
        }
        Ok(count)
    }

    fn revive(&mut self) -> bool {
        std::thread::sleep(RETRY_INTERVAL);
        self.reopen().is_ok()
    }
}

/// Seconds and nanoseconds at which a device file was made.
type PtyTime = (i64, i64);

/// When the pseudo-terminal of this path was made, unless the path is a link, which is to lead to another one later.
#[cfg(unix)]
fn pty_made(path: &std::path::Path) -> Option<PtyTime> {
    use std::os::unix::fs::MetadataExt;
    let file = path.starts_with("/dev/pts").then(|| std::fs::symlink_metadata(path).ok())??;
    Some((file.ctime(), file.ctime_nsec()))
}

/// Elsewhere there are none.
#[cfg(not(unix))]
fn pty_made(_: &std::path::Path) -> Option<PtyTime> {
    None
}

/// Opens the device file and discards the bytes that were received before.
fn open(address: &Address, path: &Path) -> Result<Box<dyn serialport::SerialPort>, PortError> {
    // A card that a DTR pulse resets would lose its position: DTR stays as the system has it.
    open_with(address, path, serialport::SerialPortBuilder::preserve_dtr_on_open)
}

/// Opens the device file with more settings, and discards the bytes that were received before.
pub(crate) fn open_with(
    address: &Address,
    path: &Path,
    set: impl FnOnce(serialport::SerialPortBuilder) -> serialport::SerialPortBuilder,
) -> Result<Box<dyn serialport::SerialPort>, PortError> {
    check_device(address, path)?;
    let builder = set(serialport::new(path.to_string_lossy(), address.baud).timeout(Duration::ZERO));
    let port = builder.open().map_err(|error| match error.kind() {
        // the library's error for a port that is locked
        serialport::ErrorKind::NoDevice if path.exists() => PortError::busy(path, holder_of(path)),
        serialport::ErrorKind::NoDevice | serialport::ErrorKind::Io(ErrorKind::NotFound) => absent(path),
        serialport::ErrorKind::Io(ErrorKind::PermissionDenied) => PortError::forbidden(path, group_of(path).as_deref()),
        _ => address.unfit(&error.description),
    })?;
    let _ = port.clear(serialport::ClearBuffer::Input);
    Ok(port)
}

fn absent(path: &Path) -> PortError {
    PortError::absent(path, &ports().into_iter().map(|port| port.path).collect::<Vec<_>>())
}

/// Whether a device file exists. The error of the library is less precise.
#[cfg(unix)]
fn check_device(address: &Address, path: &Path) -> Result<(), PortError> {
    use std::os::unix::fs::FileTypeExt;
    match std::fs::metadata(path) {
        Ok(file) if file.file_type().is_char_device() => Ok(()),
        Ok(_) => Err(address.unfit("it is not a device")),
        Err(error) if error.kind() == ErrorKind::PermissionDenied => {
            Err(PortError::forbidden(path, group_of(path).as_deref()))
        }
        Err(_) => Err(absent(path)),
    }
}

/// A port has a name here, and no file.
#[cfg(not(unix))]
fn look_at(_: &Address, _: &Path) -> Result<(), PortError> {
    Ok(())
}
