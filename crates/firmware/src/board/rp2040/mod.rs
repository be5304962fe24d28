//! The board of a Raspberry Pi Pico or Pico 2: one file per peripheral, and one per chip with what differs.
//!
//! Invariant: each register is written by one context only, the main loop or one interrupt, after [`Board::start`].
//! Steps are made without an interrupt.

#[cfg_attr(feature = "rp2040", path = "chip_rp2040.rs")]
#[cfg_attr(feature = "rp2350", path = "chip_rp2350.rs")]
mod chip;
mod clock;
mod encoder;
mod frequency_input;
mod line;
mod ports;
mod probe_input;
mod registers;
mod sample_ring;
mod serial;
mod spindle_input;
mod spindle_pwm;
mod step_generator;
#[cfg_attr(feature = "rp2040", path = "unique_number_rp2040.rs")]
#[cfg_attr(feature = "rp2350", path = "unique_number_rp2350.rs")]
mod unique_number;
mod usb_line;
mod watchdog;

use retrace_card::spindle_pwm::PwmSignal;
use retrace_card::{AwaitedProbe, EncoderReading, ProbeReading};
use retrace_firmware::rp2040::IDENTITY;
use retrace_firmware::rp2040::frequency::FrequencyMeter;
use retrace_firmware::step_batch::StepBatch;
use retrace_firmware::{AXES, boot};
use retrace_link::{ANALOG_INPUTS, AnalogInputs, CardIdentity, Outputs};

use super::{Board, stopwatch};
use line::Line;
use probe_input::ProbeInput;
use spindle_input::SpindleInput;
use spindle_pwm::SpindlePwm;
use step_generator::StepGenerator;

/// A Raspberry Pi Pico or Pico 2.
pub(crate) struct Rp2040 {
    steps: StepGenerator,
    probe: ProbeInput,
    spindle: SpindleInput,
    line: Line,
    spindle_pwm: SpindlePwm,
    frequency: FrequencyMeter,
    unique_number: [u32; 3],
}

impl Board for Rp2040 {
    const IDENTITY: CardIdentity = IDENTITY;

    fn start() -> Self {
        registers::use_vector_table_in_ram();
        clock::start();
        ports::start();
        stopwatch::start();
        let probe = ProbeInput::start();
        let steps = StepGenerator::start();
        watchdog::start();
        encoder::start();
        let spindle_pwm = SpindlePwm::start();
        frequency_input::start();
        let unique_number = unique_number::read();
        let line = Line::start(unique_number.map(boot::serial_number));
        let unique_number = unique_number.unwrap_or_default();
        let (spindle, frequency) = (SpindleInput::new(), FrequencyMeter::new());
        Self { steps, probe, spindle, line, spindle_pwm, frequency, unique_number }
    }

    fn set_all_low() {
        StepGenerator::stop();
        ports::set_all_low();
        watchdog::stop();
    }

    fn count_start(&mut self) -> u32 {
        // the count does not survive a loss of power; the ring oscillator's noise makes starts differ then
        let noise = (0..32).fold(0, |bits, _| bits << 1 | registers::RANDOM_BIT.read() & 1);
        watchdog::count_start() ^ noise
    }

    fn unique_number(&self) -> [u32; 3] {
        self.unique_number
    }

    fn line_is_silent(&mut self) -> bool {
        self.line.is_silent()
    }

    fn receive(&mut self) -> Option<u8> {
        self.line.receive()
    }

    fn can_send(&mut self) -> bool {
        self.line.can_send()
    }

    fn send(&mut self, byte: u8) {
        self.line.send(byte);
    }

    fn can_put_steps(&mut self) -> bool {
        self.steps.can_put()
    }

    fn put_steps(&mut self, batch: &StepBatch<AXES>) {
        self.steps.put(batch);
    }

    fn input_levels(&self) -> u16 {
        ports::input_levels() | self.spindle.taken_inputs()
    }

    fn read_probe(&mut self, levels: u16) -> (u16, ProbeReading) {
        self.probe.read(levels, &self.steps)
    }

    fn await_probe(&mut self, awaited: Option<AwaitedProbe>) {
        self.probe.await_edge(awaited);
    }

    fn read_spindle(&mut self, is_used: bool) -> EncoderReading {
        self.spindle.read(is_used, &mut self.steps)
    }

    fn analog_inputs(&mut self) -> AnalogInputs {
        let mut inputs = [None; ANALOG_INPUTS];
        inputs[0] = self.frequency.measure(frequency_input::edges(), stopwatch::now());
        inputs[1] = self.line.module_reading();
        inputs
    }

    fn encoder(&self) -> u16 {
        encoder::count()
    }

    fn set_outputs(&mut self, outputs: &Outputs) {
        ports::set_outputs(outputs);
    }

    fn set_spindle_pwm(&mut self, signal: Option<PwmSignal>) {
        self.spindle_pwm.set(signal);
    }

    fn cycles(&self) -> u32 {
        stopwatch::now()
    }

    fn feed_watchdog(&mut self) {
        watchdog::feed();
    }
}
