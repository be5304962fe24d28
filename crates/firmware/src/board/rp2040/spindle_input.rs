//! The spindle's encoder: a state machine samples A, B and index each microsecond, and the DMA puts the samples into a
//! ring; the control period decodes what has come since the last one.
//!
//! Invariant: the samples are numbered by the timer, which has the same crystal: where their number is not that of the
//! words in the ring, the reading is an error. Without an encoder in the settings nothing is decoded.

use retrace_card::EncoderReading;
use retrace_firmware::rp2040::CLOCK_HZ;
use retrace_firmware::rp2040::pins::{FIRST_SPINDLE_PIN, SPINDLE_INPUTS};
use retrace_firmware::rp2040::pio_programs::{SAMPLE, SAMPLE_AT};
use retrace_firmware::rp2040::spindle_decoder::{SAMPLES_HZ, SampledPeriod, SpindleDecoder};

use super::registers::{Pio, TIMER_NOW};
use super::sample_ring;
use super::step_generator::StepGenerator;

/// The machine of [`Pio::Frame`] that samples.
const MACHINE: usize = 2;
/// How it shifts: to the right, and each 32 bits into its queue, which has room for eight words.
const TO_QUEUE: u32 = 1 << 31 | 1 << 18 | 1 << 16;
/// Reads of the timer until the last samples of a period are in the ring: more than 10 µs.
const PATIENCE: usize = 500;

/// The encoder of the spindle.
pub(super) struct SpindleInput {
    /// Microsecond of the first sample; `None` before it.
    began_us: Option<u32>,
    decoder: Option<SpindleDecoder>,
}

impl SpindleInput {
    /// Creates one that samples nothing.
    pub(super) const fn new() -> Self {
        Self { began_us: None, decoder: None }
    }

    /// Returns the inputs that are the encoder's, one bit each: they read as open contacts meanwhile, since each change
    /// of an input is reported.
    pub(super) const fn taken_inputs(&self) -> u16 {
        if self.decoder.is_some() { (1 << SPINDLE_INPUTS) - 1 } else { 0 }
    }

    /// Reads the control period that has ended. `is_used`: the settings have an encoder.
    pub(super) fn read(&mut self, is_used: bool, steps: &mut StepGenerator) -> EncoderReading {
        if !is_used {
            self.decoder = None;
            return EncoderReading::default();
        }
        let began_us = *self.began_us.get_or_insert_with(start);
        let (end_us, period_us) = steps.begun_us();
        let end = end_us.wrapping_sub(began_us);
        let Some(decoder) = &mut self.decoder else {
            self.decoder = Some(SpindleDecoder::new(end));
            return EncoderReading::default();
        };
        let taken = || TIMER_NOW.read().wrapping_sub(began_us).wrapping_add(1);
        let until = SampledPeriod::written_once_taken(end);
        let _ = (0..PATIENCE).find(|_| taken().wrapping_sub(until) < u32::MAX / 2);
        let next_word = sample_ring::next_word();
        decoder.read(&SampledPeriod { end, taken: taken(), next_word, period_us }, sample_ring::word)
    }
}

/// Starts the samples, and returns the microsecond of the first one. They never end.
fn start() -> u32 {
    Pio::Frame.instruction(SAMPLE_AT).write(u32::from(SAMPLE));
    Pio::Frame.divider(MACHINE).write(CLOCK_HZ / SAMPLES_HZ << 16);
    Pio::Frame.execution(MACHINE).write((SAMPLE_AT as u32) << 12 | (SAMPLE_AT as u32) << 7);
    Pio::Frame.shifting(MACHINE).write(TO_QUEUE);
    Pio::Frame.pins(MACHINE).write(u32::from(FIRST_SPINDLE_PIN) << 15);
    Pio::Frame.execute(MACHINE).write(SAMPLE_AT as u32);
    sample_ring::start(MACHINE);
    let began_us = TIMER_NOW.read();
    Pio::Frame.control().set_bits(1 << MACHINE | 1 << (4 + MACHINE) | 1 << (8 + MACHINE));
    began_us
}
