//! The level of an output pin, from the channels of the card's outputs.
//!
//! Invariant: a channel that is 0 makes every pin low.

use retrace_link::Outputs;

/// Condition under which an output pin is high.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum High {
    /// While the channel is not 0.
    NotZero(u8),
    /// While the channel is above 0.
    Above(u8),
    /// While the channel is below 0.
    Below(u8),
    /// While one of the channels is not 0.
    Either(u8, u8),
}

impl High {
    /// Whether the pin is high with these outputs.
    #[must_use]
    pub fn is_met(self, outputs: &Outputs) -> bool {
        match self {
            Self::NotZero(channel) => outputs[usize::from(channel)] != 0,
            Self::Above(channel) => outputs[usize::from(channel)] > 0,
            Self::Below(channel) => outputs[usize::from(channel)] < 0,
            Self::Either(one, other) => outputs[usize::from(one)] != 0 || outputs[usize::from(other)] != 0,
        }
    }
}
