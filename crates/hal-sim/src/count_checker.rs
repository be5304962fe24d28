//! Comparison of the card's counts with the pulses counted at its pins.
//!
//! Invariant: only two things change the difference of both: homing, which sets a count while nothing is on the window,
//! and backlash that is taken up. At rest it is taken up fully or not at all.

use retrace_link::{CardStatus, LayerSettings};

/// Difference of each axis' count from its position at the pins.
#[derive(Clone, Debug)]
pub(crate) struct CountChecker<const A: usize> {
    /// Counts where the positions are 0 and no backlash is taken up.
    homed: [i64; A],
    play: [u16; A],
    /// Direction of the first backlash that was taken up, which is undone before any other is: 1, −1, or 0 before.
    direction: [i64; A],
    /// Axis of the layer, which is added to its count.
    layer_axis: usize,
}

impl<const A: usize> CountChecker<A> {
    /// Checker for counts that are `counts` where the pins' positions are 0.
    pub(crate) const fn new(counts: [i64; A]) -> Self {
        Self { homed: counts, play: [0; A], direction: [0; A], layer_axis: 0 }
    }

    /// Sets the backlash of the axes from now on. Where it changes, backlash that was taken up stays so.
    pub(crate) fn set_backlash(&mut self, backlash: &[u16; A], counts: &[i64; A], positions: &[i64; A]) {
        for axis in 0..A {
            if backlash[axis] != self.play[axis] {
                self.homed[axis] = counts[axis] - positions[axis];
                (self.play[axis], self.direction[axis]) = (backlash[axis], 0);
            }
        }
    }

    /// Sets the axis of the layer from now on.
    pub(crate) fn set_layer(&mut self, layer: Option<LayerSettings>) {
        self.layer_axis = layer.map_or(0, |layer| usize::from(layer.axis));
    }

    /// Whether the counts after a period, which were `before` at its start, match the counted pulses.
    pub(crate) fn counts_match(&mut self, before: &[i64; A], status: &CardStatus<A>, positions: &[i64; A]) -> bool {
        let mut agrees = true;
        for axis in 0..A {
            let jump = status.counts[axis] - before[axis] - i64::from(status.increments[axis]);
            if jump != 0 && status.low == status.high {
                self.homed[axis] += jump;
            }
            let layer = if axis == self.layer_axis { i64::from(status.layer) } else { 0 };
            let apart = positions[axis] - (status.counts[axis] + layer - self.homed[axis]);
            if apart != 0 {
                let play = i64::from(self.play[axis]);
                let way = &mut self.direction[axis];
                *way = if *way == 0 { apart.signum() } else { *way };
                let taken = apart * *way;
                agrees &= (0..=play).contains(&taken) && (!status.at_rest || taken == play);
            }
        }
        agrees
    }
}
