//! The interface between the main loop and a board, and the board of this image.
//!
//! Invariant: the main loop reaches the hardware through [`Board`] alone; nothing above this folder depends on the
//! microcontroller.

use retrace_card::spindle_pwm::PwmSignal;
use retrace_card::{AwaitedProbe, EncoderReading, ProbeReading};
use retrace_firmware::AXES;
use retrace_firmware::step_batch::StepBatch;
use retrace_link::{ANALOG_INPUTS, AnalogInputs, CardIdentity, Outputs};

mod processor;
pub(crate) mod stopwatch;

#[cfg(feature = "pico")]
mod rp2040;
#[cfg(not(feature = "pico"))]
mod stm32f4;

#[cfg(feature = "pico")]
pub(crate) use rp2040::Rp2040 as ThisBoard;
#[cfg(not(feature = "pico"))]
pub(crate) use stm32f4::Stm32f4 as ThisBoard;

/// What the main loop needs of a board: a line, a step generator, outputs, inputs, and a few facts about the chip.
/// Nothing in it waits, except [`Board::start`], whose waits are bounded.
pub(crate) trait Board {
    /// Identity of the card before it has a serial number and the number of a start.
    const IDENTITY: CardIdentity;

    /// Starts the clocks, the pins and the peripherals: steps and outputs are low, and nothing moves.
    fn start() -> Self;

    /// Sets all steps and outputs low and ends everything that could raise them. For a defect of the firmware itself:
    /// only a reset ends this state.
    fn set_all_low();

    /// Counts a start and returns a number that differs from that of the last start where the chip can tell.
    fn count_start(&mut self) -> u32;

    /// Returns the chip's unique number; zeros if it has none.
    fn unique_number(&self) -> [u32; 3];

    /// Whether no received byte is waiting.
    fn line_is_silent(&mut self) -> bool;

    /// Returns the next received byte.
    fn receive(&mut self) -> Option<u8>;

    /// Whether the transmitter can accept a byte.
    fn can_send(&mut self) -> bool;

    /// Passes a byte to the transmitter, which can accept one if [`Board::can_send`] returns true.
    fn send(&mut self, byte: u8);

    /// Whether the step generator can accept the batch of the next control period.
    fn can_put_steps(&mut self) -> bool;

    /// Passes the batch of the next control period to the step generator, which can accept one if
    /// [`Board::can_put_steps`] returns true.
    fn put_steps(&mut self, batch: &StepBatch<AXES>);

    /// Returns the levels of the inputs, one bit each.
    fn input_levels(&self) -> u16;

    /// Returns the levels of the inputs, with that of the probe as far as it counts, and what is read of the probe.
    /// Every board plays a control period while the next one is computed. One that does not capture the edge takes it
    /// to be at the end of the period.
    fn read_probe(&mut self, levels: u16) -> (u16, ProbeReading) {
        (levels, ProbeReading { first_change: None, is_period_behind: true })
    }

    /// Captures this edge from now on, where the board can.
    fn await_probe(&mut self, _awaited: Option<AwaitedProbe>) {}

    /// Reads what the encoder of the spindle has shown in the control period that has ended, once in each. `is_used`:
    /// the settings have an encoder. A board that reads none has nothing to do: the card refuses such settings.
    fn read_spindle(&mut self, _is_used: bool) -> EncoderReading {
        EncoderReading::default()
    }

    /// Returns the readings of the analog inputs, once in a control period; a board without any has none.
    fn analog_inputs(&mut self) -> AnalogInputs {
        [None; ANALOG_INPUTS]
    }

    /// Returns the count of the handwheel's encoder, four per period of its signal; it wraps around.
    fn encoder(&self) -> u16;

    /// Switches the outputs.
    fn set_outputs(&mut self, outputs: &Outputs);

    /// Sets the output for S; `None` is low. A board without this output has nothing to do: the card refuses settings
    /// with it.
    fn set_spindle_pwm(&mut self, _signal: Option<PwmSignal>) {}

    /// Returns the processor's cycles since an arbitrary moment, modulo 2²⁴.
    fn cycles(&self) -> u32;

    /// Shows the chip's watchdog, if the board has one, that the main loop runs.
    fn feed_watchdog(&mut self) {}
}
