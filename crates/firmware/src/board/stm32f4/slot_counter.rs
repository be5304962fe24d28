//! The count of the slots that have begun: TIM1 clocks TIM2 with its compare output, which rises at the begin of every
//! slot (RM0090, 17.4.2 and 18.3.15; RM0368, 12.4.2 and 13.3.15).
//!
//! Invariant: it is started before the first slot and never stopped, so that it is the number of words that the DMA has
//! written to the port, up to the time of one transfer. It wraps at 32 bits.
//!
//! A compare output and not the update itself: on an F405 TIM1 has twice the clock of TIM2, which could miss the short
//! pulse of an update.

use super::registers::{rcc, tim1, tim2};

/// Starts it, before TIM1 is. `slot_ticks`: ticks of TIM1 in a slot.
pub(super) fn start(slot_ticks: u32) {
    tim1().ccr1().write(|w| w.ccr().set((slot_ticks / 2) as u16));
    tim1().ccmr1_output().write(|w| w.oc1m().pwm_mode1());
    tim1().cr2().write(|w| w.mms().compare_oc1());
    rcc().apb1enr().modify(|_, w| w.tim2en().enabled());
    // a clock is there some cycles after it was enabled (erratum of these chips): a read takes that long
    let _ = rcc().apb1enr().read();
    tim2().smcr().write(|w| w.ts().itr0().sms().ext_clock_mode());
    tim2().arr().write(|w| w.arr().set(u32::MAX));
    tim2().cnt().write(|w| w.cnt().set(0));
    tim2().cr1().write(|w| w.cen().enabled());
}

/// Returns the number of slots that have begun.
pub(super) fn count() -> u32 {
    tim2().cnt().read().cnt().bits()
}
