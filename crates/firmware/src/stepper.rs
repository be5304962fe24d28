//! Stand-in for the card crate's step and direction generator, until that is merged.
//!
//! Invariant: a period with an increment of p pulses raises the step output |p| times.

use retrace_core::fine::Pulses;

/// Levels of an axis' two outputs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    /// The step output.
    pub step: bool,
    /// The direction output: high is positive.
    pub direction: bool,
}

/// One axis.
#[derive(Clone, Copy, Debug)]
pub struct StepDirection {
    pulses: Pulses,
    levels: Levels,
}

impl StepDirection {
    /// At rest, forward.
    #[must_use]
    pub const fn new() -> Self {
        Self { pulses: Pulses::new(0, 2), levels: Levels { step: false, direction: true } }
    }

    /// Begins a period of `slots` slots.
    pub fn begin(&mut self, increment: i32, slots: u32, _pulse: u32, _setup: u32) {
        self.pulses = Pulses::new(increment.unsigned_abs() as u16, slots);
        if increment != 0 {
            self.levels.direction = increment > 0;
        }
    }

    /// Goes one slot on.
    pub fn tick(&mut self) -> Levels {
        self.levels.step = self.pulses.slot();
        self.levels
    }
}

impl Default for StepDirection {
    fn default() -> Self {
        Self::new()
    }
}
