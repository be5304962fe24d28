//! The counter of the edges at an input (RP2040 data sheet, 4.5.2.5).
//!
//! Invariant: it counts from [`start`] on, and no interrupt is needed; the pin is read as an input as well.

use retrace_firmware::rp2040::pins::FREQUENCY_PIN;

use super::registers::{EDGE_COUNTER, EDGE_COUNTER_CONTROL, EDGE_COUNTER_DIVIDER, EDGE_COUNTER_TOP, pin_control};

/// Function of the pin (data sheet, 2.19.2).
const PWM: u32 = 4;
/// Bits of the control register: the counter runs, by the rising edges at its input B.
const COUNTS_RISING_EDGES: u32 = 1 | 2 << 4;

/// Starts the counter. The pad of the pin is that of an input.
pub(super) fn start() {
    EDGE_COUNTER_DIVIDER.write(1 << 4);
    EDGE_COUNTER_TOP.write(0xffff);
    EDGE_COUNTER_CONTROL.write(COUNTS_RISING_EDGES);
    pin_control(FREQUENCY_PIN).write(PWM);
}

/// Returns the number of rising edges; it wraps around.
pub(super) fn edges() -> u16 {
    EDGE_COUNTER.read() as u16
}
