//! A card with its serial line: bytes in, bytes out, and one call per control period. A board's main loop drives it,
//! and the simulated machine runs it.
//!
//! Invariant: the core receives commands only in their order, and every period is reported.

use retrace_core::Record;
use retrace_link::wire::ReportEntry;
use retrace_link::{CardCore, CardEndpoint, CardIdentity, CardStatus, EntryStorage};

use crate::window::RecordStorage;
use crate::{Card, CheckedSettings, InputLevels};

/// Card for `A` axes, a window of `W` records, averages of up to `M` periods, and `E` entries of reports that are not
/// acknowledged (a power of two). The records are stored in `S`, the entries in `T`.
#[derive(Clone, Debug)]
pub struct LinkedCard<
    const A: usize,
    const W: usize,
    const M: usize,
    const E: usize,
    S = [Record<A>; W],
    T = [ReportEntry; E],
> {
    card: Card<A, W, M, S>,
    endpoint: CardEndpoint<A, E, T>,
}

/// A [`LinkedCard`] whose large arrays are provided by [`LinkedCard::lend_memory`].
pub type LentCard<const A: usize, const W: usize, const M: usize, const E: usize> =
    LinkedCard<A, W, M, E, &'static mut [Record<A>], &'static mut [ReportEntry]>;

impl<const A: usize, const W: usize, const M: usize, const E: usize> LinkedCard<A, W, M, E> {
    /// Creates a card without an epoch; `None` as [`Card::new`]. As a constant it is placed by the linker: built at run
    /// time it would be copied over the stack twice.
    #[must_use]
    pub const fn new(identity: CardIdentity) -> Option<Self> {
        match Card::new(identity) {
            Some(card) => Some(Self { card, endpoint: CardEndpoint::new() }),
            None => None,
        }
    }
}

impl<const A: usize, const W: usize, const M: usize, const E: usize> LentCard<A, W, M, E> {
    /// Creates a card as [`LinkedCard::new`] does, whose records and entries are provided by
    /// [`LinkedCard::lend_memory`].
    #[must_use]
    pub const fn without_memory(identity: CardIdentity) -> Option<Self> {
        match Card::without_records(identity) {
            Some(card) => Some(Self { card, endpoint: CardEndpoint::without_entries() }),
            None => None,
        }
    }

    /// Sets the storage of records and entries. To be called before the serial line is served.
    pub fn lend_memory(&mut self, records: &'static mut [Record<A>; W], entries: &'static mut [ReportEntry; E]) {
        self.card.lend_records(records);
        self.endpoint.lend_entries(entries);
    }
}

impl<const A: usize, const W: usize, const M: usize, const E: usize, S: RecordStorage<A>> LinkedCard<A, W, M, E, S> {
    /// Creates a card as [`Card::with_records`] does.
    #[must_use]
    pub fn with_records(identity: CardIdentity, records: S) -> Option<Self> {
        Some(Self { card: Card::with_records(identity, records)?, endpoint: CardEndpoint::new() })
    }
}

impl<const A: usize, const W: usize, const M: usize, const E: usize, S: RecordStorage<A>, T: EntryStorage>
    LinkedCard<A, W, M, E, S, T>
{
    /// Sets serial number and start number, as [`Card::set_identity`] does.
    pub const fn set_identity(&mut self, serial: u32, boot: u32) {
        self.card.set_identity(serial, boot);
    }

    /// Processes a byte from the line without the commands that it completes, which [`LinkedCard::process_command`]
    /// processes one at a time: a frame may hold hundreds.
    pub fn receive_byte(&mut self, byte: u8) {
        self.endpoint.receive_byte(byte, &mut self.card);
    }

    /// Processes the next command of the frame that was received last. Returns false if there is none left.
    pub fn process_command(&mut self) -> bool {
        self.endpoint.process_command(&mut self.card)
    }

    /// Processes a byte from the line, and every command that it completes.
    pub fn receive(&mut self, byte: u8) {
        self.endpoint.receive(byte, &mut self.card);
    }

    /// Runs one control period. The outputs to set are in its status, the pulses to emit in [`Card::pulses`].
    pub fn run_period(&mut self, inputs: InputLevels) -> &CardStatus<A> {
        self.card.run_period(inputs);
        self.endpoint.push_period(self.card.status());
        self.card.status()
    }

    /// Writes bytes for the line to `out`, as many as are available and fit, and returns their number.
    pub fn transmit(&mut self, out: &mut [u8]) -> usize {
        self.endpoint.transmit(&self.card, out)
    }

    /// Returns the settings of the epoch; `None` before the first.
    #[must_use]
    pub const fn settings(&self) -> Option<&CheckedSettings<A>> {
        self.card.settings()
    }

    /// Returns the status of the last period.
    #[must_use]
    pub fn status(&self) -> &CardStatus<A> {
        self.card.status()
    }

    /// Returns the card without its line.
    #[must_use]
    pub const fn card(&self) -> &Card<A, W, M, S> {
        &self.card
    }
}
