//! The serial port: a line to a card by cable, USB adapter or pseudo-terminal.
//!
//! It moves bytes and knows no word of the protocol: [`SerialPort`] is the host's `link::Port`, and [`Pty`] the card's side of a
//! pseudo-terminal, behind which a simulated card looks like one on a cable.
//!
//! Invariant: what cannot be opened is refused with a number, the cause and what to do; nothing waits for longer than it was told to.
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
