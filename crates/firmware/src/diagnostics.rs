//! What the firmware measures of itself, for a debugger or QEMU's monitor to read by the symbol `DIAGNOSTICS`.
//!
//! Invariant: the layout is that of `xtask/src/firmware/diagnostics.rs`; each word is written by one context, except where it is added to.

use core::sync::atomic::{AtomicI32, AtomicU32, Ordering::Relaxed};

use retrace_firmware::AXES;
use retrace_firmware::steps::Steps;

/// Says that this is it, and in which layout.
const MARK: u32 = 0x5254_0001;

/// Counters and worst times.
#[repr(C)]
pub(crate) struct Diagnostics {
    mark: AtomicU32,
    /// Cycles of the longest control period's computation, interrupts taken out.
    pub(crate) max_period: AtomicU32,
    /// Cycles of the longest step interrupt.
    max_interrupt: AtomicU32,
    /// Cycles spent in step interrupts, wrapping around.
    in_interrupts: AtomicU32,
    /// Control periods computed, wrapping around.
    pub(crate) periods: AtomicU32,
    /// Control periods that began late, for want of an order.
    pub(crate) late_periods: AtomicU32,
    /// Bytes that came and were not taken in.
    pub(crate) lost_bytes: AtomicU32,
    /// Orders whose pulses did not fit their period.
    refused: AtomicU32,
    /// Net pulses of each axis as the outputs showed them, wrapping around.
    counted: [AtomicI32; AXES],
}

/// The one of them.
pub(crate) static DIAGNOSTICS: Diagnostics = Diagnostics {
    mark: AtomicU32::new(0),
    max_period: AtomicU32::new(0),
    max_interrupt: AtomicU32::new(0),
    in_interrupts: AtomicU32::new(0),
    periods: AtomicU32::new(0),
    late_periods: AtomicU32::new(0),
    lost_bytes: AtomicU32::new(0),
    refused: AtomicU32::new(0),
    counted: [const { AtomicI32::new(0) }; AXES],
};

impl Diagnostics {
    /// From now on they are valid.
    pub(crate) fn begin(&self) {
        self.mark.store(MARK, Relaxed);
    }

    /// The step interrupt has taken so many cycles.
    pub(crate) fn interrupted(&self, cycles: u32) {
        self.in_interrupts.store(self.in_interrupts.load(Relaxed).wrapping_add(cycles), Relaxed);
        self.max_interrupt.fetch_max(cycles, Relaxed);
    }

    /// Cycles spent in step interrupts so far.
    pub(crate) fn in_interrupts(&self) -> u32 {
        self.in_interrupts.load(Relaxed)
    }

    /// What the step interrupt has counted.
    pub(crate) fn publish(&self, steps: &Steps) {
        for (word, &count) in self.counted.iter().zip(steps.counted()) {
            word.store(count, Relaxed);
        }
        self.refused.store(steps.refused(), Relaxed);
    }
}
