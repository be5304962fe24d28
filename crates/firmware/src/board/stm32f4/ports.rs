//! The pins (RM0090 and RM0368, *General-purpose I/Os*).
//!
//! Invariant: an output pin has its level before it becomes an output.

use retrace_firmware::AXES;
use retrace_firmware::stm32f4::pins::{
    ALL_OUTPUTS_LOW, ENCODER_PINS, FIRST_DIRECTION_PIN, FIRST_STEP_PIN, INPUT_PINS, OUTPUT_PINS, Port, SERIAL_PINS,
    USB_PINS, outputs_word,
};
use retrace_link::Outputs;

use super::registers::{port_a, port_b, port_c, rcc, set_port_a, set_port_b};

/// The alternate functions of the serial line and of TIM4 (data sheets, *Alternate function mapping*).
const SERIAL_FUNCTION: u8 = 7;
const ENCODER_FUNCTION: u8 = 2;

/// Configures all pins.
pub(super) fn start() {
    rcc().ahb1enr().modify(|_, w| w.gpioaen().enabled().gpioben().enabled().gpiocen().enabled());
    for axis in 0..AXES as u8 {
        for pin in [FIRST_STEP_PIN + axis, FIRST_DIRECTION_PIN + axis] {
            set_port_a(1 << (pin + 16));
            port_a().moder().modify(|_, w| w.moder(pin).output());
        }
    }
    set_port_b(ALL_OUTPUTS_LOW);
    for (pin, _) in OUTPUT_PINS {
        port_b().moder().modify(|_, w| w.moder(pin).output());
    }
    for (port, pin) in INPUT_PINS {
        match port {
            Port::A => {
                port_a().pupdr().modify(|_, w| w.pupdr(pin).pull_up());
                port_a().moder().modify(|_, w| w.moder(pin).input());
            }
            Port::B => {
                port_b().pupdr().modify(|_, w| w.pupdr(pin).pull_up());
                port_b().moder().modify(|_, w| w.moder(pin).input());
            }
            Port::C => {
                port_c().pupdr().modify(|_, w| w.pupdr(pin).pull_up());
                port_c().moder().modify(|_, w| w.moder(pin).input());
            }
        }
    }
    for pin in SERIAL_PINS {
        // an open line reads as idle
        port_a().pupdr().modify(|_, w| w.pupdr(pin).pull_up());
        port_a().afrh().modify(|_, w| w.afr(pin - 8).set(SERIAL_FUNCTION));
        port_a().moder().modify(|_, w| w.moder(pin).alternate());
    }
    for pin in ENCODER_PINS {
        port_b().pupdr().modify(|_, w| w.pupdr(pin).pull_up());
        port_b().afrl().modify(|_, w| w.afr(pin).set(ENCODER_FUNCTION));
        port_b().moder().modify(|_, w| w.moder(pin).alternate());
    }
}

/// Alternate function of the USB controller (data sheets, *Alternate function mapping*).
const USB_FUNCTION: u8 = 10;

/// Connects the pins of the USB socket to its controller.
pub(super) fn connect_usb() {
    for pin in USB_PINS {
        port_a().ospeedr().modify(|_, w| w.ospeedr(pin).very_high_speed());
        port_a().afrh().modify(|_, w| w.afr(pin - 8).set(USB_FUNCTION));
        port_a().moder().modify(|_, w| w.moder(pin).alternate());
    }
}

/// Alternate function of TIM2 (data sheets, *Alternate function mapping*).
#[cfg(not(feature = "qemu"))]
const CAPTURE_FUNCTION: u8 = 1;

/// Connects the pin of this input to the timer that captures; its level can be read as before.
#[cfg(not(feature = "qemu"))]
pub(super) fn connect_capture(input: u8) {
    let Some(&(port, pin)) = INPUT_PINS.get(usize::from(input)) else { return };
    match (port, pin) {
        (Port::A, 0..8) => {
            port_a().afrl().modify(|_, w| w.afr(pin).set(CAPTURE_FUNCTION));
            port_a().moder().modify(|_, w| w.moder(pin).alternate());
        }
        (Port::A, _) => {
            port_a().afrh().modify(|_, w| w.afr(pin - 8).set(CAPTURE_FUNCTION));
            port_a().moder().modify(|_, w| w.moder(pin).alternate());
        }
        (Port::B, 0..8) => {
            port_b().afrl().modify(|_, w| w.afr(pin).set(CAPTURE_FUNCTION));
            port_b().moder().modify(|_, w| w.moder(pin).alternate());
        }
        // no such pin is one of the timer's
        (Port::B | Port::C, _) => {}
    }
}

/// Disconnects the pin of this input from the timer.
#[cfg(not(feature = "qemu"))]
pub(super) fn disconnect_capture(input: u8) {
    match INPUT_PINS.get(usize::from(input)) {
        Some(&(Port::A, pin)) => port_a().moder().modify(|_, w| w.moder(pin).input()),
        Some(&(Port::B, pin)) => port_b().moder().modify(|_, w| w.moder(pin).input()),
        Some((Port::C, _)) | None => 0,
    };
}

/// Returns the levels of the inputs, one bit each. QEMU's ports read as zero.
pub(crate) fn input_levels() -> u16 {
    let (a, b, c) = (port_a().idr().read().bits(), port_b().idr().read().bits(), port_c().idr().read().bits());
    retrace_firmware::stm32f4::pins::input_levels(a, b, c)
}

/// Switches the output pins.
pub(crate) fn set_outputs(outputs: &Outputs) {
    set_port_b(outputs_word(outputs));
}
