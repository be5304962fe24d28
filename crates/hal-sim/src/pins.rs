//! The step and direction wires of a simulated card, with pulse counters.
//!
//! Invariant: a count is a rising edge on a step wire, up or down with the direction wire, both by the card's own step
//! and direction plan.

use retrace_card::{Edge, StepDirection, StepTiming};

/// An edge on one of the wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinEdge {
    /// Tick of the card's clock, from the beginning of the period.
    pub tick: u32,
    /// The axis, from 0.
    pub axis: u8,
    /// The edge.
    pub edge: Edge,
}

/// The wires of all axes, with a counter behind each pair.
#[derive(Clone, Debug)]
pub struct Pins<const A: usize> {
    timing: Option<StepTiming>,
    outputs: Option<[StepDirection; A]>,
    backward: [bool; A],
    positions: [i64; A],
    pulses: [u64; A],
    edges: Vec<PinEdge>,
}

impl<const A: usize> Default for Pins<A> {
    fn default() -> Self {
        let (positions, pulses) = ([0; A], [0; A]);
        Self { timing: None, outputs: None, backward: [false; A], positions, pulses, edges: Vec::new() }
    }
}

impl<const A: usize> Pins<A> {
    /// Emits the increments of a period with these times. Returns false where an axis has more than fits a period: that
    /// axis emits nothing.
    pub fn emit(&mut self, timing: StepTiming, increments: &[i32; A]) -> bool {
        if self.timing != Some(timing) {
            // Times change only while the machine is at rest: the wires do not change.
            self.timing = Some(timing);
            self.outputs = None;
            self.backward = [false; A];
        }
        let outputs = self.outputs.get_or_insert_with(|| std::array::from_fn(|_| StepDirection::new(timing)));
        self.edges.clear();
        let mut fits = true;
        for (axis, (output, &increment)) in (0u8..).zip(outputs.iter_mut().zip(increments)) {
            fits &= output.begin_period(increment).is_ok();
            self.edges.extend(output.edges().map(|(tick, edge)| PinEdge { tick, axis, edge }));
        }
        for edge in &self.edges {
            let axis = usize::from(edge.axis);
            match edge.edge {
                Edge::Direction { backward } => self.backward[axis] = backward,
                Edge::Rise => {
                    self.positions[axis] += if self.backward[axis] { -1 } else { 1 };
                    self.pulses[axis] += 1;
                }
                Edge::Fall => {}
            }
        }
        fits
    }

    /// Ends all edges: the card is off. The positions of the axes stay.
    pub fn power_off(&mut self) {
        (self.timing, self.outputs, self.backward) = (None, None, [false; A]);
        self.edges.clear();
    }

    /// The last period's edges in order of their time.
    pub fn edges(&mut self) -> &[PinEdge] {
        self.edges.sort_by_key(|edge| edge.tick);
        &self.edges
    }

    /// Net pulses of each axis.
    #[must_use]
    pub const fn positions(&self) -> &[i64; A] {
        &self.positions
    }

    /// All pulses of each axis, in either direction.
    #[must_use]
    pub const fn pulses(&self) -> &[u64; A] {
        &self.pulses
    }

    /// Axes whose direction wires are set to backward.
    #[must_use]
    pub const fn backward(&self) -> &[bool; A] {
        &self.backward
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_counted_is_what_was_asked_for(
            increments in prop::collection::vec([-120i32..120, -3i32..3], 1..60),
        ) {
            // a clock of 1 MHz, 1 ms, pulses of 2 µs, 5 µs before a pulse after a turn
            let timing = StepTiming::of_clock(1_000_000, 1000, 2000, 5000).expect("valid");
            let mut pins = Pins::<2>::default();
            let (mut sums, mut all) = ([0i64; 2], [0u64; 2]);
            for increment in &increments {
                prop_assert!(pins.emit(timing, increment));
                for axis in 0..2 {
                    sums[axis] += i64::from(increment[axis]);
                    all[axis] += u64::from(increment[axis].unsigned_abs());
                }
                prop_assert_eq!((pins.positions(), pins.pulses()), (&sums, &all));
                prop_assert!(pins.edges().is_sorted_by_key(|edge| edge.tick));
            }
            prop_assert!(!pins.emit(timing, &[1000, 1]), "too many for a period");
            prop_assert_eq!(pins.positions(), &[sums[0], sums[1] + 1]);
        }
    }
}
