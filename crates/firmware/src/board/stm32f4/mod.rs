//! The STM32F4 boards: one file per peripheral.
//!
//! Invariant: each register is written by one context only, the main loop or one interrupt, after [`Board::start`]; the
//! port registers that both write (bit set/reset) are written, never read and changed.

mod clock;
mod encoder;
mod ports;
mod registers;
mod serial;
mod starts;
mod step_dma;

use retrace_firmware::AXES;
use retrace_firmware::step_batch::StepBatch;
use retrace_firmware::stm32f4::IDENTITY;
use retrace_firmware::stm32f4::pins::{ALL_OUTPUTS_LOW, ALL_STEPS_LOW};
use retrace_link::{CardIdentity, Outputs};

use super::{Board, stopwatch};
use step_dma::ORDERS;

#[cfg(feature = "f401")]
use stm32f4::stm32f401 as chip;
#[cfg(feature = "f405")]
use stm32f4::stm32f405 as chip;
#[cfg(feature = "f411")]
use stm32f4::stm32f411 as chip;

/// A board with an STM32F4: its peripherals hold all of its state.
pub(crate) struct Stm32f4;

impl Board for Stm32f4 {
    const IDENTITY: CardIdentity = IDENTITY;

    fn start() -> Self {
        // if the crystal did not start, the internal oscillator is used instead
        let _ = clock::start();
        ports::start();
        stopwatch::start();
        encoder::start();
        serial::start();
        step_dma::start();
        Self
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
        serial::is_silent()
    }

    fn receive(&mut self) -> Option<u8> {
        serial::receive()
    }

    fn can_send(&mut self) -> bool {
        serial::can_send()
    }

    fn send(&mut self, byte: u8) {
        serial::send(byte);
    }

    fn can_put_steps(&mut self) -> bool {
        ORDERS.is_free()
    }

    fn put_steps(&mut self, batch: &StepBatch<AXES>) {
        ORDERS.put(batch);
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
