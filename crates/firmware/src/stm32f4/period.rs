//! Slots and control periods of the step generator.
//!
//! Invariant: every control period of whole microseconds is a whole number of slots, and every clock of these chips is
//! a whole number of ticks a slot.

/// Slots per second: steps begin and end on them.
pub const SLOT_HZ: u32 = 2_000_000;
/// Nanoseconds of a slot.
pub const SLOT_NS: u32 = 1_000_000_000 / SLOT_HZ;
/// Slots of a microsecond.
pub const SLOTS_PER_US: u32 = SLOT_HZ / 1_000_000;
/// Slots of a buffer: 250 µs. A control period that is a multiple of that begins with a buffer.
pub const BUFFER_SLOTS: usize = 500;
/// Maximum pulse frequency of an axis, in pulses per second: limited by the computing time (docs/firmware.md, *Figures
/// of the STM32F4*).
pub const MAX_PULSES_HZ: u32 = 250_000;
/// Minimum control period of an STM32F405, of an STM32F411 and of an STM32F401, in microseconds: limited by the
/// computing time of the chip, too.
pub const MIN_PERIOD_F405_US: u32 = 500;
/// Of an STM32F411.
pub const MIN_PERIOD_F411_US: u32 = 1000;
/// Of an STM32F401.
pub const MIN_PERIOD_F401_US: u32 = 2000;
/// Minimum control period of this image's chip, in microseconds.
pub const MIN_PERIOD_US: u32 = match (cfg!(feature = "f405"), cfg!(feature = "f411")) {
    (true, _) => MIN_PERIOD_F405_US,
    (false, true) => MIN_PERIOD_F411_US,
    (false, false) => MIN_PERIOD_F401_US,
};
/// Maximum control period, in microseconds.
pub const MAX_PERIOD_US: u32 = 20_000;
