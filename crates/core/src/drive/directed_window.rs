//! The road from the cursor to its end in one direction.
//!
//! Invariant: nothing is asked of the road outside `low … high`.

use super::RecordWindow;
use crate::place::before;
use crate::{Place, RapidCap, Travel};

/// A distance along the way that is run: forward as it is, backward with its sign turned.
pub(super) const fn along(sign: Travel, distance: Travel) -> Travel {
    if sign < 0 { -distance } else { distance }
}

/// The road from the cursor to its end in one direction.
#[derive(Debug)]
pub struct DirectedWindow<'r, const A: usize, R> {
    /// The cursor.
    pub at: Place,
    /// 1 forward, −1 backward.
    pub sign: Travel,
    /// The records held.
    pub road: &'r R,
}

impl<const A: usize, R: RecordWindow<A>> DirectedWindow<'_, A, R> {
    fn end(&self) -> u32 {
        if self.sign > 0 { self.road.high() } else { self.road.low() }
    }

    /// Does the cursor stand where the path is at rest?
    pub(super) fn rests(&self) -> bool {
        self.at.fraction == 0 && self.road.rests_at(self.at.record)
    }

    /// Distance to the end of the road, ≥ 0.
    pub(super) fn room(&self) -> Travel {
        along(self.sign, self.at.to(Place::start_of(self.end())))
    }

    /// The planned stop nearest to the end of the road that lies strictly ahead of the cursor.
    pub(super) fn last_rest(&self) -> Option<Place> {
        let mut place = self.end();
        loop {
            let here = Place::start_of(place);
            if along(self.sign, self.at.to(here)) <= 0 {
                return None;
            }
            if self.road.rests_at(place) {
                return Some(here);
            }
            place = place.wrapping_sub(self.sign as u32);
        }
    }

    fn holds(&self, n: u32) -> bool {
        n.wrapping_sub(self.road.low()) < self.road.high().wrapping_sub(self.road.low())
    }

    /// Cap of the k-th record ahead, the one under the cursor being the first.
    pub(super) fn cap(&self, k: u32) -> Option<RapidCap> {
        let n =
            if self.sign > 0 { self.at.record.wrapping_add(k) } else { self.at.boundary_ahead().wrapping_sub(k + 1) };
        self.holds(n).then(|| self.road.cap(n))
    }

    /// The records of the road that lie within `reach` of the cursor: the first in path order, and how many.
    pub(super) fn stretch(&self, reach: Travel) -> (u32, u32) {
        let count = ((reach.min(self.room()) >> 32) + 2) as u32;
        let (ahead, behind) = (self.at.record, self.at.boundary_ahead());
        if self.sign > 0 {
            (ahead, count.min(self.road.high().wrapping_sub(ahead)))
        } else {
            let count = count.min(behind.wrapping_sub(self.road.low()));
            (behind.wrapping_sub(count), count)
        }
    }

    /// Sums of the increments of `count` records from `first` on. What lies beyond an end of the road where the path is at rest counts as
    /// standing still; `None` where a record is not held otherwise.
    pub(super) fn block(&self, first: u32, count: u32) -> Option<[i32; A]> {
        let mut sum = [0; A];
        for k in 0..count {
            let n = first.wrapping_add(k);
            if self.holds(n) {
                let increments = self.road.increments(n);
                for (sum, increment) in sum.iter_mut().zip(increments) {
                    *sum += i32::from(increment);
                }
            } else {
                let end = if before(n, self.road.low()) { self.road.low() } else { self.road.high() };
                if !self.road.rests_at(end) {
                    return None;
                }
            }
        }
        Some(sum)
    }
}
