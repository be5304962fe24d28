//! Pin assignment: the wiring table of `docs/firmware.md`, as constants, and the register words of the ports.
//!
//! Invariant: all axes are on port A and all outputs on port B, so that one store to a port's bit set/reset register
//! switches them at once (RM0090 and RM0368, 8.4.7: lower half sets, upper half resets).

use retrace_link::{Outputs, channel};

use crate::AXES;
use crate::output_level::High;

/// Step pin of the first axis, on port A; those of the other axes follow it. The drive counts the rising edge.
pub const FIRST_STEP_PIN: u8 = 1;
/// Direction pin of the first axis, on port A; those of the other axes follow it. High is positive.
pub const FIRST_DIRECTION_PIN: u8 = 5;

/// Number of digital outputs with a pin: channels 0 … 3.
pub const DIGITAL_OUTPUTS: u8 = 4;
/// The output pins, on port B. All are low from reset on.
pub const OUTPUT_PINS: [(u8, High); 8] = [
    (0, High::NotZero(0)),
    (1, High::NotZero(1)),
    (10, High::NotZero(2)),
    (12, High::NotZero(3)),
    (13, High::Above(channel::SPINDLE)),
    (14, High::Below(channel::SPINDLE)),
    (15, High::NotZero(channel::FLOOD)),
    (2, High::NotZero(channel::MIST)),
];

/// A port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// Port A.
    A,
    /// Port B.
    B,
    /// Port C.
    C,
}

/// The pins of inputs 0 … 7, each with its pull-up.
pub const INPUT_PINS: [(Port, u8); 8] =
    [(Port::B, 3), (Port::B, 4), (Port::B, 5), (Port::B, 8), (Port::B, 9), (Port::A, 0), (Port::A, 15), (Port::C, 13)];

/// Input of the timer that captures the edge of the probe (TIM2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaptureInput {
    /// Its channel 1.
    First,
    /// Its channel 2.
    Second,
}

/// Returns the timer's input at the pin of an input of the card, if there is one (data sheets, *Alternate function
/// mapping*: AF1): inputs 0, 5 and 6.
#[must_use]
pub fn capture_input(input: u8) -> Option<CaptureInput> {
    match INPUT_PINS.get(usize::from(input))? {
        (Port::B, 3) => Some(CaptureInput::Second),
        (Port::A, 0 | 15) => Some(CaptureInput::First),
        _ => None,
    }
}

/// Transmit and receive of USART1, on port A.
pub const SERIAL_PINS: [u8; 2] = [9, 10];
/// The lines of the USB socket, negative and positive, on port A.
pub const USB_PINS: [u8; 2] = [11, 12];
/// A and B of the handwheel's encoder, on port B: channels 1 and 2 of TIM4.
pub const ENCODER_PINS: [u8; 2] = [6, 7];

/// All axes, one bit each.
const ALL: u32 = (1 << AXES) - 1;

/// Returns the word for port A that sets the step of an axis high or low.
#[must_use]
pub const fn step_word(axis: usize, is_high: bool) -> u32 {
    bit(FIRST_STEP_PIN + axis as u8, is_high)
}

/// Returns the word for port A that sets the direction of an axis; `inverted`: axes for which high is backward, one bit
/// each.
#[must_use]
pub const fn direction_word(axis: usize, backward: bool, inverted: u16) -> u32 {
    bit(FIRST_DIRECTION_PIN + axis as u8, backward == (inverted >> axis & 1 == 1))
}

/// Returns the word for port B that sets all output pins.
#[must_use]
pub fn outputs_word(outputs: &Outputs) -> u32 {
    OUTPUT_PINS.iter().fold(0, |word, &(pin, high)| word | bit(pin, high.is_met(outputs)))
}

/// Word for port B that sets all output pins low.
pub const ALL_OUTPUTS_LOW: u32 = {
    let (mut word, mut n) = (0, 0);
    while n < OUTPUT_PINS.len() {
        word |= bit(OUTPUT_PINS[n].0, false);
        n += 1;
    }
    word
};

/// Word for port A that sets all step pins low and leaves the directions unchanged.
pub const ALL_STEPS_LOW: u32 = ALL << FIRST_STEP_PIN << 16;

const fn bit(pin: u8, high: bool) -> u32 {
    1 << (if high { pin } else { pin + 16 })
}

/// Returns the levels of the inputs, one bit each, from the input registers of ports A, B and C.
#[must_use]
pub fn input_levels(a: u32, b: u32, c: u32) -> u16 {
    INPUT_PINS.iter().enumerate().fold(0, |levels, (number, &(port, pin))| {
        let read = match port {
            Port::A => a,
            Port::B => b,
            Port::C => c,
        };
        levels | ((read >> pin & 1) as u16) << number
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_pin_is_used_twice() {
        let mut used: Vec<(Port, u8)> = (0..AXES as u8)
            .flat_map(|axis| [FIRST_STEP_PIN + axis, FIRST_DIRECTION_PIN + axis])
            .chain(SERIAL_PINS)
            .chain(USB_PINS)
            // 13 and 14 are the debugger's
            .chain([13, 14])
            .map(|pin| (Port::A, pin))
            .chain(OUTPUT_PINS.iter().map(|&(pin, _)| (Port::B, pin)))
            .chain(ENCODER_PINS.map(|pin| (Port::B, pin)))
            .chain(INPUT_PINS)
            .collect();
        // PB11 is not led out of the F401 and F411
        assert!(!used.contains(&(Port::B, 11)) && used.iter().all(|&(_, pin)| pin < 16));
        let count = used.len();
        used.sort_by_key(|&(port, pin)| (port as u8, pin));
        used.dedup();
        assert_eq!(used.len(), count);
    }

    #[test]
    fn every_pin_of_a_group_is_set_or_reset_by_its_word() {
        let touched = |word: u32| (word | word >> 16) & 0xffff;
        let outputs: u32 = OUTPUT_PINS.iter().map(|&(pin, _)| 1 << pin).sum();
        let (mut off, mut on) = ([0; channel::COUNT], [1; channel::COUNT]);
        on[usize::from(channel::SPINDLE)] = -1;
        assert_eq!(outputs_word(&off), ALL_OUTPUTS_LOW);
        assert_eq!((touched(outputs_word(&on)), touched(ALL_OUTPUTS_LOW)), (outputs, outputs));
        assert_eq!(outputs_word(&on) & 0xffff, outputs & !(1 << 13), "M4: not the pin of M3");
        off[usize::from(channel::SPINDLE)] = 1;
        assert_eq!(outputs_word(&off) & 0xffff, 1 << 13);
        assert_eq!((step_word(0, true), step_word(3, false)), (1 << 1, 1 << 20));
        assert_eq!((direction_word(0, false, 0), direction_word(0, true, 0)), (1 << 5, 1 << 21));
        assert_eq!((direction_word(3, false, 0b1000), direction_word(3, true, 0b1000)), (1 << 24, 1 << 8));
        assert_eq!(ALL_STEPS_LOW, 0b1_1110 << 16);
    }

    #[test]
    fn a_probe_is_captured_at_inputs_0_5_and_6() {
        let captured: Vec<u8> = (0..=u8::MAX).filter(|&input| capture_input(input).is_some()).collect();
        assert_eq!(captured, [0, 5, 6]);
    }

    #[test]
    fn each_input_is_read_from_its_pin() {
        for (number, &(port, pin)) in INPUT_PINS.iter().enumerate() {
            let read = |here: Port| if here == port { 1 << pin } else { 0 };
            assert_eq!(input_levels(read(Port::A), read(Port::B), read(Port::C)), 1 << number);
        }
    }
}
