//! A serial port that receives or sends a program: any character format, the modem lines, and damage distinguished
//! from data.
//!
//! Seven bits with a parity bit are received as eight bits without one. On the line these are identical, and the
//! decoder can detect which character was damaged, also on a pseudo-terminal.
//!
//! Invariant: no character with wrong parity or framing is returned as data; no call waits for longer than its timeout.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::port::{PortLost, open_with};
use crate::{Address, PortError};

/// Parity of the port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParityBit {
    /// The number of ones is even.
    Even,
    /// The number of ones is odd.
    Odd,
    /// No parity bit.
    None,
}

/// The format of the characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CharacterFormat {
    /// Bits per second.
    pub baud: u32,
    /// Data bits, 7 or 8.
    pub bits: u8,
    /// Parity.
    pub parity: ParityBit,
    /// Stop bits, 1 or 2.
    pub stop: u8,
}

/// A character that was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Character {
    /// Its eight bits: of seven with parity, the parity bit is the eighth.
    Byte(u8),
    /// Its parity or framing was wrong.
    Damaged,
}

/// Characters that may wait in the system while a program is sent: the other end is obeyed behind at most so many.
const MAX_AHEAD: u64 = 2;

impl CharacterFormat {
    /// Time that the line takes for a character, with its start bit, in nanoseconds.
    #[must_use]
    pub fn character_ns(&self) -> u64 {
        let parity = u64::from(self.parity != ParityBit::None);
        let bits = 1 + u64::from(self.bits) + parity + u64::from(self.stop);
        bits * 1_000_000_000 / u64::from(self.baud.max(1))
    }
}

/// A port that receives or sends a program, opened exclusively.
pub struct ProgramPort {
    path: PathBuf,
    /// Time that the line takes for a character.
    character_ns: u64,
    opened: Instant,
    /// When the line will have sent everything that was written, since it was opened.
    free_at_ns: u64,
    port: Box<dyn serialport::SerialPort>,
    marks: Option<Marks>,
    is_pty: bool,
}

impl std::fmt::Debug for ProgramPort {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ProgramPort({})", self.path.display())
    }
}

impl ProgramPort {
    /// Opens a port and discards the bytes that were received before.
    ///
    /// # Errors
    /// `E2141` absent, `E2144` busy, `E2145` forbidden, `E2146` not a serial port, or not with this format.
    pub fn open(path: &Path, format: CharacterFormat) -> Result<Self, PortError> {
        use serialport::{DataBits, Parity, StopBits};
        let is_pty = path.canonicalize().is_ok_and(|path| path.starts_with("/dev/pts"));
        let (data_bits, parity) = match (format.bits, format.parity) {
            (7, ParityBit::None) => (DataBits::Seven, Parity::None),
            (8, ParityBit::Even) => (DataBits::Eight, Parity::Even),
            (8, ParityBit::Odd) => (DataBits::Eight, Parity::Odd),
            _ => (DataBits::Eight, Parity::None),
        };
        // A pseudo-terminal carries eight bits, whatever its settings.
        let (data_bits, parity) = if is_pty { (DataBits::Eight, Parity::None) } else { (data_bits, parity) };
        let stop_bits = if format.stop == 2 { StopBits::Two } else { StopBits::One };
        let address = Address { path: path.to_owned(), baud: format.baud };
        // Opened before the port is exclusive.
        let marking = if is_pty { None } else { Marking::of(path) };
        let set =
            |builder: serialport::SerialPortBuilder| builder.data_bits(data_bits).parity(parity).stop_bits(stop_bits);
        let port = open_with(&address, path, set)?;
        let marks = marking.map(|marking| marking.switch_on().map(|()| Marks::default())).transpose();
        let marks = marks.map_err(|error| address.unfit(&format!("damage cannot be marked: {error}")))?;
        let (character_ns, opened) = (format.character_ns(), Instant::now());
        Ok(Self { path: path.to_owned(), character_ns, opened, free_at_ns: 0, port, marks, is_pty })
    }

    fn lost(&self, why: impl ToString) -> PortLost {
        PortLost { port: self.path.display().to_string(), why: why.to_string() }
    }

    /// Appends the received characters to `characters`, after a wait of at most `wait` for the first; at most some
    /// hundred per call.
    ///
    /// # Errors
    /// The line is gone.
    pub fn read(&mut self, characters: &mut Vec<Character>, wait: Duration) -> Result<(), PortLost> {
        let mut bytes = [0; 256];
        self.port.set_timeout(wait).map_err(|error| self.lost(error))?;
        let count = match self.port.read(&mut bytes) {
            Ok(0) => return Err(self.lost("the other end was closed")),
            Ok(count) => count,
            Err(error) if is_nothing(&error) => return Ok(()),
            Err(error) => return Err(self.lost(error)),
        };
        match &mut self.marks {
            Some(marks) => bytes[..count].iter().for_each(|&byte| characters.extend(marks.take(byte))),
            None => characters.extend(bytes[..count].iter().map(|&byte| Character::Byte(byte))),
        }
        Ok(())
    }

    /// Sends a control character without waiting for the line; returns false where the output buffer is full.
    ///
    /// # Errors
    /// The line is gone.
    pub fn send(&mut self, byte: u8) -> Result<bool, PortLost> {
        self.port.set_timeout(Duration::ZERO).map_err(|error| self.lost(error))?;
        match self.port.write(&[byte]) {
            Ok(count) => Ok(count == 1),
            Err(error) if is_nothing(&error) => Ok(false),
            Err(error) => Err(self.lost(error)),
        }
    }

    /// Sends a character of a program, unless two are on their way: neither the driver's queue nor what the line can
    /// have sent by now, of which an adapter tells nothing, holds more. Returns whether it was sent.
    ///
    /// # Errors
    /// The line is gone.
    pub fn send_paced(&mut self, byte: u8) -> Result<bool, PortLost> {
        let now = self.opened.elapsed().as_nanos() as u64;
        let counted = self.free_at_ns.saturating_sub(now).div_ceil(self.character_ns.max(1));
        // a pseudo-terminal counts what its other end has not read
        let queued = if self.is_pty { 0 } else { self.port.bytes_to_write().unwrap_or(0) };
        if counted.max(u64::from(queued)) >= MAX_AHEAD || !self.send(byte)? {
            return Ok(false);
        }
        self.free_at_ns = self.free_at_ns.max(now) + self.character_ns;
        Ok(true)
    }

    /// Time that the line takes for a character.
    #[must_use]
    pub fn character_time(&self) -> Duration {
        Duration::from_nanos(self.character_ns)
    }

    /// Switches RTS, which permits the other end to send. A pseudo-terminal has no such line.
    ///
    /// # Errors
    /// The line is gone, or has no RTS.
    pub fn set_request_to_send(&mut self, level: bool) -> Result<(), PortLost> {
        match self.port.write_request_to_send(level) {
            Err(error) if !self.is_pty => Err(self.lost(error)),
            _ => Ok(()),
        }
    }

    /// Whether CTS allows this end to send. A pseudo-terminal has no such line, and always allows it.
    #[must_use]
    pub fn is_clear_to_send(&mut self) -> bool {
        self.is_pty || self.port.read_clear_to_send().unwrap_or(true)
    }
}

fn is_nothing(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// The system's marks of damage: a wrong character arrives as FF 00 and itself, the character FF as FF FF.
#[derive(Clone, Copy, Debug, Default)]
enum Marks {
    #[default]
    Data,
    Escaped,
    Damaged,
}

impl Marks {
    fn take(&mut self, byte: u8) -> Option<Character> {
        let (next, character) = match (*self, byte) {
            (Self::Data, 0xFF) => (Self::Escaped, None),
            (Self::Escaped, 0) => (Self::Damaged, None),
            (Self::Data | Self::Escaped, byte) => (Self::Data, Some(Character::Byte(byte))),
            (Self::Damaged, _) => (Self::Data, Some(Character::Damaged)),
        };
        *self = next;
        character
    }
}

/// Makes the system mark damaged characters, which it would otherwise drop.
#[cfg(unix)]
struct Marking(std::os::fd::OwnedFd);

#[cfg(unix)]
impl Marking {
    fn of(path: &Path) -> Option<Self> {
        use rustix::fs::{Mode, OFlags};
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        rustix::fs::open(path, flags, Mode::empty()).ok().map(Self)
    }

    fn switch_on(self) -> io::Result<()> {
        use rustix::termios::{InputModes, OptionalActions, tcgetattr, tcsetattr};
        let mut settings = tcgetattr(&self.0)?;
        settings.input_modes.remove(InputModes::IGNPAR | InputModes::IGNBRK | InputModes::ISTRIP);
        settings.input_modes.insert(InputModes::INPCK | InputModes::PARMRK);
        Ok(tcsetattr(&self.0, OptionalActions::Now, &settings)?)
    }
}

/// Elsewhere only the port's own parity check exists.
#[cfg(not(unix))]
struct Marking;

#[cfg(not(unix))]
impl Marking {
    fn of(_: &Path) -> Option<Self> {
        None
    }

    fn switch_on(self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marked_characters_are_told_apart_from_data() {
        let mut marks = Marks::default();
        let received: Vec<Character> = [0x41, 0xFF, 0xFF, 0xFF, 0, 0x42, 0, 0xFF, 0, 0xFF, 0x43]
            .into_iter()
            .filter_map(|byte| marks.take(byte))
            .collect();
        use Character::{Byte, Damaged};
        assert_eq!(received, [Byte(0x41), Byte(0xFF), Damaged, Byte(0), Damaged, Byte(0x43)]);
    }

    /// Whatever a pseudo-terminal takes at once, no more is written than the line sends in the time, and two.
    #[test]
    #[cfg(unix)]
    fn a_program_is_sent_no_faster_than_its_line() {
        let pty = crate::Pty::open().expect("a pseudo-terminal");
        let format = CharacterFormat { baud: 1200, bits: 7, parity: ParityBit::Even, stop: 2 };
        assert_eq!(format.character_ns(), 9_166_666);
        let mut port = ProgramPort::open(pty.path(), format).expect("a port");
        let (began, mut sent) = (Instant::now(), 0_u64);
        while began.elapsed() < Duration::from_millis(200) {
            sent += u64::from(port.send_paced(b'x').expect("a line"));
            let could = began.elapsed().as_nanos() as u64 / format.character_ns();
            assert!(sent <= could + 2, "{sent} of {could}");
        }
        assert!(sent >= 2, "{sent}");
    }
}
