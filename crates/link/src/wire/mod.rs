//! Messages as bytes: the payloads of frames (`docs/protocol.md` describes each one in text and tables).
//!
//! Invariant: what is written is read back unchanged; any bytes are read as messages or rejected, never with a panic.
//! Each payload is self-contained: nothing in it depends on another one, so that a lost one has no effect on the next.

mod bytes;
mod entry;
mod handshake;
mod message;
mod record;

pub use bytes::{ByteReader, ByteWriter};
pub use entry::ReportEntry;
pub use handshake::{Greeting, Opening};
pub use message::{read_command, write_command};
pub use record::RecordRun;

/// First byte of a payload: its kind.
pub mod kind {
    /// Host: greeting request.
    pub const HELLO: u8 = 0x01;
    /// Host: opens an epoch with these settings.
    pub const OPEN: u8 = 0x02;
    /// Host: commands in their order.
    pub const STREAM: u8 = 0x03;
    /// Host: the current rate, which is also the keep-alive.
    pub const RATE: u8 = 0x04;
    /// Host: the rate, and a request to retransmit entries from the given number on.
    pub const NAK: u8 = 0x06;
    /// Host: ends the epoch.
    pub const CLOSE: u8 = 0x05;
    /// Card: greeting, with identity and position.
    pub const WELCOME: u8 = 0x81;
    /// Card: report of events since the last one, and of the window.
    pub const REPORT: u8 = 0x82;
}
