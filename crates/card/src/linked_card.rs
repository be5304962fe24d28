//! A card on its line: bytes in, bytes out, and a control period now and then. This is what a board's main loop drives, and what
//! the simulated machine runs.
//!
//! Invariant: the works see words in their order only, and every period is reported.

use retrace_core::Record;
use retrace_link::{CardCore, CardEndpoint, CardIdentity, CardStatus};

use crate::window::RecordStorage;
use crate::{Card, CheckedSettings, InputLevels};

/// A card for `A` axes, a window of `W` records, averages up to `M` periods, and `E` entries of reports that are not confirmed (a power of
/// two).
#[derive(Clone, Debug)]
pub struct LinkedCard<const A: usize, const W: usize, const M: usize, const E: usize, S = [Record<A>; W]> {
    card: Card<A, W, M, S>,
    end: CardEndpoint<A, E>,
}

impl<const A: usize, const W: usize, const M: usize, const E: usize> LinkedCard<A, W, M, E> {
    /// A card that nobody has opened yet; `None` as [`Card::new`]. In a constant it is put in its place by the linker: built at run time it would
    /// pass over the stack, twice.
    #[must_use]
    pub const fn new(identity: CardIdentity) -> Option<Self> {
        match Card::new(identity) {
            Some(card) => Some(Self { card, end: CardEndpoint::new() }),
            None => None,
        }
    }
}

impl<const A: usize, const W: usize, const M: usize, const E: usize> LinkedCard<A, W, M, E, &'static mut [Record<A>]> {
    /// As [`OnLine::new`], with a window whose records [`OnLine::lend`] brings.
    #[must_use]
    pub const fn without_records(identity: CardIdentity) -> Option<Self> {
        match Card::without_records(identity) {
            Some(card) => Some(Self { card, end: CardEndpoint::new() }),
            None => None,
        }
    }

    /// As [`Card::lend`].
    pub fn lend(&mut self, records: &'static mut [Record<A>; W]) {
        self.card.lend(records);
    }
}

impl<const A: usize, const W: usize, const M: usize, const E: usize, S: RecordStorage<A>> LinkedCard<A, W, M, E, S> {
    /// As [`Card::name`].
    pub const fn name(&mut self, serial: u32, boot: u32) {
        self.card.name(serial, boot);
    }

    /// Takes a byte off the line.
    pub fn receive(&mut self, byte: u8) {
        self.end.receive(byte, &mut self.card);
    }

    /// Lets one control period pass: what its report says of outputs is what is to be emitted, and [`Card::pulses`].
    pub fn period(&mut self, inputs: InputLevels) -> &CardStatus<A> {
        self.card.period(inputs);
        self.end.period(self.card.status());
        self.card.status()
    }

    /// Bytes for the line, as many as there are and fit; how many.
    pub fn transmit(&mut self, out: &mut [u8]) -> usize {
        self.end.transmit(&self.card, out)
    }

    /// What the epoch goes by; `None` before the first.
    #[must_use]
    pub const fn terms(&self) -> Option<&CheckedSettings<A>> {
        self.card.terms()
    }

    /// The last period's report.
    #[must_use]
    pub fn status(&self) -> &CardStatus<A> {
        self.card.status()
    }

    /// The card without its line.
    #[must_use]
    pub const fn card(&self) -> &Card<A, W, M, S> {
        &self.card
    }
}
