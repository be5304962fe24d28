//! The serial port: a link to a card by cable, USB adapter or pseudo-terminal.
//!
//! ```text
//!  link::host ── SerialPort ── /dev/ttyUSB0 ═══ UART ── card
//!  link::host ── SerialPort ── /dev/pts/3 ═════ Pty ─── simulated card
//! ```
//!
//! It transfers bytes and does not interpret the protocol. [`SerialPort`] implements the host's `link::Port`. [`Pty`]
//! is the card's side of a pseudo-terminal, which makes a simulated card look like one on a cable. [`ProgramPort`]
//! receives NC programs.
//!
//! Invariant: a port that cannot be opened is refused with a number, the cause and a remedy; no call waits for longer
//! than its timeout.
#![forbid(unsafe_code)]

mod address;
mod enumerate;
mod latency_timer;
mod port;
mod port_error;
mod program_port;
#[cfg(unix)]
mod pty;
mod write_pacing;

pub use address::{Address, BAUD};
pub use enumerate::{FoundPort, UsbDevice, ports};
pub use latency_timer::LatencyTimer;
pub use port::{PortLost, SerialPort};
pub use port_error::PortError;
pub use program_port::{Character, CharacterFormat, ParityBit, ProgramPort};
#[cfg(unix)]
pub use pty::Pty;
