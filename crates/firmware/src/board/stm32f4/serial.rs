//! The serial line: USART1 on PA9 and PA10, 8N1 (RM0090, 30; RM0368, 19).
//!
//! Invariant: nothing here waits. A byte that arrives while the ring is full is dropped and counted; the frames'
//! checksums detect it.

use retrace_firmware::ring::ByteRing;

use super::chip::{self, interrupt};
use super::registers::{rcc, set_priority, unmask, usart1};
use crate::diagnostics::{DIAGNOSTICS, increment};

/// Baud rate, in bits per second.
pub(crate) const BAUD: u32 = 1_000_000;
/// Receive buffer, in bytes: 10 ms at 1 Mbaud.
const ROOM: usize = 1024;

static RECEIVED: ByteRing<ROOM> = ByteRing::new();

/// Starts the serial line; its pins are configured by the ports.
pub(super) fn start() {
    rcc().apb2enr().modify(|_, w| w.usart1en().enabled());
    // oversampling by 16: the register is the divider in sixteenths, so their product with 16 is the plain ratio
    let ratio = super::clock::RATES.serial / BAUD;
    usart1().brr().write(|w| w.div_mantissa().set((ratio / 16) as u16).div_fraction().set((ratio % 16) as u8));
    usart1().cr1().write(|w| w.ue().enabled().te().enabled().re().enabled().rxneie().enabled());
    // before the steps: the receiver has room for one byte, which is 10 µs
    set_priority(chip::Interrupt::USART1, 0);
    unmask(chip::Interrupt::USART1);
}

/// Returns the next received byte.
pub(crate) fn receive() -> Option<u8> {
    RECEIVED.pop()
}

/// Whether no received byte is waiting.
pub(crate) fn is_silent() -> bool {
    RECEIVED.is_empty()
}

/// Whether the transmitter can accept a byte.
pub(crate) fn can_send() -> bool {
    usart1().sr().read().txe().bit()
}

/// Passes a byte to the transmitter, which can accept one if [`can_send`] returns true.
pub(crate) fn send(byte: u8) {
    usart1().dr().write(|w| w.dr().set(u16::from(byte)));
}

/// Handles a received byte or an overrun. Reading status and then data clears both.
#[chip::interrupt]
fn USART1() {
    let status = usart1().sr().read();
    if status.ore().bit() {
        increment(&DIAGNOSTICS.lost_bytes);
    }
    if status.rxne().bit() || status.ore().bit() {
        let byte = usart1().dr().read().dr().bits() as u8;
        if status.rxne().bit() && !RECEIVED.push(byte) {
            increment(&DIAGNOSTICS.lost_bytes);
        }
        #[cfg(feature = "qemu")]
        bit_rate::byte_received();
    }
}

/// The bit rate of QEMU's line, which has none: a host that is ahead of the emulated time could send any number of
/// bytes at once.
#[cfg(feature = "qemu")]
pub(super) mod bit_rate {
    use core::sync::atomic::{AtomicU32, Ordering};

    use super::{BAUD, usart1};

    /// Bytes of ten bits that the line brings while a step buffer of 250 µs is played.
    const BYTES: u32 = BAUD / 10 / 4000;

    static RECEIVED: AtomicU32 = AtomicU32::new(0);

    /// A byte was received: behind the last one for this time, the next one waits in QEMU.
    pub(super) fn byte_received() {
        let received = RECEIVED.load(Ordering::Relaxed) + 1;
        RECEIVED.store(received, Ordering::Relaxed);
        if received >= BYTES {
            usart1().cr1().modify(|_, w| w.rxneie().disabled());
        }
    }

    /// Another step buffer is played.
    pub(in super::super) fn buffer_played() {
        RECEIVED.store(0, Ordering::Relaxed);
        usart1().cr1().modify(|_, w| w.rxneie().enabled());
    }
}
