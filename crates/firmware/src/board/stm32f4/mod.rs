//! The STM32F4 boards: one file per peripheral.
//!
//! Invariant: each register is written by one context only, the main loop or one interrupt, after [`Board::start`]; the
//! port registers that both write (bit set/reset) are written, never read and changed.

mod clock;
mod encoder;
mod line;
mod microseconds;
mod ports;
#[cfg(not(feature = "qemu"))]
mod probe_input;
mod registers;
mod serial;
#[cfg(not(feature = "qemu"))]
mod slot_counter;
mod starts;
mod step_dma;

#[cfg(not(feature = "qemu"))]
use retrace_card::{AwaitedProbe, ProbeReading};
use retrace_firmware::step_batch::StepBatch;
use retrace_firmware::stm32f4::IDENTITY;
use retrace_firmware::stm32f4::pins::{ALL_OUTPUTS_LOW, ALL_STEPS_LOW};
use retrace_firmware::{AXES, boot};
use retrace_link::{CardIdentity, Outputs};

use super::{Board, stopwatch};
use line::Line;
use step_dma::ORDERS;

#[cfg(feature = "f401")]
use stm32f4::stm32f401 as chip;
#[cfg(feature = "f405")]
use stm32f4::stm32f405 as chip;
#[cfg(feature = "f411")]
use stm32f4::stm32f411 as chip;

/// A board with an STM32F4.
pub(crate) struct Stm32f4 {
    line: Line,
    /// QEMU has no timer that captures: there the board reads the probe once a control period.
    #[cfg(not(feature = "qemu"))]
    probe: probe_input::ProbeInput,
}

impl Board for Stm32f4 {
    const IDENTITY: CardIdentity = IDENTITY;

    fn start() -> Self {
        let has_crystal = clock::start();
        ports::start();
        stopwatch::start();
        encoder::start();
        step_dma::start();
        Self {
            line: Line::start(has_crystal, boot::serial_number(registers::unique_number())),
            #[cfg(not(feature = "qemu"))]
            probe: probe_input::ProbeInput::new(),
        }
    }

    fn set_all_low() {
        step_dma::stop();
        registers::set_port_a(ALL_STEPS_LOW);
        registers::set_port_b(ALL_OUTPUTS_LOW);
    }

    fn count_start(&mut self) -> u32 {
        starts::count_start()
    }

    fn unique_number(&self) -> [u32; 3] {
        registers::unique_number()
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

    #[cfg(feature = "qemu")]
    fn can_put_steps(&mut self) -> bool {
        ORDERS.is_free()
    }

    #[cfg(not(feature = "qemu"))]
    fn can_put_steps(&mut self) -> bool {
        ORDERS.is_free() && self.probe.may_compute(ORDERS.begins())
    }

    fn put_steps(&mut self, batch: &StepBatch<AXES>) {
        #[cfg(not(feature = "qemu"))]
        self.probe.put(ORDERS.begins(), &batch.shape);
        ORDERS.put(batch);
    }

    #[cfg(not(feature = "qemu"))]
    fn read_probe(&mut self, levels: u16) -> (u16, ProbeReading) {
        self.probe.read(levels, ORDERS.begins())
    }

    #[cfg(not(feature = "qemu"))]
    fn await_probe(&mut self, awaited: Option<AwaitedProbe>) {
        self.probe.await_edge(awaited);
    }

    fn input_levels(&self) -> u16 {
        ports::input_levels()
    }

    fn encoder(&self) -> u16 {
        encoder::encoder()
    }

    fn set_outputs(&mut self, outputs: &Outputs) {
        ports::set_outputs(outputs);
    }

    fn cycles(&self) -> u32 {
        stopwatch::now()
    }
}
