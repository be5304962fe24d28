//! The system timer as a stopwatch: it counts the processor's cycles down, 24 bits wide (ARMv7-M and ARMv6-M, B3.3).
//!
//! Invariant: an interval shorter than 2²⁴ cycles is measured correctly.

use super::processor::{start_system_timer, system_timer};

/// Starts it permanently.
pub(super) fn start() {
    start_system_timer();
}

/// Returns the cycles since an arbitrary moment, modulo 2²⁴.
pub(super) fn now() -> u32 {
    0x00ff_ffff - (system_timer().cvr.read() & 0x00ff_ffff)
}

/// Returns the cycles from `earlier` to `later`, which are at most 2²⁴ cycles apart.
pub(crate) fn between(earlier: u32, later: u32) -> u32 {
    later.wrapping_sub(earlier) & 0x00ff_ffff
}
