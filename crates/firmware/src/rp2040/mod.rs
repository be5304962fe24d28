//! The part of the Raspberry Pi Pico's board that accesses no register: pins, state machine programs, and the words
//! that make steps.
//!
//! Invariant: what the card accepts fits a control period of the step generator ([`step_words`]).

pub mod line_selector;
pub mod pins;
#[cfg(test)]
mod pio_model;
pub mod pio_programs;
pub mod quadrature;
pub mod step_words;
pub mod usb_control;

use retrace_link::{CardIdentity, PROTOCOL};

use crate::{AXES, MEMORY, WINDOW};

/// Clock of the processor and of the state machines, in Hz.
pub const CLOCK_HZ: u32 = 125_000_000;
/// Minimum control period, in microseconds: limited by the computing time (docs/firmware.md, *What was measured in
/// rp2040js*).
pub const MIN_PERIOD_US: u32 = 1000;
/// Maximum control period, in microseconds: two periods of at most four words fill a state machine's queue.
pub const MAX_PERIOD_US: u32 = 4000;
/// Maximum pulse frequency of an axis, in pulses per second.
pub const MAX_PULSES_HZ: u32 = 250_000;

/// Identity of the card before it has a serial number and the number of a start.
pub const IDENTITY: CardIdentity = CardIdentity {
    protocol: PROTOCOL,
    name: *b"retrace-rp2040\0\0",
    serial: 0,
    boot: 0,
    axes: AXES as u8,
    outputs: pins::DIGITAL_OUTPUTS,
    inputs: pins::INPUTS,
    has_power_output: false,
    window: WINDOW as u32,
    memory: MEMORY as u16,
    tick_hz: CLOCK_HZ,
    min_period_us: MIN_PERIOD_US,
    max_period_us: MAX_PERIOD_US,
    max_pulses_hz: MAX_PULSES_HZ,
};
