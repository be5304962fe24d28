//! The main loop, and the halt after a defect of the firmware itself.
//!
//! Invariant: a step batch is computed only when there is space for it, so that none is ever lost; a delay stretches
//! time, not the path.

use core::sync::atomic::Ordering::Relaxed;

use retrace_card::{InputLevels, LinkedCard};
use retrace_core::Record;
use retrace_firmware::pins::{ALL_OUTPUTS_LOW, ALL_STEPS_LOW};
use retrace_firmware::step_mailbox::{StepBatch, StepShape};
use retrace_firmware::steps::Steps;
use retrace_firmware::{AXES, ENTRIES, MEMORY, WINDOW, boot};
use retrace_link::CardSettings;

use crate::board::step_timer::ORDERS;
use crate::board::{self, registers, serial, stopwatch};
use crate::diagnostics::DIAGNOSTICS;

/// Number of bytes fetched from the card at a time.
const CHUNK: usize = 64;

type Card = LinkedCard<AXES, WINDOW, MEMORY, ENTRIES, &'static mut [Record<AXES>]>;

/// The initial card. It is a constant so that it never passes over the stack. The records of its window are stored
/// separately: they are zeros, which need no flash.
const FRESH: Card = match Card::without_records(boot::IDENTITY) {
    Some(card) => card,
    None => unreachable!(),
};

#[cortex_m_rt::entry]
fn main() -> ! {
    static mut CARD: Card = FRESH;
    static mut RECORDS: [Record<AXES>; WINDOW] = [Record::ZERO; WINDOW];
    CARD.lend_records(RECORDS);
    board::start();
    let starts = board::count_start();
    DIAGNOSTICS.mark_valid();
    // Nothing is to be done before the first byte from the host; its arrival time makes the number of this start.
    while serial::is_silent() {}
    let boot = boot::boot_number(starts, stopwatch::now());
    let serial_number = boot::serial_number(registers::unique_number());
    CARD.set_identity(serial_number, boot);
    let mut shape = Steps::SHAPE;
    let mut sender = Sender { bytes: [0; CHUNK], at: 0, end: 0 };
    loop {
        while let Some(byte) = serial::receive() {
            CARD.receive(byte);
        }
        if ORDERS.is_free() {
            run_period(CARD, &mut shape);
        }
        sender.send(CARD);
    }
}

/// Computes a control period and puts its step batch. If an opening has changed the step timing, a period without
/// pulses precedes it, so that the directions are stable.
fn run_period(card: &mut Card, shape: &mut StepShape) {
    if let Some(wanted) = card.settings().map(|settings| shape_of(settings.settings()))
        && wanted != *shape
    {
        *shape = wanted;
        ORDERS.put(&StepBatch { increments: [0; AXES], shape: wanted });
        return;
    }
    let (began, interrupts) = (stopwatch::now(), DIAGNOSTICS.interrupt_cycles());
    let inputs = InputLevels { levels: board::input_levels(), encoder: board::encoder(), failed: false };
    let status = card.run_period(inputs);
    board::set_outputs(&status.outputs);
    ORDERS.put(&StepBatch { increments: *card.card().pulses(), shape: *shape });
    let interrupted = DIAGNOSTICS.interrupt_cycles().wrapping_sub(interrupts);
    DIAGNOSTICS.max_period.fetch_max(stopwatch::since(began).saturating_sub(interrupted), Relaxed);
    DIAGNOSTICS.periods.fetch_add(1, Relaxed);
}

/// Returns the step shape for the host's settings.
fn shape_of(settings: &CardSettings<AXES>) -> StepShape {
    StepShape {
        period_us: settings.period_us,
        pulse_ns: settings.pulse_ns,
        setup_ns: settings.direction_setup_ns,
        inverted: settings.direction_inverted,
    }
}

/// Bytes of the card that wait for the transmitter.
struct Sender {
    bytes: [u8; CHUNK],
    at: usize,
    end: usize,
}

impl Sender {
    /// Sends one byte, if one is available and the transmitter is ready.
    fn send(&mut self, card: &mut Card) {
        if self.at == self.end {
            (self.at, self.end) = (0, card.transmit(&mut self.bytes).min(CHUNK));
        }
        if self.at < self.end && serial::can_send() {
            serial::send(self.bytes[self.at]);
            self.at += 1;
        }
    }
}

/// Halts the firmware: no interrupt, no step, every output low. Only a reset ends this state; the host then finds a
/// restarted card.
pub(crate) fn halt() -> ! {
    cortex_m::interrupt::disable();
    registers::set_port_a(ALL_STEPS_LOW);
    registers::set_port_b(ALL_OUTPUTS_LOW);
    loop {
        cortex_m::asm::nop();
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    halt()
}
