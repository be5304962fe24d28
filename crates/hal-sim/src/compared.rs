//! The card's counts beside what was counted at its pins.
//!
//! Invariant: only homing, which sets a count while nothing is on the window, changes by how much the two differ.

use retrace_link::Status;

/// By how much each axis' count differs from its position at the pins.
#[derive(Clone, Debug)]
pub(crate) struct Compared<const A: usize> {
    homed: [i64; A],
}

impl<const A: usize> Compared<A> {
    /// Counts that are `counts` where the pins' positions are 0.
    pub(crate) const fn new(counts: [i64; A]) -> Self {
        Self { homed: counts }
    }

    /// A period has passed, the counts having been `before`: are they what was counted?
    pub(crate) fn agrees(&mut self, before: &[i64; A], status: &Status<A>, positions: &[i64; A]) -> bool {
        let mut agrees = true;
        for axis in 0..A {
            let jump = status.counts[axis] - before[axis] - i64::from(status.increments[axis]);
            if jump != 0 && status.low == status.high {
                self.homed[axis] += jump;
            }
            agrees &= status.counts[axis] - self.homed[axis] == positions[axis];
        }
        agrees
    }
}
