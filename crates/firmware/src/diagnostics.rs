//! Measurements of the firmware about itself, for a debugger or an emulator to read at the symbol `DIAGNOSTICS`.
//!
//! Invariant: the layout is that of `xtask/src/firmware/diagnostics.rs`; each word is written by one context only: not
//! every processor can add to a word of memory in one step.

use core::sync::atomic::{AtomicI32, AtomicU32, Ordering::Relaxed};

use retrace_firmware::AXES;

/// Identifies the structure and its layout.
const MARK: u32 = 0x5254_0002;

/// Counters and worst times.
#[repr(C)]
pub(crate) struct Diagnostics {
    mark: AtomicU32,
    /// Cycles of the longest control period's computation, without interrupts.
    max_period: AtomicU32,
    /// Cycles of the longest measured interrupt: on the STM32F4 that which fills a buffer with steps.
    max_interrupt: AtomicU32,
    /// Cycles spent in these interrupts, wrapping around.
    in_interrupts: AtomicU32,
    /// Control periods computed, wrapping around.
    periods: AtomicU32,
    /// Control periods that began late because no step batch was available.
    late_periods: AtomicU32,
    /// Received bytes that were lost.
    pub(crate) lost_bytes: AtomicU32,
    /// Step batches whose pulses did not fit their period.
    refused: AtomicU32,
    /// Net pulses of each axis as emitted at the outputs, wrapping around.
    counted: [AtomicI32; AXES],
    /// Cycles of all control periods' computations, without interrupts, in units of 1024.
    in_periods: AtomicU32,
}

/// Cycles in a unit of the sum of all control periods: 32 bits of cycles are seconds.
const UNIT: u32 = 1024;

/// The single instance. The attribute keeps its layout, which the compiler could otherwise take apart.
#[used]
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
    in_periods: AtomicU32::new(0),
};

impl Diagnostics {
    /// Marks the measurements as valid.
    pub(crate) fn mark_valid(&self) {
        self.mark.store(MARK, Relaxed);
    }

    /// Records an interrupt of this many cycles.
    pub(crate) fn record_interrupt(&self, cycles: u32) {
        self.in_interrupts.store(self.in_interrupts.load(Relaxed).wrapping_add(cycles), Relaxed);
        raise(&self.max_interrupt, cycles);
    }

    /// Records a control period whose computation took this many cycles; `rest` is what was left over of the unit
    /// before, and is left over of this one.
    pub(crate) fn record_period(&self, cycles: u32, rest: &mut u32) {
        raise(&self.max_period, cycles);
        *rest += cycles;
        self.in_periods.store(self.in_periods.load(Relaxed).wrapping_add(*rest / UNIT), Relaxed);
        *rest %= UNIT;
        increment(&self.periods);
    }

    /// Returns the cycles spent in these interrupts so far.
    pub(crate) fn interrupt_cycles(&self) -> u32 {
        self.in_interrupts.load(Relaxed)
    }

    /// Publishes the counts of the step generator: net pulses of each axis, refused batches, and late periods.
    pub(crate) fn publish(&self, counted: &[i32; AXES], refused: u32, late: u32) {
        for (word, &count) in self.counted.iter().zip(counted) {
            word.store(count, Relaxed);
        }
        self.refused.store(refused, Relaxed);
        self.late_periods.store(late, Relaxed);
    }
}

/// Adds 1 to a word that no other context writes.
pub(crate) fn increment(word: &AtomicU32) {
    word.store(word.load(Relaxed).wrapping_add(1), Relaxed);
}

/// Raises a word that no other context writes to at least this value.
pub(crate) fn raise(word: &AtomicU32, value: u32) {
    word.store(word.load(Relaxed).max(value), Relaxed);
}
