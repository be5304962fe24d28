//! A count of starts that outlives a reset, and a power cut where a battery is fitted (RM0090, 26.3.14 *RTC backup registers*).
//!
//! Invariant: the chip starts whether or not the count could be kept.

use super::registers::{pwr, rcc, rtc};

/// One more start: how many there were since the backup domain last lost its supply. QEMU always says 0.
pub(crate) fn count_start() -> u32 {
    rcc().apb1enr().modify(|_, w| w.pwren().enabled());
    pwr().cr().modify(|_, w| w.dbp().set_bit());
    let count = rtc().bkpr(0).read().bkp().bits().wrapping_add(1);
    rtc().bkpr(0).write(|w| w.bkp().set(count));
    rtc().bkpr(0).read().bkp().bits()
}
