//! What all Cortex-M processors have: the system timer and the handler of faults.
//!
//! Invariant: nothing here depends on the chip around the processor; the system timer belongs to the stopwatch.
#![allow(unsafe_code)]

use cortex_m::peripheral::SYST;

/// Returns the system timer.
pub(super) fn system_timer() -> &'static cortex_m::peripheral::syst::RegisterBlock {
    // SAFETY: the address is that of the timer on every Cortex-M, aligned, and permanently valid; the block is only
    // ever shared, and its cells are volatile.
    unsafe { &*SYST::PTR }
}

/// Starts the system timer from its full range, without an interrupt.
pub(super) fn start_system_timer() {
    // SAFETY: every value written is valid (ARMv7-M and ARMv6-M, B3.3); nothing else uses this timer.
    unsafe {
        system_timer().rvr.write(0x00ff_ffff);
        system_timer().cvr.write(0);
        system_timer().csr.write(0b101);
    }
}

/// Handler of processor faults: the state is not reliable any more, so the firmware halts.
#[cortex_m_rt::exception]
unsafe fn HardFault(_frame: &cortex_m_rt::ExceptionFrame) -> ! {
    crate::halt()
}
