//! The serial line: USART1 on PA9 and PA10, 8N1 (RM0090, 30; RM0368, 19).
//!
//! Invariant: nothing here waits. A byte that comes while the ring is full is dropped and counted; the frames' checksums notice it.

use core::sync::atomic::Ordering::Relaxed;

use retrace_firmware::ring::ByteRing;

use super::chip::{self, interrupt};
use super::registers::{rcc, set_priority, unmask, usart1};
use crate::diagnostics::DIAGNOSTICS;

/// Bits a second.
pub(crate) const BAUD: u32 = 1_000_000;
/// Bytes that wait for the main loop: 10 ms at 1 Mbaud.
const ROOM: usize = 1024;

static RECEIVED: ByteRing<ROOM> = ByteRing::new();

/// Sets the line up; its pins are set by the ports.
pub(super) fn start() {
    rcc().apb2enr().modify(|_, w| w.usart1en().enabled());
    // oversampling by 16: the register is the divider in sixteenths, so their product with 16 is the plain ratio
    let ratio = super::clock::RATES.serial / BAUD;
    usart1().brr().write(|w| w.div_mantissa().set((ratio / 16) as u16).div_fraction().set((ratio % 16) as u8));
    usart1().cr1().write(|w| w.ue().enabled().te().enabled().re().enabled().rxneie().enabled());
    set_priority(chip::Interrupt::USART1, 1);
    unmask(chip::Interrupt::USART1);
}

/// The next byte that came.
pub(crate) fn receive() -> Option<u8> {
    RECEIVED.pop()
}

/// Has no byte come that was not fetched?
pub(crate) fn is_silent() -> bool {
    RECEIVED.is_empty()
}

/// Is there room for a byte in the transmitter?
pub(crate) fn can_send() -> bool {
    usart1().sr().read().txe().bit()
}

/// Hands a byte to the transmitter, which has room for one where [`can_send`] says so.
pub(crate) fn send(byte: u8) {
    usart1().dr().write(|w| w.dr().set(u16::from(byte)));
}

/// A byte has come, or one was overrun. Reading status and then data clears both.
#[chip::interrupt]
fn USART1() {
    let status = usart1().sr().read();
    if status.ore().bit() {
        DIAGNOSTICS.lost_bytes.fetch_add(1, Relaxed);
    }
    if status.rxne().bit() || status.ore().bit() {
        let byte = usart1().dr().read().dr().bits() as u8;
        if status.rxne().bit() && !RECEIVED.push(byte) {
            DIAGNOSTICS.lost_bytes.fetch_add(1, Relaxed);
        }
    }
}
