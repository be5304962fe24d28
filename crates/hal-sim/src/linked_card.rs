//! The simulated card: the card crate with its end of the line, as large as a computer likes, and what it says of itself.
//!
//! Invariant: it is the same code that a microcontroller runs; nothing is added.

use retrace_card::{CheckedSettings, LinkedCard};
use retrace_link::{CardIdentity, CardSettings, CommandRefusal, PROTOCOL};

use crate::WINDOW;
use crate::sim_card::MEMORY;

/// Reports that it keeps until the host has them.
const ENTRIES: usize = 1024;

/// A simulated card of `A` axes with its end of the line.
pub type SimLinkedCard<const A: usize> = LinkedCard<A, WINDOW, MEMORY, ENTRIES>;

/// Ticks a second of the simulated card's clock.
pub const TICK_HZ: u32 = 10_000_000;

/// What the simulated card says of itself: its serial number, and the number that tells this start from others.
#[must_use]
pub fn identity<const A: usize>(serial: u32, boot: u32) -> CardIdentity {
    CardIdentity {
        protocol: PROTOCOL,
        name: *b"retrace-sim\0\0\0\0\0",
        serial,
        boot,
        axes: A as u8,
        outputs: 64,
        inputs: 16,
        window: WINDOW as u32,
        memory: MEMORY as u16,
        tick_hz: TICK_HZ,
        min_period_us: 100,
        max_period_us: 100_000,
        max_pulses_hz: 2_000_000,
    }
}

/// The most pulses that a card of this identity makes of an axis in a control period of these settings, with the length of the pulses and the
/// set-up time of the direction; one pulse of each period is kept back for rounding.
///
/// # Errors
/// What the card refuses of the settings.
pub fn max_pulses_a_period<const A: usize>(
    identity: &CardIdentity,
    settings: &CardSettings<A>,
) -> Result<u16, CommandRefusal> {
    CheckedSettings::validate(settings, identity).map(|terms| terms.max_increment() - 1)
}
