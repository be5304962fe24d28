//! A port whose other end is a simulated card in this process, in virtual time: as fast as possible.
//!
//! Invariant: time passes only while the host waits for bytes, so that a run depends on the settings and on what the
//! host does, and on no clock.

use std::fmt;

use retrace_link::{BytePort, CardFailure};

use crate::card_simulator::CardSimulator;

/// Time in microseconds that the host waits from the first byte on: bytes arrive in bunches, as from a driver.
const BUNCH_US: u64 = 250;
/// Transmission time that is written ahead: 4 ms, in nanoseconds.
const AHEAD_NS: u64 = 4_000_000;
/// Number of bytes written ahead where they take no time.
const AHEAD: usize = 400;

/// A port to a simulated card.
#[derive(Debug)]
pub struct InProcess<const A: usize> {
    rig: CardSimulator<A>,
}

/// Error of such a port, which never occurs.
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
    /// A port to this card simulator.
    #[must_use]
    pub const fn new(rig: CardSimulator<A>) -> Self {
        Self { rig }
    }

    /// The card simulator.
    #[must_use]
    pub const fn simulator(&self) -> &CardSimulator<A> {
        &self.rig
    }

    /// The card simulator, for changes by a test.
    pub const fn simulator_mut(&mut self) -> &mut CardSimulator<A> {
        &mut self.rig
    }

    /// The card simulator, without the port.
    #[must_use]
    pub fn into_simulator(self) -> CardSimulator<A> {
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
        Ok(self.rig.receive(bytes))
    }
}
