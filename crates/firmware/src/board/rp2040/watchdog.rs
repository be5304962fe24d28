//! The chip's watchdog (RP2040 data sheet, 4.7): a main loop that does not run any more resets the chip.
//!
//! Invariant: its reset is that of the whole chip: every pin becomes an input with a pull-down.

use super::chip::{WATCHDOG_COUNTS_PER_US, WHOLE_CHIP};
use super::registers::{POWER_WATCHDOG_SELECT, WATCHDOG_CONTROL, WATCHDOG_LOAD, WATCHDOG_SCRATCH, start_ticks};

/// Time without a sign of the main loop after which the chip is reset, in microseconds: longer than the longest
/// computation, which is that of the braking tables at an opening.
const TIMEOUT_US: u32 = 50_000;
const COUNT: u32 = WATCHDOG_COUNTS_PER_US * TIMEOUT_US;
const ENABLE: u32 = 1 << 30;

/// Starts the ticks of a microsecond, which the timer needs too, and the watchdog.
pub(super) fn start() {
    WATCHDOG_CONTROL.clear_bits(ENABLE);
    start_ticks();
    POWER_WATCHDOG_SELECT.write(WHOLE_CHIP);
    feed();
    WATCHDOG_CONTROL.set_bits(ENABLE);
}

/// Restarts the count.
pub(super) fn feed() {
    WATCHDOG_LOAD.write(COUNT);
}

/// Ends the watchdog: the halt of the firmware lasts until a reset from outside.
pub(super) fn stop() {
    WATCHDOG_CONTROL.clear_bits(ENABLE);
}

/// Counts a start in a register that a reset of the watchdog or the debugger does not clear, and returns the count.
pub(super) fn count_start() -> u32 {
    let count = WATCHDOG_SCRATCH.read().wrapping_add(1);
    WATCHDOG_SCRATCH.write(count);
    count
}
