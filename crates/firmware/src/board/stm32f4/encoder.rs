//! The handwheel's encoder: TIM4 counts both edges of both channels by itself (RM0090, 18.3.12; RM0368, 13.3.12).
//!
//! Invariant: the count wraps at 16 bits; no code writes it.

use super::registers::{rcc, tim4};

/// Starts the counter.
pub(super) fn start() {
    rcc().apb1enr().modify(|_, w| w.tim4en().enabled());
    // both inputs through the longest filter of the timer's own clock, 8 samples: contacts bounce
    tim4().ccmr1_input().write(|w| w.cc1s().ti1().cc2s().ti2().ic1f().fdts_div32_n8().ic2f().set(15));
    tim4().smcr().write(|w| w.sms().encoder_mode_3());
    tim4().arr().write(|w| w.arr().set(0xffff));
    tim4().cr1().write(|w| w.cen().enabled());
}

/// Returns the count, four per period of the encoder's signal.
pub(crate) fn encoder() -> u16 {
    tim4().cnt().read().cnt().bits()
}
