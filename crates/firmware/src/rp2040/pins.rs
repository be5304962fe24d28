//! Pin assignment of the Raspberry Pi Pico: the wiring table of `docs/firmware.md`, as constants.
//!
//! Invariant: a pin has one use; the pins of the axes belong to state machines, and all outputs to the processor, which
//! switches them with one store.

use retrace_link::{Outputs, channel};

use crate::output_level::High;

/// Transmit and receive of UART0.
pub const SERIAL_PINS: [u8; 2] = [0, 1];
/// Step pin of the first axis; those of the other axes follow it. The drive counts the rising edge.
pub const FIRST_STEP_PIN: u8 = 2;
/// Direction pin of the first axis; those of the other axes follow it. High is positive.
pub const FIRST_DIRECTION_PIN: u8 = 6;
/// Number of digital outputs with a pin: channels 0 … 3.
pub const DIGITAL_OUTPUTS: u8 = 4;
/// The output pins.
pub const OUTPUT_PINS: [(u8, High); 7] = [
    (10, High::NotZero(0)),
    (11, High::NotZero(1)),
    (12, High::NotZero(2)),
    (13, High::NotZero(3)),
    (14, High::Above(channel::SPINDLE)),
    (15, High::Below(channel::SPINDLE)),
    (26, High::Either(channel::FLOOD, channel::MIST)),
];
/// Output for S, by pulse-width modulation.
pub const SPINDLE_PWM_PIN: u8 = 22;
/// Number of inputs.
pub const INPUTS: u8 = 6;
/// Pin of input 0; those of the other inputs follow it, each with its pull-up.
pub const FIRST_INPUT_PIN: u8 = 16;
/// Pin whose frequency is measured, as analog input 0: that of the last input, which it remains. It is the input B of a
/// slice of the PWM, whose counter counts its edges.
pub const FREQUENCY_PIN: u8 = 21;
/// Pin of the spindle encoder's A; its B and its index follow it. They are those of inputs 0, 1 and 2, which remain
/// inputs.
pub const FIRST_SPINDLE_PIN: u8 = FIRST_INPUT_PIN;
/// Number of inputs that a spindle's encoder takes, from input 0 on.
pub const SPINDLE_INPUTS: u8 = 3;
/// A and B of the handwheel's encoder.
pub const ENCODER_PINS: [u8; 2] = [27, 28];
/// The gate: high at the beginning of every control period, and not led out. It is the light of the Pico, which stays
/// dark: the pulse is too short to be seen.
pub const GATE_PIN: u8 = 25;

/// Returns the levels of the output pins, one bit each at the pin's number.
#[must_use]
pub fn output_levels(outputs: &Outputs) -> u32 {
    OUTPUT_PINS.iter().fold(0, |levels, &(pin, high)| levels | u32::from(high.is_met(outputs)) << pin)
}

/// All output pins, one bit each.
pub const ALL_OUTPUTS: u32 = {
    let (mut mask, mut n) = (0, 0);
    while n < OUTPUT_PINS.len() {
        mask |= 1 << OUTPUT_PINS[n].0;
        n += 1;
    }
    mask
};

/// Returns the levels of the inputs, one bit each, from the levels of all pins.
#[must_use]
pub const fn input_levels(pins: u32) -> u16 {
    (pins >> FIRST_INPUT_PIN) as u16 & ((1 << INPUTS) - 1)
}

/// Returns the levels of the encoder's A (bit 0) and B (bit 1), from the levels of all pins.
#[must_use]
pub const fn encoder_levels(pins: u32) -> u8 {
    (pins >> ENCODER_PINS[0] & 1 | (pins >> ENCODER_PINS[1] & 1) << 1) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::AXES;

    #[test]
    fn no_pin_is_used_twice() {
        let mut used: Vec<u8> = (0..AXES as u8)
            .flat_map(|axis| [FIRST_STEP_PIN + axis, FIRST_DIRECTION_PIN + axis])
            .chain(SERIAL_PINS)
            .chain(OUTPUT_PINS.iter().map(|&(pin, _)| pin))
            .chain((0..INPUTS).map(|input| FIRST_INPUT_PIN + input))
            .chain(ENCODER_PINS)
            .chain([SPINDLE_PWM_PIN])
            .collect();
        // 23, 24 and 25 are not led out of a Pico
        assert!(used.iter().all(|&pin| pin <= 22 || (26..=28).contains(&pin)));
        assert_eq!(FREQUENCY_PIN, FIRST_INPUT_PIN + INPUTS - 1, "one of the inputs");
        used.push(GATE_PIN);
        let count = used.len();
        used.sort_unstable();
        used.dedup();
        assert_eq!(used.len(), count);
    }

    #[test]
    fn outputs_and_inputs_are_at_their_pins() {
        let (mut off, mut on) = ([0; channel::COUNT], [1; channel::COUNT]);
        on[usize::from(channel::SPINDLE)] = -1;
        assert_eq!(output_levels(&off), 0);
        assert_eq!(output_levels(&on), ALL_OUTPUTS & !(1 << 14), "M4: not the pin of M3");
        off[usize::from(channel::SPINDLE)] = 1;
        assert_eq!(output_levels(&off), 1 << 14);
        for coolant in [channel::FLOOD, channel::MIST] {
            let mut outputs = [0; channel::COUNT];
            outputs[usize::from(coolant)] = 1;
            assert_eq!(output_levels(&outputs), 1 << 26);
        }
        assert_eq!(input_levels(0b101 << 16 | 1 << 22), 0b101);
        assert_eq!((encoder_levels(1 << 27), encoder_levels(1 << 28)), (1, 2));
    }
}
