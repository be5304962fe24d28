//! The handwheel's encoder: an alarm of the timer takes a sample of its signals every 100 µs (RP2040 data sheet, 4.6).
//!
//! Invariant: the interrupt is the only context that writes the count. At most 10 000 counts a second are seen, which
//! are 25 turns of a wheel with 100 detents.

use core::sync::atomic::{AtomicU16, AtomicU32, Ordering::Relaxed};

use super::registers::{PINS_IN, TIMER_ALARM, TIMER_INTERRUPT, TIMER_INTERRUPT_ENABLE, TIMER_NOW};
use retrace_firmware::rp2040::pins::encoder_levels;
use retrace_firmware::rp2040::quadrature::Quadrature;

/// Microseconds between samples.
const INTERVAL_US: u32 = 100;
const ALARM: u32 = 1;

static COUNT: AtomicU16 = AtomicU16::new(0);
/// Levels of the last sample.
static LEVELS: AtomicU32 = AtomicU32::new(0);

/// Starts the samples.
pub(super) fn start() {
    LEVELS.store(u32::from(encoder_levels(PINS_IN.read())), Relaxed);
    TIMER_INTERRUPT_ENABLE.write(ALARM);
    TIMER_ALARM.write(TIMER_NOW.read().wrapping_add(INTERVAL_US));
}

/// Handles the alarm.
pub(super) fn take_sample() {
    TIMER_INTERRUPT.write(ALARM);
    TIMER_ALARM.write(TIMER_NOW.read().wrapping_add(INTERVAL_US));
    let mut counter = Quadrature::new(LEVELS.load(Relaxed) as u8);
    let levels = encoder_levels(PINS_IN.read());
    let step = counter.sample(levels);
    LEVELS.store(u32::from(levels), Relaxed);
    COUNT.store(COUNT.load(Relaxed).wrapping_add(step), Relaxed);
}

/// Returns the count.
pub(super) fn count() -> u16 {
    COUNT.load(Relaxed)
}
