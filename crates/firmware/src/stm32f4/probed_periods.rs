//! Places the captured edge of the probe in the control periods that the pins have made.
//!
//! A batch is taken up to two buffers before the pins make it. The card can be given an edge of the period before the
//! one whose batch was taken last, and of no earlier one; so while an edge is awaited the next period is computed once
//! the pins have begun the one that was taken last ([`has_begun`]).
//!
//! Invariant: slots are those of the step generator itself, counted by a timer from its start, so that a late period or
//! a late interrupt moves no edge to other pulses.

use super::period::SLOTS_PER_US;
use crate::step_batch::StepShape;

/// Shortest control period in which the edge is captured, in microseconds: while it is awaited, a period is computed in
/// what two buffers leave of it.
pub const MIN_CAPTURE_PERIOD_US: u32 = 1000;

/// Whether the pins have begun the period that begins at slot `begins`. `count`: slots that have begun.
#[must_use]
pub const fn has_begun(begins: u32, count: u32) -> bool {
    (count.wrapping_sub(begins) as i32) > 0
}

/// The period before the one whose batch was taken last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProbedPeriods {
    begins: u32,
    slots: u32,
}

impl ProbedPeriods {
    /// Creates one that knows no period.
    #[must_use]
    pub const fn new() -> Self {
        Self { begins: 0, slots: 0 }
    }

    /// Records that a batch is put behind the one that was taken last, whose period begins at slot `begins`.
    pub const fn put(&mut self, begins: u32, shape: &StepShape) {
        *self = Self { begins, slots: shape.period_us * SLOTS_PER_US };
    }

    /// Returns the part of the period in which the edge was, in units of 2⁻¹⁶; `None` if it is in the one that was
    /// taken last, which begins at slot `next_begins`. `count`: slots that had begun at the edge.
    #[must_use]
    pub fn edge_part(&self, count: u32, next_begins: u32) -> Option<u16> {
        if has_begun(next_begins, count) {
            return None;
        }
        // the pulses of the slot in which the edge was had been made
        let made = count.wrapping_sub(self.begins);
        if made == 0 || made > u32::MAX / 2 {
            // before its begin, where the machine was at rest
            return Some(0);
        }
        let (made, slots) = (made.min(self.slots), self.slots.max(1));
        let part = ((u64::from(made) << 16).div_ceil(u64::from(slots))).saturating_sub(1);
        Some(part.min(u64::from(u16::MAX)) as u16)
    }
}

#[cfg(test)]
mod tests {
    use super::super::axis_edges::SlotTimes;
    use super::super::dma_model::{Drives, Stream};
    use super::super::step_mailbox::StepMailbox;
    use super::*;
    use crate::AXES;
    use crate::probe_capture::ProbeCapture;
    use crate::step_batch::StepBatch;
    use proptest::prelude::*;
    use retrace_card::AwaitedProbe;
    use retrace_link::ProbeEdge;

    const AWAITED: AwaitedProbe = AwaitedProbe { input: 0, is_high: false };

    /// A probing move at the model of the DMA.
    struct Probing {
        shape: StepShape,
        /// Pulses of the period of this number.
        increments: fn(usize) -> [i32; AXES],
        /// Slots from the moment at which a period may be computed to its batch.
        lag: usize,
        latency: usize,
        /// Slot behind whose word the probe closes, and slots for which it is closed.
        edge: u32,
        closed: u32,
    }

    impl Probing {
        /// Runs it until the card has an edge: returns the counts that the card calculates, and those of the drives
        /// behind the words before the edge, of its slot, and of the next one.
        fn run(&self) -> ([i64; AXES], [[i32; AXES]; 3]) {
            let (mut stream, mut drives, mailbox) = (Stream::new(), Drives::new(), StepMailbox::new());
            let (mut capture, mut periods, times) =
                (ProbeCapture::new(), ProbedPeriods::new(), SlotTimes::of(&self.shape));
            capture.begin(Some(AWAITED));
            let (mut computed, mut waited, mut counts, mut captured) = (0, 0, [0i64; AXES], None);
            let (mut made, mut touch) = ([[0; AXES]; 3], None);
            for count in 0u32.. {
                // before word `count`
                if mailbox.is_free() && has_begun(mailbox.begins(), count) {
                    waited += 1;
                }
                if waited > self.lag {
                    waited = 0;
                    let edge = captured.and_then(|captured| periods.edge_part(captured, mailbox.begins()));
                    let is_closed = count > self.edge && count <= self.edge + self.closed;
                    let (levels, probe) = capture.read(u16::from(!is_closed), edge);
                    if levels == 0 || probe.first_change.is_some() {
                        let part = probe.first_change.unwrap_or(u16::MAX);
                        let of = |number: usize| (self.increments)(number);
                        let (last, earlier) = (of(computed.max(1) - 1), of(computed.max(2) - 2));
                        let edge = ProbeEdge { is_period_earlier: probe.is_period_behind, part };
                        touch.get_or_insert(edge.touch(&counts, &last, &earlier));
                    }
                    let increments = (self.increments)(computed);
                    let batch = StepBatch { increments, shape: self.shape };
                    periods.put(mailbox.begins(), &self.shape);
                    assert!(mailbox.put(&batch));
                    counts.iter_mut().zip(increments).for_each(|(count, more)| *count += i64::from(more));
                    computed += 1;
                }
                drives.see(stream.tick(&mailbox, self.latency), &times, 0);
                if let Some(n) = (count + 1).checked_sub(self.edge).filter(|&n| n < 3) {
                    made[n as usize] = drives.counts;
                }
                if count == self.edge {
                    captured = Some(count + 1);
                }
                if let Some(touch) = touch.filter(|_| count > self.edge + 2) {
                    return (touch, made);
                }
                assert!(count < self.edge + 6 * (times.period + self.lag as u32) + 4000, "no touch");
            }
            unreachable!()
        }

        /// Checks that the touch has the pulses of the slot of the edge, up to a slot.
        fn check(&self) {
            let (touch, [before, _, behind]) = self.run();
            for axis in 0..AXES {
                let [before, behind] = [before, behind].map(|counts| i64::from(counts[axis]));
                let (low, high) = (before.min(behind), before.max(behind));
                assert!((low..=high).contains(&touch[axis]), "axis {axis}: {} of {low} … {high}", touch[axis]);
            }
        }
    }

    /// Steady motion behind a period in which the directions are set: the pulses of such a period begin later, by up to
    /// the set-up, which the card does not know.
    fn steady(number: usize) -> [i32; AXES] {
        if number == 0 { [1, -1, 1, 1] } else { [37, -211, 0, 1] }
    }

    /// Another rate in each period, without a reversal.
    fn changing(number: usize) -> [i32; AXES] {
        let n = number as i32;
        if number == 0 { steady(0) } else { [n * 29 % 240, -(n * 7 % 50), n % 2, 1] }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        /// Wherever the edge is, with any latency of the interrupt and any time of computation that makes no period
        /// late: the touch has the pulses that the drives had seen.
        #[test]
        fn a_touch_has_the_pulses_of_the_slot_of_its_edge(
            period_us in MIN_CAPTURE_PERIOD_US..3000, lag in 0usize..900, latency in 0usize..400,
            edge in 8000u32..40_000, closed in prop_oneof![1u32..10_000, Just(100_000)], is_steady: bool,
        ) {
            let shape = StepShape { period_us, pulse_ns: 1500, ..StepShape::INITIAL };
            let increments = if is_steady { steady } else { changing };
            Probing { shape, increments, lag, latency, edge, closed }.check();
        }

        /// A main loop that makes every period late, too.
        #[test]
        fn a_late_period_moves_no_edge(lag in 1000usize..9000, edge in 14_000u32..60_000) {
            let shape = StepShape { pulse_ns: 1500, ..StepShape::INITIAL };
            Probing { shape, increments: steady, lag, latency: 100, edge, closed: 100_000 }.check();
        }
    }

    #[test]
    fn an_edge_has_the_part_of_its_slot_where_the_count_wraps_around() {
        let begins = u32::MAX - 999;
        let mut periods = ProbedPeriods::new();
        periods.put(begins, &StepShape::INITIAL);
        let next = begins.wrapping_add(2000);
        let part = |slots: u32| periods.edge_part(begins.wrapping_add(slots), next);
        assert_eq!([part(0), part(1), part(1000), part(2000)], [Some(0), Some(32), Some(32_767), Some(u16::MAX)]);
        assert_eq!(part(2001), None, "of the next one");
        assert_eq!(periods.edge_part(begins.wrapping_sub(5), next), Some(0), "before it");
        // a late one begins behind a gap, in which nothing moves
        assert_eq!(periods.edge_part(begins.wrapping_add(2600), next.wrapping_add(900)), Some(u16::MAX));
    }
}
