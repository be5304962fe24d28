//! What the main loop orders of a board's step generator for one control period.
//!
//! Invariant: a batch whose shape differs from that of the batch before it has no pulses, so that the directions are
//! stable before the first step.

use crate::AXES;
use retrace_link::CardSettings;

/// Step timing from the host's settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepShape {
    /// Control period in microseconds.
    pub period_us: u32,
    /// Minimum length of a step pulse, in nanoseconds.
    pub pulse_ns: u16,
    /// Time that the direction is stable before a step, in nanoseconds.
    pub setup_ns: u16,
    /// Axes whose direction output is inverted, one bit each.
    pub inverted: u16,
}

impl StepShape {
    /// Step timing before the first settings: a period of 1 ms.
    pub const INITIAL: Self = Self { period_us: 1000, pulse_ns: 2000, setup_ns: 5000, inverted: 0 };

    /// Returns the step timing of the host's settings.
    #[must_use]
    pub fn of(settings: &CardSettings<AXES>) -> Self {
        Self {
            period_us: settings.period_us,
            pulse_ns: settings.pulse_ns,
            setup_ns: settings.direction_setup_ns,
            inverted: settings.direction_inverted,
        }
    }
}

/// Net pulses of each axis in a control period, and their step timing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepBatch<const A: usize> {
    /// Net pulses of each axis.
    pub increments: [i32; A],
    /// Step timing.
    pub shape: StepShape,
}
