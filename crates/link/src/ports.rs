//! The interfaces at both ends of the serial line: the card's core, and the host's port.
//!
//! Invariant: neither depends on the protocol; they handle commands and bytes.

use retrace_core::Place;

use crate::card_failure::CardFailure;
use crate::{CardIdentity, CardSettings, CardStatus, CommandRefusal, HostCommand, crc};

/// Returns a check value of place and counts, by which host and card verify that they agree on the position.
#[must_use]
pub fn state_crc(place: Place, counts: &[i64], axes: u8) -> u32 {
    let place = [place.record.number().to_le_bytes(), place.fraction.to_le_bytes()];
    let start = place.iter().flatten().fold(crc::START, |register, &byte| crc::update(register, byte));
    let counts = counts.iter().take(usize::from(axes)).flat_map(|count| count.to_le_bytes());
    crc::finish(counts.fold(start, crc::update))
}

/// Core of a card, as its endpoint uses it.
pub trait CardCore<const A: usize> {
    /// Returns the identity of the card.
    fn identity(&self) -> &CardIdentity;

    /// Begins an epoch: the window is empty, the counts are unchanged, and these settings apply. Only while the machine
    /// is at rest.
    ///
    /// # Errors
    /// Returns the reason for the rejection; nothing has changed then.
    fn open(&mut self, settings: &CardSettings<A>) -> Result<(), CommandRefusal>;

    /// Ends the epoch; only while the machine is at rest.
    ///
    /// # Errors
    /// [`CommandRefusal::InMotion`]
    fn close(&mut self) -> Result<(), CommandRefusal>;

    /// Records that a complete frame of the open epoch has arrived, so the host is alive. Resets the watchdog.
    fn record_host_frame(&mut self);

    /// Accepts a command.
    ///
    /// # Errors
    /// Returns the reason for the rejection; nothing has changed then.
    fn accept(&mut self, command: HostCommand<A>) -> Result<(), CommandRefusal>;

    /// Returns the status of the last period.
    fn status(&self) -> &CardStatus<A>;
}

/// Port of the host to a line of bytes, which may lose, change and delay them.
pub trait BytePort {
    /// Error when the line is gone.
    type Fault: CardFailure;

    /// Returns microseconds since an arbitrary moment, monotonic.
    fn now_us(&self) -> u64;

    /// Returns how many bytes may be written now, so that no more than about 4 ms of them wait in the operating system.
    fn writable_bytes(&mut self) -> usize;

    /// Writes bytes, at most [`BytePort::writable_bytes`] of them, and returns how many were accepted.
    ///
    /// # Errors
    /// The line is gone.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Fault>;

    /// Reads received bytes, or waits for them up to `wait_us` microseconds; returns 0 if nothing arrived.
    ///
    /// # Errors
    /// The line is gone.
    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, Self::Fault>;

    /// Tries once to reopen a line that is gone, and returns whether it is available again. May block for some time if
    /// it is not.
    fn revive(&mut self) -> bool {
        false
    }
}
