//! A wire from the step output of an axis to an input that measures a frequency: what `retrace doctor --step-test`
//! asks for.
//!
//! Invariant: every step is counted once, in one measurement of at least a millisecond.

/// Frequency at the upper end of the range of the input.
const FULL_SCALE_HZ: u64 = 1_000_000;
/// Shortest time that is measured, as on the boards.
const MIN_US: u64 = 1_000;

/// Settings of the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepWire {
    /// The axis, from 0.
    pub axis: u8,
    /// The analog input.
    pub input: u8,
}

/// The wire and the meter at its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepMeter {
    wire: StepWire,
    /// Steps since the last measurement, and its time.
    steps: u64,
    since_us: u64,
}

impl StepMeter {
    /// Meter at rest.
    pub(crate) const fn new(wire: StepWire) -> Self {
        Self { wire, steps: 0, since_us: 0 }
    }

    /// Counts the pulses of the period that ended at `now_us`. Returns the input and its reading, in units of 2⁻¹⁶ of
    /// the range, where a measurement has ended.
    pub(crate) fn advance(&mut self, now_us: u64, pulses: &[i32]) -> Option<(u8, u16)> {
        self.steps += pulses.get(usize::from(self.wire.axis)).map_or(0, |steps| u64::from(steps.unsigned_abs()));
        let passed_us = now_us.saturating_sub(self.since_us);
        if passed_us < MIN_US {
            return None;
        }
        let share = (self.steps << 16) * 1_000_000 / (passed_us * FULL_SCALE_HZ);
        (self.steps, self.since_us) = (0, now_us);
        Some((self.wire.input, share.min(u64::from(u16::MAX)) as u16))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_counted_for_a_millisecond_at_least() {
        let mut meter = StepMeter::new(StepWire { axis: 1, input: 3 });
        assert_eq!(meter.advance(500, &[9, 25]), None);
        assert_eq!(meter.advance(1_000, &[9, -25]), Some((3, 3_276)), "50 kHz, in either direction");
        assert_eq!(meter.advance(2_000, &[9, 0]), Some((3, 0)));
        assert_eq!(meter.advance(3_000, &[9, 2_000]), Some((3, u16::MAX)), "beyond the range");
    }
}
