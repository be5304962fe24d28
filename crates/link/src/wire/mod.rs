//! Messages as bytes: what stands in the payload of a frame (`docs/protocol.md` tells each one in words and tables).
//!
//! Invariant: what is written is read back as it was; any bytes are read as messages or refused, never a panic. Each payload stands for
//! itself: nothing in it depends on another one, so that a lost one leaves no trace in the next.

mod bytes;
mod entry;
mod handshake;
mod message;
mod record;

pub use bytes::{ByteReader, ByteWriter};
pub use entry::ReportEntry;
pub use handshake::{Greeting, Opening};
pub use message::{read_word, write_word};
pub use record::Run;

/// First byte of a payload: what it is.
pub mod kind {
    /// Host: who is there, and where does the machine stand?
    pub const HELLO: u8 = 0x01;
    /// Host: begin an epoch with these settings.
    pub const OPEN: u8 = 0x02;
    /// Host: words in their order.
    pub const STREAM: u8 = 0x03;
    /// Host: the rate, now; and a sign of life.
    pub const RATE: u8 = 0x04;
    /// Host: the same, and a report is missing: entries are to come again from the one that is named.
    pub const NAK: u8 = 0x06;
    /// Host: the epoch is over.
    pub const CLOSE: u8 = 0x05;
    /// Card: who it is and where the machine stands.
    pub const WELCOME: u8 = 0x81;
    /// Card: what it did since, and what it holds.
    pub const REPORT: u8 = 0x82;
}
