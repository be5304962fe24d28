//! The card's counts beside what was counted at its pins.
//!
//! Invariant: only homing, which sets a count while nothing is on the window, changes by how much the two differ, and play that is taken
//! up: at rest none of it or all.

use retrace_link::CardStatus;

/// By how much each axis' count differs from its position at the pins.
#[derive(Clone, Debug)]
pub(crate) struct CountChecker<const A: usize> {
    /// Counts where the positions are 0 and no play is taken up.
    homed: [i64; A],
    play: [u16; A],
    /// The way of the first play that was taken up, which is undone before any other is: 1, −1, or 0 before.
    way: [i64; A],
}

impl<const A: usize> CountChecker<A> {
    /// Counts that are `counts` where the pins' positions are 0.
    pub(crate) const fn new(counts: [i64; A]) -> Self {
        Self { homed: counts, play: [0; A], way: [0; A] }
    }

    /// The axes have so much play from now on; where that is new, what is taken up of the old one stays taken up.
    pub(crate) fn expect_play(&mut self, play: &[u16; A], counts: &[i64; A], positions: &[i64; A]) {
        for axis in 0..A {
            if play[axis] != self.play[axis] {
                self.homed[axis] = counts[axis] - positions[axis];
                (self.play[axis], self.way[axis]) = (play[axis], 0);
            }
        }
    }

    /// A period has passed, the counts having been `before`: are they what was counted?
    pub(crate) fn agrees(&mut self, before: &[i64; A], status: &CardStatus<A>, positions: &[i64; A]) -> bool {
        let mut agrees = true;
        for axis in 0..A {
            let jump = status.counts[axis] - before[axis] - i64::from(status.increments[axis]);
            if jump != 0 && status.low == status.high {
                self.homed[axis] += jump;
            }
            let apart = positions[axis] - (status.counts[axis] - self.homed[axis]);
            if apart != 0 {
                let play = i64::from(self.play[axis]);
                let way = &mut self.way[axis];
                *way = if *way == 0 { apart.signum() } else { *way };
                let taken = apart * *way;
                agrees &= (0..=play).contains(&taken) && (!status.at_rest || taken == play);
            }
        }
        agrees
    }
}
