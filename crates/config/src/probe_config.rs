//! Probing, `[probe]` (PRB-1, PRB-3, PRB-9, PRB-10).
//!
//! Invariant: a machine has at most one probe, the first input that is declared as one.

use retrace_link::{InputUse, MAX_INPUTS};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::card_config::CardConfig;
use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Whether the spindle may turn in a probing move.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum SpindleInProbing {
    /// A program that probes with the spindle on is refused.
    #[default]
    Off,
    /// It may turn.
    MayTurn,
}

/// Probing, `[probe]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ProbeSection {
    /// Time in µs for which the level of the probe has to stay until the touch counts. What is kept is the first edge.
    filter_us: f64,
    /// Longest way in mm from the touch to where the machine comes to rest. A faster feed is refused.
    overtravel_mm: f64,
    /// Whether a probe that trips in any other move is an alarm.
    guard: bool,
    /// Whether the spindle may turn in a probing move.
    spindle: SpindleInProbing,
}

impl Default for ProbeSection {
    fn default() -> Self {
        Self { filter_us: 0.0, overtravel_mm: 5.0, guard: true, spindle: SpindleInProbing::Off }
    }
}

/// Probing, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeConfig {
    /// Input of the probe; `None` if the machine has none.
    pub input: Option<u8>,
    /// Control periods for which the level has to stay.
    pub filter_periods: u16,
    /// Longest way from the touch to rest, mm.
    pub overtravel_mm: f64,
    /// Whether the spindle may turn in a probing move.
    pub spindle_may_turn: bool,
}

impl ProbeSection {
    /// Checks the section. Without a guard the card sees a plain input.
    pub(crate) fn checked(self, card: &mut CardConfig, period_us: u32) -> Result<ProbeConfig, NumberedError> {
        within("probe.filter_us", self.filter_us, 0.0, 20_000.0)?;
        within("probe.overtravel_mm", self.overtravel_mm, 0.001, 1000.0)?;
        let is_probe = |&input: &u8| card.inputs[usize::from(input)].used_for == InputUse::Probe;
        let input = (0..MAX_INPUTS as u8).find(is_probe);
        if let Some(input) = input.filter(|_| !self.guard) {
            card.inputs[usize::from(input)].used_for = InputUse::Plain;
        }
        Ok(ProbeConfig {
            input,
            filter_periods: (self.filter_us / f64::from(period_us)).ceil() as u16,
            overtravel_mm: self.overtravel_mm,
            spindle_may_turn: self.spindle == SpindleInProbing::MayTurn,
        })
    }
}
