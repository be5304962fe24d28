//! The part of the STM32F4 boards that accesses no register: pins, and the buffers that make steps.
//!
//! Invariant: data shared by the interrupt and the main loop is atomic, and each word is stored by only one of them.

pub mod axis_edges;
#[cfg(test)]
mod dma_model;
pub mod period;
pub mod pins;
pub mod port_counter;
pub mod probed_periods;
pub mod step_filler;
pub mod step_mailbox;
pub mod usb_otg;

use retrace_link::{CardIdentity, PROTOCOL};

use crate::{AXES, MEMORY, WINDOW};
use period::{MAX_PERIOD_US, MAX_PULSES_HZ, MIN_PERIOD_US, SLOT_HZ};

/// Identity of the card before it has a serial number and the number of a start.
pub const IDENTITY: CardIdentity = identity(MIN_PERIOD_US);

/// Returns the identity of a card whose shortest control period is this, in microseconds: all else is the same on each
/// chip.
#[must_use]
pub const fn identity(min_period_us: u32) -> CardIdentity {
    CardIdentity {
        protocol: PROTOCOL,
        name: *b"retrace-stm32f4\0",
        serial: 0,
        boot: 0,
        axes: AXES as u8,
        outputs: pins::DIGITAL_OUTPUTS,
        inputs: pins::INPUT_PINS.len() as u8,
        has_spindle_pwm: false,
        has_spindle_encoder: false,
        analog: retrace_link::AnalogCounts::NONE,
        window: WINDOW as u32,
        memory: MEMORY as u16,
        tick_hz: SLOT_HZ,
        min_period_us,
        max_period_us: MAX_PERIOD_US,
        max_pulses_hz: MAX_PULSES_HZ,
    }
}
