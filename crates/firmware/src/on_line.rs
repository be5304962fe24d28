//! Stand-in for the card crate's card on its line, until that is merged: it plays records of its own making while it hears anything.
//!
//! Invariant: its shape is that of the card crate's.

use retrace_card::Player;
use retrace_core::rate::Smoothing;
use retrace_core::{ONE, Record};
use retrace_link::{Identity, Settings, Status, Word};

/// What the pins show.
#[derive(Clone, Copy, Debug, Default)]
pub struct Inputs {
    /// Levels, one bit each.
    pub levels: u16,
    /// The encoder's count.
    pub encoder: u16,
}

/// The card.
pub struct OnLine<const A: usize, const W: usize, const M: usize> {
    player: Option<Player<A, W, M>>,
    settings: Settings<A>,
    identity: Identity,
    said: Option<u8>,
}

impl<const A: usize, const W: usize, const M: usize> OnLine<A, W, M> {
    /// A card at rest.
    #[must_use]
    pub fn new(identity: Identity) -> Self {
        let smoothing = Smoothing::new(64, 32).unwrap_or_else(|| unreachable!());
        Self { player: Player::new(0, smoothing), settings: Settings::new(1, 0, 1000, smoothing), identity, said: None }
    }

    /// A byte came.
    pub fn receive(&mut self, byte: u8) {
        self.said = Some(byte ^ self.identity.serial as u8);
        if let Some(player) = &mut self.player {
            let target = if byte == b'g' { ONE } else { 0 };
            let _ = player.take(Word::Rate { target });
        }
    }

    /// Bytes to be sent.
    pub fn transmit(&mut self, bytes: &mut [u8]) -> usize {
        match self.said.take() {
            Some(byte) => {
                bytes[0] = byte;
                1
            }
            None => 0,
        }
    }

    /// A period passes.
    pub fn period(&mut self, _inputs: Inputs) -> &Status<A> {
        let Some(player) = &mut self.player else { unreachable!() };
        let status = *player.status();
        let record = Record { increments: [7; A], ..Record::default() };
        let _ = player.take(Word::Ahead { place: status.high, record });
        let _ = player.take(Word::Forget { low: status.place.record });
        player.period()
    }

    /// The settings.
    pub fn settings(&self) -> &Settings<A> {
        &self.settings
    }
}
