//! The state machine that captures the edge of the probe, beside the one that begins the control periods.
//!
//! Invariant: it drives no pin and runs only while an edge is awaited. Its count of a period is read once the gate of
//! the next period is low again, so that none is read a period late.

use super::registers::Pio;
use super::step_generator::StepGenerator;
use retrace_card::{AwaitedProbe, ProbeReading};
use retrace_firmware::probe_capture::ProbeCapture;
use retrace_firmware::rp2040::edge_count::edge_part;
use retrace_firmware::rp2040::pins::{FIRST_INPUT_PIN, GATE_PIN};
use retrace_firmware::rp2040::pio_programs::{
    CAPTURE_FALLING, CAPTURE_FALLING_AT, CAPTURE_RISING, CAPTURE_RISING_AT, jump_to,
};

/// The machine of [`Pio::Frame`] that captures.
const MACHINE: usize = 1;
/// In the queues' state, by machine: the queue from it is empty.
const WORDS_EMPTY: u32 = 1 << 8;
/// Joins the queues, which empties them.
const JOINED: u32 = 1 << 31;

/// The input of the probe.
pub(super) struct ProbeInput {
    capture: ProbeCapture,
}

impl ProbeInput {
    /// Loads the programs; nothing is captured yet.
    pub(super) fn start() -> Self {
        for (at, program) in [(CAPTURE_RISING_AT, &CAPTURE_RISING), (CAPTURE_FALLING_AT, &CAPTURE_FALLING)] {
            for (n, &word) in program.iter().enumerate() {
                Pio::Frame.instruction(at + n).write(u32::from(word));
            }
        }
        Self { capture: ProbeCapture::new() }
    }

    /// Awaits this edge. The same one as before is awaited further.
    pub(super) fn await_edge(&mut self, awaited: Option<AwaitedProbe>) {
        if awaited == self.capture.awaited() {
            return;
        }
        self.capture.begin(awaited);
        Pio::Frame.control().clear_bits(1 << MACHINE);
        let Some(AwaitedProbe { input, is_high }) = awaited else { return };
        let from = if is_high { CAPTURE_RISING_AT } else { CAPTURE_FALLING_AT };
        let (first, last) = (from as u32, (from + CAPTURE_RISING.len() - 1) as u32);
        Pio::Frame.execution(MACHINE).write(u32::from(GATE_PIN) << 24 | last << 12 | first << 7);
        Pio::Frame.shifting(MACHINE).write(JOINED);
        Pio::Frame.shifting(MACHINE).write(0);
        Pio::Frame.pins(MACHINE).write(u32::from(FIRST_INPUT_PIN + input) << 15);
        Pio::Frame.control().set_bits(1 << (4 + MACHINE));
        Pio::Frame.execute(MACHINE).write(u32::from(jump_to(from as u16)));
        Pio::Frame.control().set_bits(1 << MACHINE);
    }

    /// Reads the probe. `levels`: those of the inputs, which are returned with that of the probe as far as it counts.
    pub(super) fn read(&mut self, levels: u16, steps: &StepGenerator) -> (u16, ProbeReading) {
        let is_awaited = self.capture.awaited().is_some();
        if is_awaited {
            StepGenerator::wait_behind_gate();
        }
        let is_there = is_awaited && !Pio::Frame.queue_status().has(WORDS_EMPTY << MACHINE);
        let (period, is_late) = steps.last_period();
        let edge = is_there.then(|| edge_part(Pio::Frame.words(MACHINE).read(), period, is_late));
        self.capture.read(levels, edge)
    }
}
