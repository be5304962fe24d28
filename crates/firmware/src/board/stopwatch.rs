//! The system timer as a stopwatch: it counts the processor's cycles down, 24 bits wide (ARMv7-M, B3.3).
//!
//! Invariant: an interval shorter than 2²⁴ cycles is measured right.

use super::registers::{start_system_timer, system_timer};

/// Lets it run, for good.
pub(super) fn start() {
    start_system_timer();
}

/// Cycles since some moment, modulo 2²⁴.
pub(crate) fn now() -> u32 {
    0x00ff_ffff - (system_timer().cvr.read() & 0x00ff_ffff)
}

/// Cycles since `earlier`, which was at most 2²⁴ cycles ago.
pub(crate) fn since(earlier: u32) -> u32 {
    now().wrapping_sub(earlier) & 0x00ff_ffff
}
