//! The part of the Raspberry Pi Pico's and Pico 2's board that accesses no register: pins, state machine programs, and
//! the words that make steps.
//!
//! Invariant: what the card accepts fits a control period of the step generator ([`step_words`]).

pub mod edge_count;
pub mod frequency;
pub mod period_clock;
pub mod pins;
#[cfg(test)]
mod pio_model;
pub mod pio_programs;
pub mod pwm;
pub mod quadrature;
pub mod spindle_decoder;
pub mod step_words;
pub mod unique_number;
pub mod usb_frame;
pub mod voltage_module;
pub mod voltage_sentence;

use retrace_link::{CardIdentity, PROTOCOL};

use crate::{AXES, MEMORY, WINDOW};

/// Chip of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chip {
    /// Of a Raspberry Pi Pico.
    Rp2040,
    /// Of a Raspberry Pi Pico 2.
    Rp2350,
}

/// Chip of this image; on a development host the RP2040.
pub const CHIP: Chip = if cfg!(feature = "rp2350") { Chip::Rp2350 } else { Chip::Rp2040 };

impl Chip {
    /// Returns the clock of the processor and of the state machines, in Hz.
    #[must_use]
    pub const fn clock_hz(self) -> u32 {
        match self {
            Self::Rp2040 => 125_000_000,
            Self::Rp2350 => 150_000_000,
        }
    }

    /// Returns the maximum pulse frequency of an axis, in pulses per second. That of the RP2040 is what was run in its
    /// emulator, that of the RP2350 is calculated.
    #[must_use]
    pub const fn max_pulses_hz(self) -> u32 {
        match self {
            Self::Rp2040 => 250_000,
            Self::Rp2350 => 400_000,
        }
    }

    /// Returns the maximum control period, in microseconds: a word has up to 1023 pulses, and two periods of at most
    /// four words fill a state machine's queue.
    #[must_use]
    pub const fn max_period_us(self) -> u32 {
        match self {
            Self::Rp2040 => 4000,
            Self::Rp2350 => 2500,
        }
    }

    const fn name(self) -> [u8; 16] {
        match self {
            Self::Rp2040 => *b"retrace-rp2040\0\0",
            Self::Rp2350 => *b"retrace-rp2350\0\0",
        }
    }
}

/// Clock of the processor and of the state machines, in Hz.
pub const CLOCK_HZ: u32 = CHIP.clock_hz();
/// Minimum control period, in microseconds: limited by the computing time (docs/firmware.md, *What was measured in
/// rp2040js*).
pub const MIN_PERIOD_US: u32 = 1000;
/// Maximum control period, in microseconds.
pub const MAX_PERIOD_US: u32 = CHIP.max_period_us();
/// Maximum pulse frequency of an axis, in pulses per second.
pub const MAX_PULSES_HZ: u32 = CHIP.max_pulses_hz();

/// Identity of the card before it has a serial number and the number of a start.
pub const IDENTITY: CardIdentity = identity(CHIP);

/// Returns the identity of a card with this chip.
#[must_use]
pub const fn identity(chip: Chip) -> CardIdentity {
    CardIdentity {
        protocol: PROTOCOL,
        name: chip.name(),
        serial: 0,
        boot: 0,
        axes: AXES as u8,
        outputs: pins::DIGITAL_OUTPUTS,
        inputs: pins::INPUTS,
        has_spindle_pwm: true,
        has_spindle_encoder: true,
        analog: retrace_link::AnalogCounts::new(0, 2),
        window: WINDOW as u32,
        memory: MEMORY as u16,
        tick_hz: chip.clock_hz(),
        min_period_us: MIN_PERIOD_US,
        max_period_us: chip.max_period_us(),
        max_pulses_hz: chip.max_pulses_hz(),
    }
}
