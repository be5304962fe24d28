//! The main loop, and the end of everything where something is wrong with the firmware itself.
//!
//! Invariant: an order is computed only when there is room for it, so that none is ever lost; being late stretches time, not the path.

use core::sync::atomic::Ordering::Relaxed;

use retrace_firmware::handover::Order;
use retrace_firmware::on_line::{Inputs, OnLine};
use retrace_firmware::period::{Period, slots_of_ns};
use retrace_firmware::pins::{ALL_OUTPUTS_LOW, ALL_STEPS_LOW};
use retrace_firmware::{AXES, MEMORY, WINDOW, boot};

use crate::board::step_timer::{ORDERS, TIMER_HZ};
use crate::board::{self, registers, serial, stopwatch};
use crate::diagnostics::DIAGNOSTICS;

/// Bytes that are fetched from the card at a time.
const CHUNK: usize = 64;

type Card = OnLine<AXES, WINDOW, MEMORY>;

#[cortex_m_rt::entry]
fn main() -> ! {
    static mut CARD: Option<Card> = None;
    board::start();
    let starts = board::count_start();
    DIAGNOSTICS.begin();
    // Before the host has spoken there is nothing to do, and when it speaks makes the number of this start.
    while serial::is_silent() {}
    let boot = boot::boot_number(starts, stopwatch::now());
    let serial_number = boot::serial_number(registers::unique_number());
    let card = CARD.insert(Card::new(boot::identity(serial_number, boot)));
    let mut sender = Sender { bytes: [0; CHUNK], at: 0, end: 0 };
    loop {
        while let Some(byte) = serial::receive() {
            card.receive(byte);
        }
        if ORDERS.is_free() {
            period(card);
        }
        sender.send(card);
    }
}

/// Computes a control period and orders its pulses.
fn period(card: &mut Card) {
    let (began, interrupts) = (stopwatch::now(), DIAGNOSTICS.in_interrupts());
    let status = card.period(Inputs { levels: board::input_levels(), encoder: board::encoder() });
    let increments = status.increments;
    board::set_outputs(&status.outputs);
    let settings = card.settings();
    let order = Order {
        increments,
        period: Period::new(settings.period_us, TIMER_HZ),
        pulse_slots: slots_of_ns(settings.pulse_ns),
        setup_slots: slots_of_ns(settings.direction_setup_ns),
        inverted: settings.direction_inverted,
    };
    ORDERS.put(&order);
    let interrupted = DIAGNOSTICS.in_interrupts().wrapping_sub(interrupts);
    DIAGNOSTICS.longest_period.fetch_max(stopwatch::since(began).saturating_sub(interrupted), Relaxed);
    DIAGNOSTICS.periods.fetch_add(1, Relaxed);
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
