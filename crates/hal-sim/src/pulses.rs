//! Counters of the pulses from the simulated card's step and direction pins.
//!
//! Invariant: one count per pulse, up or down with the direction pin.

use retrace_core::fine::pulse_slots;

/// Slots of the fine interpolation in a control period.
const SLOTS: u32 = 1 << 16;

/// Position and number of pulses of each axis.
#[derive(Clone, Debug)]
pub struct PulseCounters<const A: usize> {
    positions: [i64; A],
    pulses: [u64; A],
}

impl<const A: usize> Default for PulseCounters<A> {
    fn default() -> Self {
        Self { positions: [0; A], pulses: [0; A] }
    }
}

impl<const A: usize> PulseCounters<A> {
    /// Emits the increments of one period, each as evenly spaced pulses. Returns false, with nothing emitted, where an
    /// axis has more pulses than a period has slots.
    #[must_use]
    pub fn emit(&mut self, increments: &[i32; A]) -> bool {
        if increments.iter().any(|i| i.unsigned_abs() >= SLOTS) {
            return false;
        }
        for (axis, &increment) in increments.iter().enumerate() {
            let direction = i64::from(increment.signum());
            for _slot in pulse_slots(increment.unsigned_abs() as u16, SLOTS) {
                self.positions[axis] += direction;
                self.pulses[axis] += 1;
            }
        }
        true
    }

    /// Net pulses of each axis.
    #[must_use]
    pub fn positions(&self) -> &[i64; A] {
        &self.positions
    }

    /// All pulses of each axis, in either direction.
    #[must_use]
    pub fn pulses(&self) -> &[u64; A] {
        &self.pulses
    }
}
