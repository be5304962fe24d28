//! A clock of microseconds: TIM5, in QEMU TIM2 (RM0090, 18; RM0368, 13).
//!
//! Invariant: it wraps at 32 bits and is never set.

use super::registers::rcc;
#[cfg(feature = "qemu")]
use super::registers::tim2 as timer;
#[cfg(not(feature = "qemu"))]
use super::registers::tim5 as timer;

/// Starts it.
pub(super) fn start() {
    rcc().apb1enr().modify(|_, w| w.tim2en().enabled().tim5en().enabled());
    // a clock is there some cycles after it was enabled (erratum of these chips): a read takes that long
    let _ = rcc().apb1enr().read();
    timer().psc().write(|w| w.psc().set((super::clock::RATES.microsecond_timer / 1_000_000 - 1) as u16));
    timer().arr().write(|w| w.arr().set(u32::MAX));
    // the divider takes effect
    timer().egr().write(|w| w.ug().set_bit());
    timer().cr1().write(|w| w.cen().enabled());
}

/// Returns the microseconds since the start.
pub(super) fn now() -> u32 {
    timer().cnt().read().cnt().bits()
}
