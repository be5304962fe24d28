//! The simulated linked card: the card crate with its link endpoint, in sizes for a computer, and its identity.
//!
//! Invariant: it is the same code that a microcontroller runs; nothing is added.

use retrace_card::{CheckedSettings, LinkedCard};
use retrace_core::Record;
use retrace_link::{ANALOG_INPUTS, AnalogCounts, CardIdentity, CardSettings, CommandRefusal, PROTOCOL, channel};

/// Number of reports that it stores until the host has them.
const ENTRIES: usize = 1024;

/// Number of records that the simulated card holds.
pub const WINDOW: usize = 4096;

/// Longest average of its rate law, in periods.
pub(crate) const MEMORY: usize = 1023;

/// A simulated card of `A` axes with its link endpoint.
pub type SimLinkedCard<const A: usize> = LinkedCard<A, WINDOW, MEMORY, ENTRIES, SimRecords<A>>;

/// Storage for the records of a simulated card.
pub(crate) type SimRecords<const A: usize> = Box<[Record<A>]>;

/// Allocates the records of a simulated card.
pub(crate) fn records<const A: usize>() -> SimRecords<A> {
    vec![Record::ZERO; WINDOW].into_boxed_slice()
}

/// Frequency of the simulated card's clock, ticks per second.
pub const TICK_HZ: u32 = 10_000_000;

/// Identity of the simulated card: its serial number, and the number that distinguishes this start from others.
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
        has_spindle_pwm: true,
        has_spindle_encoder: true,
        analog: AnalogCounts::new(channel::ANALOG_OUTPUTS as u8, ANALOG_INPUTS as u8),
        window: WINDOW as u32,
        memory: MEMORY as u16,
        tick_hz: TICK_HZ,
        min_period_us: 100,
        max_period_us: 100_000,
        max_pulses_hz: 2_000_000,
    }
}

/// Largest number of pulses that a card of this identity emits on an axis in a control period of these settings, with
/// the length of the pulses and the set-up time of the direction. One pulse of each period is reserved for rounding.
///
/// # Errors
/// The card's refusal of the settings.
pub fn max_pulses_a_period<const A: usize>(
    identity: &CardIdentity,
    settings: &CardSettings<A>,
) -> Result<u16, CommandRefusal> {
    CheckedSettings::validate(settings, identity).map(|terms| terms.max_increment() - 1)
}
