//! The edges of one axis in a control period, slot by slot, in pieces of any length.
//!
//! Invariant: they are those of `retrace_card::StepDirection`, whose spacing is that of `core::fine`; tests compare
//! them. Nothing is divided per pulse.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use super::period::{SLOT_NS, SLOTS_PER_US};
use crate::step_batch::StepShape;

/// Times of the steps, in slots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotTimes {
    /// A control period.
    pub period: u32,
    /// A step is high for exactly this, and low for at least as long.
    pub pulse: u32,
    /// The direction is stable for this before a step and after it.
    pub setup: u32,
}

impl SlotTimes {
    /// Returns the times of a step timing: no time is shorter than requested.
    #[must_use]
    pub const fn of(shape: &StepShape) -> Self {
        Self { period: shape.period_us * SLOTS_PER_US, pulse: slots(shape.pulse_ns), setup: slots(shape.setup_ns) }
    }
}

/// Returns the slots that last at least `ns`, and at least one.
const fn slots(ns: u16) -> u32 {
    let slots = (ns as u32).div_ceil(SLOT_NS);
    if slots == 0 { 1 } else { slots }
}

/// The words that make the edges of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EdgeWords {
    /// A step begins.
    pub rise: u32,
    /// A step ends.
    pub fall: u32,
    /// The direction is that of the period.
    pub direction: u32,
}

/// Error: the increment has more pulses than fit the control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisEdgesError;

impl core::fmt::Display for AxisEdgesError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("more pulses than fit the control period")
    }
}

impl core::error::Error for AxisEdgesError {}

/// A slot that does not come.
const NEVER: u32 = u32::MAX;

/// Edges of an axis, from period to period.
#[derive(Clone, Copy, Debug)]
pub struct AxisEdges {
    backward: bool,
    /// Slots from the last falling edge to the end of the last period.
    since_fall: u32,
    /// Slots of the next edges of each kind.
    turn: u32,
    rise: u32,
    fall: u32,
    /// Pulses that have not begun.
    left: u32,
    /// Pulses of the period.
    count: u32,
    /// Quotient and remainder of their room by their number: slots from one to the next.
    gap: (u32, u32),
    /// Remainder of the place of the next one.
    rest: u32,
}

impl AxisEdges {
    /// Creates an axis that has been at rest in forward direction for long.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            backward: false,
            since_fall: NEVER,
            turn: NEVER,
            rise: NEVER,
            fall: NEVER,
            left: 0,
            count: 0,
            gap: (0, 0),
            rest: 0,
        }
    }

    /// Whether the direction is backward at the end of the period.
    #[must_use]
    pub const fn is_backward(&self) -> bool {
        self.backward
    }

    /// Begins a control period; all edges of the last one have been emitted.
    ///
    /// # Errors
    /// The pulses do not fit: the period has no edges.
    pub const fn begin_period(&mut self, times: &SlotTimes, increment: i32) -> Result<(), AxisEdgesError> {
        let count = increment.unsigned_abs();
        (self.turn, self.rise, self.fall, self.left) = (NEVER, NEVER, NEVER, 0);
        let turns = count > 0 && (increment < 0) != self.backward;
        let turn = times.setup.saturating_sub(self.since_fall);
        let first = if turns { turn + times.setup } else { 0 };
        let room = times.period.saturating_sub(first);
        let too_many = count > u16::MAX as u32 || count as u64 * 2 * times.pulse as u64 > room as u64;
        if count == 0 || too_many {
            self.since_fall = self.since_fall.saturating_add(times.period);
            return if too_many { Err(AxisEdgesError) } else { Ok(()) };
        }
        if turns {
            self.turn = turn;
            self.backward = !self.backward;
        }
        // the k-th pulse is where k · room / count is half passed, rounded up, less 1 (core, `pulse_slots`)
        let half = room - room / 2 - 1;
        (self.count, self.left, self.gap) = (count, count, (room / count, room % count));
        (self.rise, self.rest) = (first + half / count, half % count);
        // behind the last one is half of its share of the time
        self.since_fall = room / 2 / count + 1 - times.pulse;
        Ok(())
    }

    /// Adds the edges in the slots from `from` on to the words of these slots, and returns the number of steps that
    /// begin in them.
    pub fn emit(&mut self, times: &SlotTimes, from: u32, cells: &[AtomicU32], words: &EdgeWords) -> u32 {
        let cell = |slot: u32| cells.get(slot.wrapping_sub(from) as usize);
        if let Some(turn) = cell(self.turn) {
            add(turn, words.direction);
            self.turn = NEVER;
        }
        if let Some(fall) = cell(self.fall) {
            add(fall, words.fall);
            self.fall = NEVER;
        }
        // in the processor's registers: this loop is what the steps cost
        let (mut rise, mut rest, mut left) = (self.rise, self.rest, self.left);
        while left > 0
            && let Some(begin) = cell(rise)
        {
            add(begin, words.rise);
            let fall = rise + times.pulse;
            match cell(fall) {
                Some(end) => add(end, words.fall),
                None => self.fall = fall,
            }
            (rise, rest, left) = (rise + self.gap.0, rest + self.gap.1, left - 1);
            if rest >= self.count {
                (rise, rest) = (rise + 1, rest - self.count);
            }
        }
        let begun = self.left - left;
        (self.rise, self.rest, self.left) = (rise, rest, left);
        begun
    }
}

/// Adds a word to a cell, which this context alone writes.
#[inline(always)]
pub(super) fn add(cell: &AtomicU32, word: u32) {
    cell.store(cell.load(Relaxed) | word, Relaxed);
}

impl Default for AxisEdges {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use retrace_card::{Edge, StepDirection, StepTiming};

    const WORDS: EdgeWords = EdgeWords { rise: 1, fall: 2, direction: 4 };

    /// One period by both, cut into pieces of these lengths; whether it fits.
    fn compare(
        times: &SlotTimes,
        axis: &mut AxisEdges,
        model: &mut StepDirection,
        increment: i32,
        pieces: &[u32],
    ) -> bool {
        let (begun, wanted) = (axis.begin_period(times, increment), model.begin_period(increment));
        assert_eq!(begun.is_ok(), wanted.is_ok(), "{increment} in {times:?}");
        let slots = || (0..times.period).map(|_| AtomicU32::new(0)).collect::<Vec<_>>();
        let (made, expected) = (slots(), slots());
        let (mut from, mut rises) = (0, 0);
        for piece in pieces.iter().chain([&times.period]) {
            let until = (from + piece).min(times.period);
            rises += axis.emit(times, from, &made[from as usize..until as usize], &WORDS);
            from = until;
        }
        for (slot, edge) in model.edges() {
            let word = match edge {
                Edge::Direction { backward } => {
                    assert_eq!(axis.is_backward(), backward);
                    WORDS.direction
                }
                Edge::Rise => WORDS.rise,
                Edge::Fall => WORDS.fall,
            };
            add(&expected[slot as usize], word);
        }
        let levels = |cells: &[AtomicU32]| cells.iter().map(|cell| cell.load(Relaxed)).collect::<Vec<_>>();
        assert_eq!(levels(&made), levels(&expected), "{increment} in {times:?}");
        assert_eq!(rises, if begun.is_ok() { increment.unsigned_abs() } else { 0 });
        begun.is_ok()
    }

    /// Every small timing, every pair of increments with a pause between them or not.
    #[test]
    fn every_short_period_is_that_of_the_card_crate() {
        let mut cases = 0;
        for (period, pulse, setup) in
            (1..=24u32).flat_map(|p| (1..=3).flat_map(move |w| (1..=4).map(move |s| (p, w, s))))
        {
            let Some(timing) = StepTiming::new(period, pulse, setup) else { continue };
            let times = SlotTimes { period, pulse, setup };
            let beyond = (period / pulse / 2) as i32 + 1;
            for first in -beyond..=beyond {
                for (second, pause) in (-beyond..=beyond).flat_map(|s| [(s, false), (s, true)]) {
                    let (mut axis, mut model) = (AxisEdges::new(), StepDirection::new(timing));
                    compare(&times, &mut axis, &mut model, first, &[1, 5, 3]);
                    if pause {
                        assert!(compare(&times, &mut axis, &mut model, 0, &[]));
                    }
                    compare(&times, &mut axis, &mut model, second, &[4, 4, 4]);
                    cases += 1;
                }
            }
        }
        assert!(cases > 20_000, "{cases}");
    }

    #[test]
    fn every_count_of_a_usual_period_is_that_of_the_card_crate() {
        let shape = StepShape { pulse_ns: 1500, ..StepShape::INITIAL };
        let times = SlotTimes::of(&shape);
        let timing = StepTiming::new(times.period, times.pulse, times.setup).expect("fits");
        let (mut axis, mut model) = (AxisEdges::new(), StepDirection::new(timing));
        for count in 0..=i32::from(timing.max_increment()) {
            for increment in [count, -count, -count] {
                assert!(compare(&times, &mut axis, &mut model, increment, &[500, 500, 500]));
            }
        }
    }

    proptest! {
        /// Any periods in a row, cut into any pieces.
        #[test]
        fn any_sequence_is_that_of_the_card_crate(
            period_us in 1u32..5000, pulse_ns in 1u16..12_000, setup_ns in 1u16..,
            shares in prop::collection::vec((-110i32..=110, prop::collection::vec(1u32..4000, 0..6)), 1..12),
        ) {
            let shape = StepShape { period_us, pulse_ns, setup_ns, inverted: 0 };
            let times = SlotTimes::of(&shape);
            let timing = StepTiming::of_clock(super::super::period::SLOT_HZ, period_us, pulse_ns, setup_ns);
            prop_assume!(timing.is_some());
            let timing = timing.unwrap();
            let (mut axis, mut model) = (AxisEdges::new(), StepDirection::new(timing));
            for (share, pieces) in shares {
                let increment = share * i32::from(timing.max_increment()) / 100;
                compare(&times, &mut axis, &mut model, increment, &pieces);
            }
        }
    }
}
