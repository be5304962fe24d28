//! The counter that makes the output for S: divider, end, and the level of a duty cycle (RP2040 data sheet, 4.5).
//!
//! Invariant: the pin is low at a duty cycle of 0 and high at one of 100 %, for every frequency that the card accepts.

use retrace_link::PWM_HZ;

use super::CLOCK_HZ;

/// Settings of the counter for a frequency.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PwmCounter {
    /// Clock cycles of a count.
    pub divider: u8,
    /// Last count of a cycle, below 65 535: the level after it is that of 100 %.
    pub top: u16,
}

impl PwmCounter {
    /// Returns the settings for a frequency in Hz, within [`PWM_HZ`]: the finest counts of which a cycle has at most
    /// 65 535.
    #[must_use]
    pub const fn of(hz: u16) -> Self {
        let hz = if hz < *PWM_HZ.start() { *PWM_HZ.start() } else { hz };
        let cycles = CLOCK_HZ / hz as u32;
        let divider = cycles.div_ceil(65_535);
        Self { divider: divider as u8, top: (cycles / divider - 1) as u16 }
    }

    /// Returns the level of a duty cycle, 0 … 2¹⁶: the pin is high for so many counts.
    #[must_use]
    pub const fn level(self, duty: u32) -> u16 {
        let duty = if duty > 1 << 16 { 1 << 16 } else { duty };
        // at most 2¹⁶ times 65 535
        ((duty * (self.top as u32 + 1)) >> 16) as u16
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_frequency_is_made_to_a_few_thousandths_with_both_ends() {
        for hz in PWM_HZ {
            let counter = PwmCounter::of(hz);
            let counts = u32::from(counter.top) + 1;
            let made = f64::from(CLOCK_HZ) / f64::from(u32::from(counter.divider) * counts);
            assert!((made / f64::from(hz) - 1.0).abs() < 0.001, "{made} Hz for {hz}");
            assert!((2_000..=65_535).contains(&counts) && counter.divider >= 1, "{counter:?}");
            assert_eq!((counter.level(0), u32::from(counter.level(1 << 16))), (0, counts));
            assert_eq!(counter.level(u32::MAX), counter.level(1 << 16));
            assert_eq!(u32::from(counter.level(1 << 15)), counts / 2);
        }
        assert_eq!(PwmCounter::of(0), PwmCounter::of(*PWM_HZ.start()));
    }
}
