//! What the step interrupt does in a slot: four axes' steps and directions, as one word for the port.
//!
//! Invariant: every pulse of every order that was taken appears once at the port, in the slots of that order's period; a period that has
//! no order yet waits, and nothing moves meanwhile.

use crate::AXES;
use crate::handover::{Handover, Order};
use crate::pins::axes_word;
use crate::stepper::{Levels, StepDirection};

/// The steppers of all axes, and where in the period they are.
pub struct Steps {
    steppers: [StepDirection; AXES],
    levels: [Levels; AXES],
    /// Slots left of the period; 0: the next one is due.
    left: u32,
    inverted: u16,
    /// Rising edges less those with the direction output low, of each axis: counted at the output.
    counted: [i32; AXES],
}

/// What a slot asks of the hardware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slot {
    /// What is stored to the bit set/reset register of the axes' port.
    pub word: u32,
    /// A period began, whose slots are as many ticks of the timer long.
    pub began: Option<u32>,
}

impl Steps {
    /// All outputs low, nothing to do.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            steppers: [const { StepDirection::new() }; AXES],
            levels: [Levels { step: false, direction: false }; AXES],
            left: 0,
            inverted: 0,
            counted: [0; AXES],
        }
    }

    /// Goes one slot on. `None` where no order is there: the outputs stay as they are, which is all steps low.
    pub fn slot(&mut self, orders: &Handover<AXES>) -> Option<Slot> {
        let mut began = None;
        if self.left == 0 {
            let order = orders.take()?;
            self.begin(&order);
            began = Some(order.period.ticks_per_slot);
        }
        self.left -= 1;
        for axis in 0..AXES {
            let now = self.steppers[axis].tick();
            if now.step && !self.levels[axis].step {
                let count = &mut self.counted[axis];
                *count = if now.direction { count.wrapping_add(1) } else { count.wrapping_sub(1) };
            }
            self.levels[axis] = now;
        }
        Some(Slot { word: axes_word(&self.levels, self.inverted), began })
    }

    fn begin(&mut self, order: &Order<AXES>) {
        let slots = order.period.slots.max(1);
        for (stepper, &increment) in self.steppers.iter_mut().zip(&order.increments) {
            stepper.begin(increment, slots, u32::from(order.pulse_slots), u32::from(order.setup_slots));
        }
        self.left = slots;
        self.inverted = order.inverted;
    }

    /// Is a period under way?
    #[must_use]
    pub const fn in_period(&self) -> bool {
        self.left > 0
    }

    /// Net pulses of each axis since the start, as the outputs showed them; they wrap around.
    #[must_use]
    pub const fn counted(&self) -> &[i32; AXES] {
        &self.counted
    }
}

impl Default for Steps {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::period::Period;
    use crate::pins::AXIS_PINS;
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
            for (axis, pins) in AXIS_PINS.iter().enumerate() {
                let rises = !before & self.port & (1 << pins.step) != 0;
                let up = (self.port >> pins.direction & 1 == 1) != (inverted >> axis & 1 == 1);
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
        /// Any orders: the drives have counted their sum, and so has the interrupt itself.
        #[test]
        fn drives_count_what_was_ordered(
            orders in prop::collection::vec(prop::array::uniform4(-12i32..=12), 1..20),
            inverted in 0u16..16,
        ) {
            let handover = Handover::new();
            let mut steps = Steps::new();
            let mut drives = Drives { port: 0, counts: [0; AXES] };
            let mut sum = [0; AXES];
            for increments in orders {
                prop_assert_eq!(steps.slot(&handover), None);
                let period = Period { slots: 100, ticks_per_slot: 840 };
                let order = Order { increments, period, pulse_slots: 1, setup_slots: 1, inverted };
                prop_assert!(handover.put(&order));
                for n in 0..100 {
                    let slot = steps.slot(&handover).expect("a period is under way");
                    prop_assert_eq!(slot.began, (n == 0).then_some(840));
                    drives.see(slot.word, inverted);
                }
                prop_assert!(!steps.in_period());
                for axis in 0..AXES { sum[axis] += increments[axis]; }
                prop_assert_eq!(drives.counts, sum);
                prop_assert_eq!(steps.counted(), &sum);
            }
        }
    }
}
