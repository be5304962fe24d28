//! Length of the path up to a place, stored in coarse steps: the length of the history in mm.
//!
//! Invariant: never more than [`MAX_STEPS`] steps; lengths grow with their places.

use std::collections::VecDeque;

use retrace_core::{Place, RecordIndex};

/// Maximum number of steps.
pub(crate) const MAX_STEPS: usize = 4096;

/// Lengths at places.
#[derive(Clone, Debug)]
pub struct PathLengths {
    steps: VecDeque<(RecordIndex, f64)>,
    /// Number of records from one step to the next.
    stride: u32,
    /// Furthest place, and the length up to it.
    end: (Place, f64),
}

impl PathLengths {
    /// Path that starts at a place with length 0.
    #[must_use]
    pub fn from(place: Place) -> Self {
        Self { steps: VecDeque::from([(place.record, 0.0)]), stride: 1, end: (place, 0.0) }
    }

    /// Adds a path of this length before it, from this place on.
    #[must_use]
    pub fn with_history(mut self, oldest: RecordIndex, mm: f64) -> Self {
        if oldest.is_before(self.end.0.record) {
            self.end.1 += mm;
            self.steps = VecDeque::from([(oldest, 0.0), (self.end.0.record, self.end.1)]);
        }
        self
    }

    /// Furthest place.
    #[must_use]
    pub const fn furthest(&self) -> Place {
        self.end.0
    }

    /// Length up to the furthest place, mm.
    #[must_use]
    pub const fn total_mm(&self) -> f64 {
        self.end.1
    }

    /// Extends the path by `mm`, up to `place`; the part before `oldest` is dropped.
    pub fn extend(&mut self, place: Place, mm: f64, oldest: RecordIndex) {
        self.end = (place, self.end.1 + mm);
        if self.steps.back().is_none_or(|&(last, _)| place.record.since(last) >= self.stride) {
            self.steps.push_back((place.record, self.end.1));
        }
        while self.steps.get(1).is_some_and(|&(second, _)| !oldest.is_before(second)) {
            self.steps.pop_front();
        }
        if self.steps.len() >= MAX_STEPS {
            let mut keep = false;
            self.steps.retain(|_| {
                keep = !keep;
                keep
            });
            self.stride = self.stride.saturating_mul(2);
        }
    }

    /// Length up to a place, mm; clamped to the stored range.
    #[must_use]
    pub fn length_at(&self, place: Place) -> f64 {
        let behind = self.steps.partition_point(|&(step, _)| !place.record.is_before(step));
        let Some(&(from, from_mm)) = behind.checked_sub(1).and_then(|n| self.steps.get(n)) else {
            return self.steps.front().map_or(0.0, |&(_, mm)| mm);
        };
        let (to, to_mm) = self
            .steps
            .get(behind)
            .map_or((as_number(self.end.0, from), self.end.1), |&(step, mm)| (f64::from(step.since(from)), mm));
        let share = if to > 0.0 { (as_number(place, from) / to).clamp(0.0, 1.0) } else { 0.0 };
        from_mm + share * (to_mm - from_mm)
    }
}

/// Distance of a place from a record at or before it, in records.
fn as_number(place: Place, from: RecordIndex) -> f64 {
    f64::from(place.record.since(from)) + place.fraction_of_record()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_found_again_over_the_wrap_and_the_thinning() {
        let begin = u32::MAX - 1000;
        let mut lengths = PathLengths::from(Place::start_of(RecordIndex::new(begin)));
        for n in 1..=100_000u32 {
            lengths.extend(Place::start_of(RecordIndex::new(begin.wrapping_add(n))), 0.5, RecordIndex::new(begin));
        }
        assert!(lengths.steps.len() <= MAX_STEPS);
        assert_eq!(lengths.total_mm(), 50_000.0);
        for n in [0u32, 1, 999, 1000, 1001, 54_321, 99_999, 100_000] {
            let mm = lengths.length_at(Place::start_of(RecordIndex::new(begin.wrapping_add(n))));
            assert!((mm - 0.5 * f64::from(n)).abs() < 1e-6, "{n}: {mm}");
        }
        assert_eq!(
            lengths.length_at(Place { record: RecordIndex::new(begin.wrapping_add(10)), fraction: 1 << 31 }),
            5.25
        );
    }

    #[test]
    fn a_path_before_the_first_place_counts() {
        let mut lengths =
            PathLengths::from(Place::start_of(RecordIndex::new(500))).with_history(RecordIndex::new(100), 40.0);
        lengths.extend(Place::start_of(RecordIndex::new(501)), 1.0, RecordIndex::new(100));
        let at = [100, 300, 500, 501].map(|place| lengths.length_at(Place::start_of(RecordIndex::new(place))));
        assert_eq!((at, lengths.total_mm()), ([0.0, 20.0, 40.0, 41.0], 41.0));
    }

    #[test]
    fn what_is_older_than_the_oldest_is_forgotten() {
        let mut lengths = PathLengths::from(Place::start_of(RecordIndex::new(0)));
        for n in 1..=10_000u32 {
            lengths.extend(Place::start_of(RecordIndex::new(n)), 1.0, RecordIndex::new(n.saturating_sub(100)));
        }
        assert!(lengths.steps.len() < 110);
        assert_eq!(lengths.length_at(Place::start_of(RecordIndex::new(9_950))), 9_950.0);
        assert_eq!(lengths.length_at(Place::start_of(RecordIndex::new(3))), 9_900.0);
    }
}
