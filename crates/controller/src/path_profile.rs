//! Speed along the planned path over time, in intervals that grow with the program.
//!
//! Invariant: its memory is bounded however long the program is; the lengths sum to that of the path.

/// Number of records of the shortest interval: a single pulse in fewer of them would read as an enormous jerk.
const MIN_INTERVAL: u32 = 16;

/// Maximum number of intervals.
const MAX_INTERVALS: usize = 8_192;

/// Speed along a path, as the length of each interval.
#[derive(Clone, Debug, PartialEq)]
pub struct PathProfile {
    interval: u32,
    lengths_mm: Vec<f32>,
    /// Length of the interval that is not complete, and its records.
    rest: (f64, u32),
}

impl Default for PathProfile {
    fn default() -> Self {
        Self { interval: MIN_INTERVAL, lengths_mm: Vec::new(), rest: (0.0, 0) }
    }
}

impl PathProfile {
    /// Adds a record of this length.
    pub(crate) fn push(&mut self, length_mm: f64) {
        self.rest.0 += length_mm;
        self.rest.1 += 1;
        if self.rest.1 < self.interval {
            return;
        }
        self.lengths_mm.push(std::mem::take(&mut self.rest).0 as f32);
        if self.lengths_mm.len() >= MAX_INTERVALS {
            self.lengths_mm = self.lengths_mm.chunks(2).map(|pair| pair.iter().sum()).collect();
            self.interval *= 2;
        }
    }

    /// Duration of an interval in control periods.
    #[must_use]
    pub fn interval_periods(&self) -> u32 {
        self.interval
    }

    /// Length of each complete interval, mm.
    #[must_use]
    pub fn lengths_mm(&self) -> &[f32] {
        &self.lengths_mm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_grow_and_the_lengths_sum_to_the_path() {
        let mut profile = PathProfile::default();
        let records = 16 * 8_192 * 5;
        (0..records).for_each(|_| profile.push(0.25));
        assert_eq!(profile.interval_periods(), 16 * 8);
        let sum: f64 = profile.lengths_mm().iter().map(|&mm| f64::from(mm)).sum();
        assert!((sum + profile.rest.0 - 0.25 * f64::from(records)).abs() < 0.1, "{sum}");
        assert!(profile.lengths_mm().len() < MAX_INTERVALS);
        assert!(profile.lengths_mm().iter().all(|&mm| (mm - 32.0).abs() < 1e-3), "the speed is the same throughout");
    }
}
