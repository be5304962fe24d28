//! The input that tells whether the probe is plugged in, in a probing move (PRB-9).
//!
//! Invariant: a move does not begin before the input is active, and one in which it was inactive for longer than a
//! flicker is never answered.

/// Time in seconds for which the input may be inactive, or not be reported yet.
const FLICKER_S: f64 = 0.02;

/// What the input tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ProbePlugState {
    /// The probe is plugged in, or the machine has no such input.
    PluggedIn,
    /// The input is not active yet: the move waits.
    Awaited,
    /// The probe is not plugged in, or was pulled out in the move. The number of the input.
    Unplugged(u8),
}

/// The input, watched from the beginning of a move.
#[derive(Clone, Copy, Debug)]
pub(super) struct ProbePlug {
    input: Option<u8>,
    has_begun: bool,
    inactive_periods: u32,
}

impl ProbePlug {
    pub(super) const fn new(input: Option<u8>) -> Self {
        Self { input, has_begun: false, inactive_periods: 0 }
    }

    /// The next move begins.
    pub(super) const fn restart(&mut self) {
        *self = Self::new(self.input);
    }

    /// Watches the inputs of a control period of so many seconds.
    pub(super) fn watch(&mut self, inputs: u16, period_s: f64) -> ProbePlugState {
        let Some(input) = self.input else { return ProbePlugState::PluggedIn };
        let is_unplugged = |periods: u32| f64::from(periods) * period_s > FLICKER_S;
        let is_active = inputs & 1 << input != 0;
        // Plugged in again in the move, it stays unplugged.
        if is_active && !is_unplugged(self.inactive_periods) {
            (self.has_begun, self.inactive_periods) = (true, 0);
            return ProbePlugState::PluggedIn;
        }
        self.inactive_periods = self.inactive_periods.saturating_add(1);
        match is_unplugged(self.inactive_periods) {
            true => ProbePlugState::Unplugged(input),
            false if self.has_begun => ProbePlugState::PluggedIn,
            false => ProbePlugState::Awaited,
        }
    }

    /// Whether the move has begun.
    pub(super) const fn has_begun(&self) -> bool {
        self.has_begun
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn states(inputs: &[u16]) -> Vec<ProbePlugState> {
        let mut plug = ProbePlug::new(Some(3));
        inputs.iter().map(|&inputs| plug.watch(inputs, 0.01)).collect()
    }

    #[test]
    fn a_move_waits_for_the_input_and_bears_a_flicker() {
        use ProbePlugState::{Awaited, PluggedIn, Unplugged};
        assert_eq!(states(&[0, 0, 8, 0, 0, 8]), [Awaited, Awaited, PluggedIn, PluggedIn, PluggedIn, PluggedIn]);
        assert_eq!(states(&[0, 7, 0, 0]), [Awaited, Awaited, Unplugged(3), Unplugged(3)]);
        assert_eq!(states(&[8, 0, 0, 0, 8, 8])[3..], [Unplugged(3); 3], "it is not forgotten in the move");
        let mut plug = ProbePlug::new(None);
        assert_eq!(plug.watch(0, 1.0), PluggedIn);
        let mut plug = ProbePlug::new(Some(3));
        assert_eq!(plug.watch(0, 1.0), Unplugged(3));
        plug.restart();
        assert_eq!(plug.watch(8, 1.0), PluggedIn);
    }
}
