//! The work of the step interrupt in a slot: steps and directions of four axes, as one word for the port.
//!
//! Invariant: every pulse of every batch that was taken is emitted once at the port, in the slots of that batch's
//! period. If a period has no batch yet, it waits, and nothing moves meanwhile.

use retrace_card::{StepDirection, StepTiming};

use super::period::{Period, SLOT_HZ};
use super::pins::axes_word;
use super::step_mailbox::StepMailbox;
use crate::AXES;
use crate::step_batch::{StepBatch, StepShape};

/// Steppers of all axes, and the position within the period.
pub struct Steps {
    steppers: [StepDirection; AXES],
    /// Axes whose step is high, and those that move backward, one bit each.
    high: u32,
    backward: u32,
    /// Step timing.
    shape: StepShape,
    period: Period,
    timer_hz: u32,
    /// Remaining slots of the period; 0: the next period is due.
    left: u32,
    /// Pulses forward minus pulses backward of each axis: counted at the output.
    counted: [i32; AXES],
    /// Batches whose pulses did not fit their period and were not emitted: a defect.
    refused: u32,
}

/// Action that a slot requires of the hardware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    /// Value for the bit set/reset register of the axes' port.
    pub word: u32,
    /// Timer ticks per slot of a period that began with this slot.
    pub began: Option<u32>,
}

impl Steps {
    const TIMING: StepTiming = match timing(StepShape::INITIAL) {
        Some(timing) => timing,
        None => unreachable!(),
    };

    /// Creates an idle state for a timer of `timer_hz` ticks per second.
    #[must_use]
    pub const fn new(timer_hz: u32) -> Self {
        Self {
            steppers: [const { StepDirection::new(Self::TIMING) }; AXES],
            high: 0,
            backward: 0,
            shape: StepShape::INITIAL,
            period: Period::new(StepShape::INITIAL.period_us, timer_hz),
            timer_hz,
            left: 0,
            counted: [0; AXES],
            refused: 0,
        }
    }

    /// Advances by one slot. Returns `None` if no batch is available: the outputs are unchanged, with all steps low.
    #[inline]
    pub fn next_slot(&mut self, orders: &StepMailbox<AXES>) -> Option<Slot> {
        let mut began = None;
        if self.left == 0 {
            let order = orders.take()?;
            self.begin_period(&order);
            began = Some(self.period.ticks_per_slot);
        }
        self.left -= 1;
        let (mut high, mut backward) = (0, 0);
        for (axis, stepper) in self.steppers.iter_mut().enumerate() {
            let levels = stepper.tick();
            high |= u32::from(levels.step) << axis;
            backward |= u32::from(levels.backward) << axis;
        }
        let rising = high & !self.high;
        (self.high, self.backward) = (high, backward);
        if rising != 0 {
            self.count_pulses(rising);
        }
        Some(Slot { word: axes_word(high, backward, u32::from(self.shape.inverted)), began })
    }

    fn count_pulses(&mut self, rising: u32) {
        for (axis, count) in self.counted.iter_mut().enumerate().filter(|(axis, _)| rising >> axis & 1 == 1) {
            *count = if self.backward >> axis & 1 == 1 { count.wrapping_sub(1) } else { count.wrapping_add(1) };
        }
    }

    fn begin_period(&mut self, order: &StepBatch<AXES>) {
        if order.shape != self.shape {
            self.set_shape(order.shape);
        }
        for (stepper, &increment) in self.steppers.iter_mut().zip(&order.increments) {
            if stepper.begin_period(increment).is_err() {
                self.refused = self.refused.wrapping_add(1);
            }
        }
        self.left = self.period.slots;
    }

    /// Sets a new step timing. The direction outputs become forward with it, so the batch with a new shape must have no
    /// pulses.
    fn set_shape(&mut self, shape: StepShape) {
        // settings accepted by the card always have one
        if let Some(timing) = timing(shape) {
            self.steppers = [const { StepDirection::new(Self::TIMING) }; AXES].map(|_| StepDirection::new(timing));
            self.period = Period::new(shape.period_us, self.timer_hz);
        }
        self.shape = shape;
    }

    /// Whether a period is in progress.
    #[must_use]
    pub const fn in_period(&self) -> bool {
        self.left > 0
    }

    /// Returns the net pulses of each axis since the start, as emitted at the outputs; they wrap around.
    #[must_use]
    pub const fn counted(&self) -> &[i32; AXES] {
        &self.counted
    }

    /// Returns the number of batches whose pulses did not fit their period: a defect.
    #[must_use]
    pub const fn refused(&self) -> u32 {
        self.refused
    }
}

/// Returns the step timing in slots.
const fn timing(shape: StepShape) -> Option<StepTiming> {
    StepTiming::of_clock(SLOT_HZ, shape.period_us, shape.pulse_ns, shape.setup_ns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stm32f4::pins::{FIRST_DIRECTION_PIN, FIRST_STEP_PIN};
    use proptest::prelude::*;

    /// What a drive makes of a port's levels: counts on rising edges of its step input, by its direction input.
    struct Drives {
        port: u32,
        counts: [i32; AXES],
    }

    impl Drives {
        fn see(&mut self, word: u32, inverted: u16) {
            let before = self.port;
            self.port = (self.port & !(word >> 16)) | (word & 0xffff);
            for axis in 0..AXES {
                let rises = (!before & self.port) >> (usize::from(FIRST_STEP_PIN) + axis) & 1 == 1;
                let high = self.port >> (usize::from(FIRST_DIRECTION_PIN) + axis) & 1 == 1;
                let up = high != (inverted >> axis & 1 == 1);
                self.counts[axis] += if rises && up {
                    1
                } else if rises {
                    -1
                } else {
                    0
                };
            }
        }
    }

    proptest! {
        /// Any orders, of any shape: the drives have counted their sum, and so has the interrupt itself.
        #[test]
        fn drives_count_what_was_ordered(
            runs in prop::collection::vec(
                (0u32..4, 1u16..25_000, 1u16..25_000, 0u16..16,
                    prop::collection::vec(prop::array::uniform4(-9i32..=9), 0..9)),
                1..6,
            ),
        ) {
            let mailbox = StepMailbox::new();
            let mut steps = Steps::new(84_000_000);
            let mut drives = Drives { port: 0, counts: [0; AXES] };
            let mut sum = [0; AXES];
            for (periods, pulse_ns, setup_ns, inverted, increments) in runs {
                let shape = StepShape { period_us: 1000 + periods * 500, pulse_ns, setup_ns, inverted };
                for increments in [[0; AXES]].into_iter().chain(increments) {
                    prop_assert_eq!(steps.next_slot(&mailbox), None);
                    prop_assert!(mailbox.put(&StepBatch { increments, shape }), "free");
                    let slots = shape.period_us / 10;
                    for n in 0..slots {
                        let slot = steps.next_slot(&mailbox).expect("a period is under way");
                        prop_assert_eq!(slot.began, (n == 0).then_some(840));
                        drives.see(slot.word, inverted);
                    }
                    prop_assert!(!steps.in_period());
                    for axis in 0..AXES { sum[axis] += increments[axis]; }
                    prop_assert_eq!(drives.counts, sum);
                    prop_assert_eq!((steps.counted(), steps.refused()), (&sum, 0));
                }
            }
        }
    }
}
