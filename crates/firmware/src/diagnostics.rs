//! Measurements of the firmware about itself, for a debugger or QEMU's monitor to read at the symbol `DIAGNOSTICS`.
//!
//! Invariant: the layout is that of `xtask/src/firmware/diagnostics.rs`; each word is written by one context, except
//! where it is added to.

use core::sync::atomic::{AtomicI32, AtomicU32, Ordering::Relaxed};

use retrace_firmware::AXES;
use retrace_firmware::steps::Steps;

/// Identifies the structure and its layout.
const MARK: u32 = 0x5254_0001;

/// Counters and worst times.
#[repr(C)]
pub(crate) struct Diagnostics {
    mark: AtomicU32,
    /// Cycles of the longest control period's computation, without interrupts.
    pub(crate) max_period: AtomicU32,
    /// Cycles of the longest step interrupt.
    max_interrupt: AtomicU32,
    /// Cycles spent in step interrupts, wrapping around.
    in_interrupts: AtomicU32,
    /// Control periods computed, wrapping around.
    pub(crate) periods: AtomicU32,
    /// Control periods that began late because no step batch was available.
    pub(crate) late_periods: AtomicU32,
    /// Received bytes that were lost.
    pub(crate) lost_bytes: AtomicU32,
    /// Step batches whose pulses did not fit their period.
    refused: AtomicU32,
    /// Net pulses of each axis as emitted at the outputs, wrapping around.
    counted: [AtomicI32; AXES],
}

/// The single instance.
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
    /// Marks the measurements as valid.
    pub(crate) fn mark_valid(&self) {
        self.mark.store(MARK, Relaxed);
    }

    /// Records a step interrupt of this many cycles.
    pub(crate) fn record_interrupt(&self, cycles: u32) {
        self.in_interrupts.store(self.in_interrupts.load(Relaxed).wrapping_add(cycles), Relaxed);
        self.max_interrupt.fetch_max(cycles, Relaxed);
    }

    /// Returns the cycles spent in step interrupts so far.
    pub(crate) fn interrupt_cycles(&self) -> u32 {
        self.in_interrupts.load(Relaxed)
    }

    /// Publishes the counts of the step interrupt.
    pub(crate) fn publish(&self, steps: &Steps) {
        for (word, &count) in self.counted.iter().zip(steps.counted()) {
            word.store(count, Relaxed);
        }
        self.refused.store(steps.refused(), Relaxed);
    }
}
