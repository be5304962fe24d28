//! The pins (RP2040 data sheet, 2.19).
//!
//! Invariant: an output pin has its level before it becomes an output.

use super::chip::FORCED_LOW;
use super::registers::{PINS_IN, PINS_OUT, PINS_OUTPUT_ENABLE, pin_control, pin_pad};
use super::spindle_pwm;
use retrace_firmware::AXES;
use retrace_firmware::rp2040::pins::{
    self, ALL_OUTPUTS, ENCODER_PINS, FIRST_DIRECTION_PIN, FIRST_INPUT_PIN, FIRST_STEP_PIN, GATE_PIN, INPUTS,
    OUTPUT_PINS, SERIAL_PINS, SPINDLE_PWM_PIN,
};
use retrace_link::Outputs;

/// Functions of a pin (data sheet, 2.19.2).
const UART: u32 = 2;
const PROCESSOR: u32 = 5;
const STEP_MACHINES: u32 = 6;
const FRAME_MACHINE: u32 = 7;
/// Pads: input enabled, 4 mA, Schmitt trigger; with a pull-up, or with a pull-down, which a pin has from reset on.
const PULLED_UP: u32 = 0x5a;
const PULLED_DOWN: u32 = 0x56;

/// Configures the pins of the processor and of the line; outputs are low.
pub(super) fn start() {
    PINS_OUT.write(0);
    PINS_OUTPUT_ENABLE.write(ALL_OUTPUTS);
    for (pin, _) in OUTPUT_PINS {
        pin_pad(pin).write(PULLED_DOWN);
        pin_control(pin).write(PROCESSOR);
    }
    spindle_pwm::set_low();
    pin_pad(SPINDLE_PWM_PIN).write(PULLED_DOWN);
    for pin in (FIRST_INPUT_PIN..FIRST_INPUT_PIN + INPUTS).chain(ENCODER_PINS) {
        pin_pad(pin).write(PULLED_UP);
        pin_control(pin).write(PROCESSOR);
    }
    for pin in SERIAL_PINS {
        // an open line reads as idle
        pin_pad(pin).write(PULLED_UP);
        pin_control(pin).write(UART);
    }
}

/// Gives the pins of the axes and the gate to the state machines, which hold them low by now.
pub(super) fn connect_machines() {
    for pin in axis_pins() {
        pin_pad(pin).write(PULLED_DOWN);
        pin_control(pin).write(STEP_MACHINES);
    }
    pin_pad(GATE_PIN).write(PULLED_DOWN);
    pin_control(GATE_PIN).write(FRAME_MACHINE);
}

fn axis_pins() -> impl Iterator<Item = u8> {
    (0..AXES as u8).flat_map(|axis| [FIRST_STEP_PIN + axis, FIRST_DIRECTION_PIN + axis])
}

/// Sets all steps and outputs low, whatever drives them.
pub(super) fn set_all_low() {
    for axis in 0..AXES as u8 {
        pin_control(FIRST_STEP_PIN + axis).write(FORCED_LOW | STEP_MACHINES);
    }
    PINS_OUT.write(0);
    spindle_pwm::set_low();
}

/// Returns the levels of the inputs, one bit each.
pub(super) fn input_levels() -> u16 {
    pins::input_levels(PINS_IN.read())
}

/// Switches the output pins. No other pin belongs to the processor's output register.
pub(super) fn set_outputs(outputs: &Outputs) {
    PINS_OUT.write(pins::output_levels(outputs));
}
