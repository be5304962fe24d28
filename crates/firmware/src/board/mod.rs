//! The hardware: one file per peripheral. Compiled for the microcontroller only.
//!
//! Invariant: each register is written by one context only, the main loop or one interrupt, after [`start`]; the port
//! registers that both write (bit set/reset) are written, never read and changed.

mod clock;
mod encoder;
mod ports;
pub(crate) mod registers;
pub(crate) mod serial;
mod starts;
pub(crate) mod step_timer;
pub(crate) mod stopwatch;

pub(crate) use encoder::encoder;
pub(crate) use ports::{input_levels, set_outputs};
pub(crate) use starts::count_start;

#[cfg(feature = "f401")]
pub(crate) use stm32f4::stm32f401 as chip;
#[cfg(feature = "f405")]
pub(crate) use stm32f4::stm32f405 as chip;
#[cfg(feature = "f411")]
pub(crate) use stm32f4::stm32f411 as chip;

/// Starts the clocks, the ports and the timers. Returns false if the crystal did not start and the internal oscillator
/// is used instead.
pub(crate) fn start() -> bool {
    let crystal = clock::start();
    ports::start();
    stopwatch::start();
    encoder::start();
    serial::start();
    step_timer::start();
    crystal
}
