//! A port whose other end is a simulated card in this process, in virtual time: as fast as it can.
//!
//! Invariant: time passes only while the host waits for bytes, so that a run depends on the settings and on what the host does, and on no clock.

use std::fmt;

use retrace_link::{BytePort, CardFailure};

use crate::card_simulator::CardSimulator;

/// Bytes come to the host in bunches, as from a driver: it waits for so many microseconds from the first.
const BUNCH_US: u64 = 250;
/// What is written ahead: 4 ms of the line, in nanoseconds.
const AHEAD_NS: u64 = 4_000_000;
/// As many bytes where they take no time.
const AHEAD: usize = 400;

/// A port to a simulated card.
#[derive(Debug)]
pub struct InProcess<const A: usize> {
    rig: CardSimulator<A>,
}

/// What goes wrong with such a port: nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoFault {}

impl fmt::Display for NoFault {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

impl CardFailure for NoFault {
    fn number(&self) -> &'static str {
        match *self {}
    }

    fn remedy(&self) -> &'static str {
        match *self {}
    }
}

impl<const A: usize> InProcess<A> {
    /// A port to this rig.
    #[must_use]
    pub const fn new(rig: CardSimulator<A>) -> Self {
        Self { rig }
    }

    /// The rig.
    #[must_use]
    pub const fn rig(&self) -> &CardSimulator<A> {
        &self.rig
    }

    /// The rig, to be meddled with.
    pub const fn rig_mut(&mut self) -> &mut CardSimulator<A> {
        &mut self.rig
    }

    /// The rig, without a port.
    #[must_use]
    pub fn into_rig(self) -> CardSimulator<A> {
        self.rig
    }
}

impl<const A: usize> BytePort for InProcess<A> {
    type Fault = NoFault;

    fn now_us(&self) -> u64 {
        self.rig.now_us()
    }

    fn writable_bytes(&mut self) -> usize {
        let ahead = match self.rig.lines()[0].byte_ns() {
            0 => AHEAD,
            byte_ns => (AHEAD_NS / byte_ns) as usize,
        };
        ahead.saturating_sub(self.rig.unsent())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, NoFault> {
        let count = bytes.len().min(self.writable_bytes());
        self.rig.send(&bytes[..count]);
        Ok(count)
    }

    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, NoFault> {
        let until = self.rig.now_us() + u64::from(wait_us);
        self.rig.advance(until);
        self.rig.run(until.min(self.rig.now_us() + BUNCH_US));
        Ok(self.rig.take(bytes))
    }
}
