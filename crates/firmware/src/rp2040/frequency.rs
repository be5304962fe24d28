//! The frequency at an input, as the reading of an analog input: for converters from a voltage to a frequency.
//!
//! Invariant: a reading is the share of [`FULL_SCALE_HZ`] in units of 2⁻¹⁶, at most 65 535.

use super::CLOCK_HZ;

/// Frequency of the upper end of the range.
pub const FULL_SCALE_HZ: u32 = 1_000_000;
/// Shortest time that is measured, in cycles: in less, a single count would be more than a thousandth of the range.
const MIN_CYCLES: u32 = CLOCK_HZ / 1_000;

/// The measurement: a counter of rising edges and one of cycles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrequencyMeter {
    /// Both counters at the last measurement.
    last: Option<(u16, u32)>,
    reading: Option<u16>,
}

impl FrequencyMeter {
    /// Creates one that has measured nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self { last: None, reading: None }
    }

    /// Takes the counter of edges, and that of cycles, of which the lower 24 bits count, at least every 100 ms. Returns
    /// the reading; none before the first time that is long enough.
    pub fn measure(&mut self, edges: u16, cycles: u32) -> Option<u16> {
        let Some((last_edges, last_cycles)) = self.last else {
            self.last = Some((edges, cycles));
            return None;
        };
        let passed = cycles.wrapping_sub(last_cycles) & 0x00ff_ffff;
        if passed >= MIN_CYCLES {
            let counted = u64::from(edges.wrapping_sub(last_edges));
            // at most 2¹⁶ · 2¹⁶ · 2²⁸
            let share = (counted << 16) * u64::from(CLOCK_HZ) / (u64::from(passed) * u64::from(FULL_SCALE_HZ));
            self.reading = Some(share.min(u64::from(u16::MAX)) as u16);
            self.last = Some((edges, cycles));
        }
        self.reading
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Any frequency in any periods, with counters that wrap: the reading is within two counts of it.
        #[test]
        fn a_frequency_is_read(
            hz in 0..1_000_000u32, periods in prop::collection::vec(900..8_000u32, 3..40), edges: u16, cycles: u32,
        ) {
            let (mut meter, mut at_us, mut measured_us) = (FrequencyMeter::new(), 0_u64, 0_u64);
            let edges_at = |us: u64| (u64::from(hz) * us / 1_000_000) as u16;
            let at = |us: u64| cycles.wrapping_add((us * u64::from(CLOCK_HZ) / 1_000_000) as u32) & 0x00ff_ffff;
            prop_assert_eq!(meter.measure(edges, at(0)), None);
            for period in periods {
                at_us += u64::from(period);
                let reading = meter.measure(edges.wrapping_add(edges_at(at_us)), at(at_us));
                if at_us - measured_us < 1_000 {
                    continue;
                }
                let read_hz = f64::from(reading.expect("it has measured")) / 65_536.0 * f64::from(FULL_SCALE_HZ);
                let resolution_hz = 2e6 / (at_us - measured_us) as f64;
                prop_assert!((read_hz - f64::from(hz)).abs() <= resolution_hz + 16.0, "{} for {}", read_hz, hz);
                measured_us = at_us;
            }
        }
    }

    #[test]
    fn the_ends_of_the_range_and_short_times() {
        let mut meter = FrequencyMeter::new();
        assert_eq!(meter.measure(0, 0), None);
        assert_eq!(meter.measure(100, MIN_CYCLES - 1), None, "too short to tell");
        assert_eq!(meter.measure(1_500, MIN_CYCLES), Some(u16::MAX), "beyond the range");
        assert_eq!(meter.measure(1_500, MIN_CYCLES + 10), Some(u16::MAX), "as before");
        assert_eq!(meter.measure(1_500, 3 * MIN_CYCLES), Some(0), "no edge");
        assert_eq!(meter.measure(2_000, 4 * MIN_CYCLES), Some(1 << 15));
    }
}
