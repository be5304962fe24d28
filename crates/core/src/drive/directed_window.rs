//! The window of records from the cursor to its end in one direction.
//!
//! Invariant: no record outside `low … high` is read.

use super::RecordWindow;
use crate::{Distance, Place, RapidCap, RecordIndex};
use core::ops::Neg;

/// Returns a rate or a distance with its sign inverted if `sign` is negative.
pub(super) fn signed<Q: Neg<Output = Q>>(sign: i64, quantity: Q) -> Q {
    if sign < 0 { -quantity } else { quantity }
}

/// The window of records from the cursor to its end in one direction.
#[derive(Debug)]
pub struct DirectedWindow<'r, const A: usize, R> {
    /// Place of the cursor.
    pub at: Place,
    /// Direction: 1 forward, −1 backward.
    pub sign: i64,
    /// The records held.
    pub window: &'r R,
}

impl<const A: usize, R: RecordWindow<A>> DirectedWindow<'_, A, R> {
    fn end(&self) -> RecordIndex {
        if self.sign > 0 { self.window.high() } else { self.window.low() }
    }

    /// Whether the cursor is at a planned stop.
    pub(super) fn at_planned_stop(&self) -> bool {
        self.at.fraction == 0 && self.window.rests_at(self.at.record)
    }

    /// Returns the distance to the end of the window, ≥ 0.
    pub(super) fn distance_to_end(&self) -> Distance {
        signed(self.sign, self.at.distance_to(Place::start_of(self.end())))
    }

    /// Returns the planned stop strictly ahead of the cursor that is nearest to the end of the window.
    pub(super) fn last_planned_stop(&self) -> Option<Place> {
        let mut place = self.end();
        loop {
            let here = Place::start_of(place);
            if signed(self.sign, self.at.distance_to(here)) <= Distance::ZERO {
                return None;
            }
            if self.window.rests_at(place) {
                return Some(here);
            }
            place -= self.sign as u32;
        }
    }

    fn holds(&self, n: RecordIndex) -> bool {
        n.since(self.window.low()) < self.window.high().since(self.window.low())
    }

    /// Returns the cap of the k-th record ahead; the record under the cursor is the first.
    pub(super) fn cap(&self, k: u32) -> Option<RapidCap> {
        let n = if self.sign > 0 { self.at.record + k } else { self.at.boundary_ahead() - (k + 1) };
        self.holds(n).then(|| self.window.cap(n))
    }

    /// Returns the records of the window within `reach` of the cursor: the number of the first in path order, and the
    /// count.
    pub(super) fn records_within(&self, reach: Distance) -> (RecordIndex, u32) {
        let count = ((reach.min(self.distance_to_end()).units() >> 32) + 2) as u32;
        let (ahead, behind) = (self.at.record, self.at.boundary_ahead());
        if self.sign > 0 {
            (ahead, count.min(self.window.high().since(ahead)))
        } else {
            let count = count.min(behind.since(self.window.low()));
            (behind - count, count)
        }
    }

    /// Returns the sums of the increments of `count` records from `first` on.
    ///
    /// Beyond an end of the window where the path is at rest, increments count as zero. Returns `None` if a record is
    /// not held otherwise.
    pub(super) fn sum_increments(&self, first: RecordIndex, count: u32) -> Option<[i32; A]> {
        let mut sum = [0; A];
        for k in 0..count {
            let n = first + k;
            if self.holds(n) {
                let increments = self.window.increments(n);
                for (sum, increment) in sum.iter_mut().zip(increments) {
                    *sum += i32::from(increment);
                }
            } else {
                let end = if n.is_before(self.window.low()) { self.window.low() } else { self.window.high() };
                if !self.window.rests_at(end) {
                    return None;
                }
            }
        }
        Some(sum)
    }
}
