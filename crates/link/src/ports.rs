//! What stands at either end of the line: the card's works, and the host's port.
//!
//! Invariant: neither knows the protocol; they take words and bytes.

use retrace_core::Place;

use crate::{CardIdentity, CardSettings, CardStatus, CommandRefusal, HostCommand, crc};

/// A check of place and counts, by which host and card see that they agree on where the machine stands.
#[must_use]
pub fn state_crc(place: Place, counts: &[i64], axes: u8) -> u32 {
    let place = [place.record.to_le_bytes(), place.fraction.to_le_bytes()];
    let start = place.iter().flatten().fold(crc::START, |register, &byte| crc::update(register, byte));
    let counts = counts.iter().take(usize::from(axes)).flat_map(|count| count.to_le_bytes());
    crc::finish(counts.fold(start, crc::update))
}

/// The card's works, as its end of the line sees them.
pub trait CardCore<const A: usize> {
    /// Who the card is.
    fn identity(&self) -> &CardIdentity;

    /// Begins an epoch: the window is empty, at the counts as they are, and these settings hold. Only while the machine stands.
    ///
    /// # Errors
    /// [`Refusal`]; nothing has changed then.
    fn open(&mut self, settings: &CardSettings<A>) -> Result<(), CommandRefusal>;

    /// Ends the epoch; only while the machine stands.
    ///
    /// # Errors
    /// [`Refusal::InMotion`]
    fn close(&mut self) -> Result<(), CommandRefusal>;

    /// A whole frame of the open epoch came: the host is there.
    fn host_is_alive(&mut self);

    /// Takes a word.
    ///
    /// # Errors
    /// [`Refusal`]; nothing has changed then.
    fn accept(&mut self, word: HostCommand<A>) -> Result<(), CommandRefusal>;

    /// The last period's report.
    fn status(&self) -> &CardStatus<A>;
}

/// The host's port to a line of bytes, which may lose, change and delay them.
pub trait BytePort {
    /// How the line can be gone.
    type Fault: CardFailure;

    /// Microseconds since some moment, never going back.
    fn now_us(&self) -> u64;

    /// How many bytes may be written now, so that no more than some 4 ms of them wait in the operating system.
    fn writable_bytes(&mut self) -> usize;

    /// Writes bytes, at most [`Port::room`] of them; how many were taken.
    ///
    /// # Errors
    /// The line is gone.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Fault>;

    /// Reads what has come, or waits for it up to `wait_us` microseconds; 0 where nothing came.
    ///
    /// # Errors
    /// The line is gone.
    fn read(&mut self, bytes: &mut [u8], wait_us: u32) -> Result<usize, Self::Fault>;

    /// Tries once to get a line back that is gone, and says whether it is there again. Takes some time where it is not.
    fn revive(&mut self) -> bool {
        false
    }
}

/// What ends a run on a card for good.
pub trait CardFailure: core::fmt::Display {
    /// Its number in the table of errors.
    fn number(&self) -> &'static str;

    /// What to do.
    fn remedy(&self) -> &'static str;
}
