//! The main loop, and the end of everything where something is wrong with the firmware itself.
//!
//! Invariant: an order is computed only when there is room for it, so that none is ever lost; being late stretches time, not the path.

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

/// Bytes that are fetched from the card at a time.
const CHUNK: usize = 64;

type Card = LinkedCard<AXES, WINDOW, MEMORY, ENTRIES, &'static mut [Record<AXES>]>;

/// As a constant, so that it never passes over the stack. Its window's records stand apart: they are zeros, which need no flash.
const FRESH: Card = match Card::without_records(boot::IDENTITY) {
    Some(card) => card,
    None => unreachable!(),
};

#[cortex_m_rt::entry]
fn main() -> ! {
    static mut CARD: Card = FRESH;
    static mut RECORDS: [Record<AXES>; WINDOW] = [Record::STILL; WINDOW];
    CARD.lend(RECORDS);
    board::start();
    let starts = board::count_start();
    DIAGNOSTICS.begin();
    // Before the host has spoken there is nothing to do, and when it speaks makes the number of this start.
    while serial::is_silent() {}
    let boot = boot::boot_number(starts, stopwatch::now());
    let serial_number = boot::serial_number(registers::unique_number());
    CARD.name(serial_number, boot);
    let mut shape = Steps::SHAPE;
    let mut sender = Sender { bytes: [0; CHUNK], at: 0, end: 0 };
    loop {
        while let Some(byte) = serial::receive() {
            CARD.receive(byte);
        }
        if ORDERS.is_free() {
            period(CARD, &mut shape);
        }
        sender.send(CARD);
    }
}

/// Computes a control period and orders its pulses. Where an opening has changed how steps are made, a period without any goes ahead of
/// it, so that the directions stand.
fn period(card: &mut Card, shape: &mut StepShape) {
    if let Some(wanted) = card.terms().map(|terms| shape_of(terms.settings()))
        && wanted != *shape
    {
        *shape = wanted;
        ORDERS.put(&StepBatch { increments: [0; AXES], shape: wanted });
        return;
    }
    let (began, interrupts) = (stopwatch::now(), DIAGNOSTICS.in_interrupts());
    let inputs = InputLevels { levels: board::input_levels(), encoder: board::encoder(), failed: false };
    let status = card.period(inputs);
    board::set_outputs(&status.outputs);
    ORDERS.put(&StepBatch { increments: *card.card().pulses(), shape: *shape });
    let interrupted = DIAGNOSTICS.in_interrupts().wrapping_sub(interrupts);
    DIAGNOSTICS.max_period.fetch_max(stopwatch::since(began).saturating_sub(interrupted), Relaxed);
    DIAGNOSTICS.periods.fetch_add(1, Relaxed);
}

/// How the host wants steps to be made.
fn shape_of(settings: &CardSettings<AXES>) -> StepShape {
    StepShape {
        period_us: settings.period_us,
        pulse_ns: settings.pulse_ns,
        setup_ns: settings.direction_setup_ns,
        inverted: settings.direction_inverted,
    }
}

/// What the card wants to say, on its way to the transmitter.
struct Sender {
    bytes: [u8; CHUNK],
    at: usize,
    end: usize,
}

impl Sender {
    /// Hands one byte on, if there is one and the transmitter has room.
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

/// Stops for good: no interrupt, no step, every output low. Only a reset leads out of here, after which the host finds a card that was
/// started anew.
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
