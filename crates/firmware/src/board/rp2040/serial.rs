//! The serial line: UART0 on GP0 and GP1, 8N1 (RP2040 data sheet, 4.2).
//!
//! Invariant: nothing here waits. A byte that arrives while the ring is full is dropped and counted; the frames'
//! checksums detect it.

use super::chip::UART_INTERRUPT;
use super::registers::{
    UART_CONTROL, UART_DATA, UART_DIVISOR, UART_FLAGS, UART_FRACTION, UART_INTERRUPT_CLEAR, UART_INTERRUPT_MASK,
    UART_LEVELS, UART_LINE, enable_interrupt,
};
use crate::diagnostics::{DIAGNOSTICS, increment};
use retrace_firmware::ring::ByteRing;
use retrace_firmware::rp2040::CLOCK_HZ;

/// Baud rate, in bits per second.
const BAUD: u32 = 1_000_000;
/// The divider in sixty-fourths, of 16 samples a bit: exact.
const DIVIDER: u32 = CLOCK_HZ / BAUD * 64 / 16;
const _: () = assert!(CLOCK_HZ % BAUD == 0 && CLOCK_HZ / BAUD * 64 % 16 == 0);
/// Receive buffer, in bytes: 10 ms at 1 Mbaud.
const ROOM: usize = 1024;
/// The receiver's queue is empty; the transmitter's is full.
const NOTHING_RECEIVED: u32 = 1 << 4;
const TRANSMITTER_FULL: u32 = 1 << 5;
/// Interrupts: the receiver's queue has reached its level, or a byte in it has waited for the time of 32 bits.
const RECEIVED: u32 = 1 << 4 | 1 << 6;
/// In the data register: bytes before this one were lost.
const OVERRUN: u32 = 1 << 11;

static RING: ByteRing<ROOM> = ByteRing::new();

/// Interrupt of the timer's first alarm.
const TIMER_ALARM_INTERRUPT: u8 = 0;

/// Starts the serial line; its pins are configured by the ports. The interrupts of the encoder are enabled with it.
pub(super) fn start() {
    UART_DIVISOR.write(DIVIDER / 64);
    UART_FRACTION.write(DIVIDER % 64);
    // 8 bits, with queues; a write to this register also makes the divider valid
    UART_LINE.write(0b11 << 5 | 1 << 4);
    // an interrupt from a quarter of the receiver's 32 bytes on
    UART_LEVELS.write(1 << 3);
    UART_INTERRUPT_MASK.write(RECEIVED);
    UART_CONTROL.write(1 | 1 << 8 | 1 << 9);
    enable_interrupt(UART_INTERRUPT);
    enable_interrupt(TIMER_ALARM_INTERRUPT);
}

/// Returns the next received byte.
pub(super) fn receive() -> Option<u8> {
    RING.pop()
}

/// Whether no received byte is waiting.
pub(super) fn is_silent() -> bool {
    RING.is_empty()
}

/// Whether the transmitter can accept a byte.
pub(super) fn can_send() -> bool {
    !UART_FLAGS.has(TRANSMITTER_FULL)
}

/// Passes a byte to the transmitter, which can accept one if [`can_send`] returns true.
pub(super) fn send(byte: u8) {
    UART_DATA.write(u32::from(byte));
}

/// Handles received bytes: the interrupt of UART0.
pub(super) fn take_received() {
    UART_INTERRUPT_CLEAR.write(RECEIVED);
    while !UART_FLAGS.has(NOTHING_RECEIVED) {
        let data = UART_DATA.read();
        if data & OVERRUN != 0 || !RING.push(data as u8) {
            increment(&DIAGNOSTICS.lost_bytes);
        }
    }
}
