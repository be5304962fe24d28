//! The step clock: divides a control period into slots, at which steps begin and end.
//!
//! Invariant: slots × reload is the control period to within half a timer tick per slot.

/// Slots per second: steps begin and end on them, so an axis makes at most half as many steps per second.
pub const SLOT_HZ: u32 = 100_000;
/// Minimum control period of an STM32F405, in microseconds: limited by the computing time of the chip
/// (docs/firmware.md, *Figures of the STM32F4*).
pub const MIN_PERIOD_F405_US: u32 = 500;
/// Minimum control period of the slower chips, STM32F401 and STM32F411, in microseconds.
pub const MIN_PERIOD_F401_US: u32 = 1000;
/// Minimum control period of this image's chip, in microseconds.
pub const MIN_PERIOD_US: u32 = if cfg!(feature = "f405") { MIN_PERIOD_F405_US } else { MIN_PERIOD_F401_US };
/// Maximum control period, in microseconds.
pub const MAX_PERIOD_US: u32 = 20_000;

/// Control period as the step timer runs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Period {
    /// Number of slots in the period, at least 1.
    pub slots: u32,
    /// Timer ticks per slot.
    pub ticks_per_slot: u32,
}

impl Period {
    /// Returns the slots of a period of `us` microseconds, clamped to [`MIN_PERIOD_US`] … [`MAX_PERIOD_US`], for a
    /// timer of `timer_hz`.
    ///
    /// A period that is a multiple of 10 µs is exact if the timer's rate is a multiple of [`SLOT_HZ`]; any other one is
    /// off by at most half a tick per slot.
    #[must_use]
    pub const fn new(us: u32, timer_hz: u32) -> Self {
        let us = if us < MIN_PERIOD_US {
            MIN_PERIOD_US
        } else if us > MAX_PERIOD_US {
            MAX_PERIOD_US
        } else {
            us
        };
        let slots = us / (1_000_000 / SLOT_HZ);
        let ticks = us as u64 * timer_hz as u64 / 1_000_000;
        let ticks_per_slot = (ticks + slots as u64 / 2) / slots as u64;
        // below 2³²: a slot is about 10 µs
        Self { slots, ticks_per_slot: ticks_per_slot as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_period_is_within_half_a_tick_a_slot() {
        for timer_hz in [84_000_000, 100_000_000, 1_000_000_000] {
            for us in MIN_PERIOD_US..=MAX_PERIOD_US {
                let Period { slots, ticks_per_slot } = Period::new(us, timer_hz);
                let wanted = u64::from(us) * u64::from(timer_hz) / 1_000_000;
                let error = (u64::from(slots) * u64::from(ticks_per_slot)).abs_diff(wanted);
                assert!(2 * error <= u64::from(slots), "{us} µs at {timer_hz}: {error} ticks");
                assert!(us % 10 != 0 || error == 0, "{us} µs at {timer_hz} is exact");
            }
        }
        assert_eq!(Period::new(0, 84_000_000), Period::new(MIN_PERIOD_US, 84_000_000));
        assert_eq!(Period::new(u32::MAX, 84_000_000), Period::new(MAX_PERIOD_US, 84_000_000));
    }
}
