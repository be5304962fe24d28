//! Count of starts that survives a reset, and a power cut if a battery is fitted (RM0090, 26.3.14 *RTC backup
//! registers*).
//!
//! Invariant: the chip starts whether or not the count could be stored.

use super::registers::{pwr, rcc, rtc};

/// Counts a start and returns the number of starts since the backup domain last lost its supply. QEMU always returns 0.
pub(crate) fn count_start() -> u32 {
    rcc().apb1enr().modify(|_, w| w.pwren().enabled());
    pwr().cr().modify(|_, w| w.dbp().set_bit());
    let count = rtc().bkpr(0).read().bkp().bits().wrapping_add(1);
    rtc().bkpr(0).write(|w| w.bkp().set(count));
    rtc().bkpr(0).read().bkp().bits()
}
