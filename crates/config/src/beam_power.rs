//! The power output of a beam: `power` of a `[[cutter]]` (CUT-20).
//!
//! Invariant: the least power is a share of S from 0 to 1.

use retrace_core::FeedShare;
use retrace_link::{BeamPower, LINEAR_POWER};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Power output of a beam, `power` of a `[[cutter]]`: S is its power, constant with M3, by the speed with M4.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BeamPowerConfig {
    /// The power with M4 is S times the share of the feed raised to this: 0.25 to 4, in steps of 0.25.
    #[schemars(range(min = 0.25, max = 4.0))]
    pub exponent: f64,
    /// Least power in motion with M4, in percent of S.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub least_percent: f64,
    /// Number behind E with which M67 and M68 set the power, as S does.
    #[schemars(range(max = 63))]
    pub analog: Option<u8>,
}

impl Default for BeamPowerConfig {
    fn default() -> Self {
        Self { exponent: 1.0, least_percent: 0.0, analog: None }
    }
}

impl BeamPowerConfig {
    /// Checks the figures of the cutter of this name.
    ///
    /// # Errors
    /// `E2112`
    pub(crate) fn check(&self, cutter: &str) -> Result<(), NumberedError> {
        let named = format!("cutter {cutter}: power.exponent");
        within(&named, self.exponent, 0.25, 4.0)?;
        if (self.exponent * 4.0).fract() != 0.0 {
            let cause = format!("{named} = {}", self.exponent);
            return Err(NumberedError::new("E2112", cause, "a number from 0.25 to 4 in steps of 0.25"));
        }
        within(&format!("cutter {cutter}: power.least_percent"), self.least_percent, 0.0, 100.0)?;
        within(&format!("cutter {cutter}: power.analog"), f64::from(self.analog.unwrap_or(0)), 0.0, 63.0)
    }

    /// Settings for the card; the beam is on this channel.
    pub(crate) fn settings(&self, channel: u8) -> BeamPower {
        let units = self.least_percent / 100.0 * f64::from(FeedShare::FEED.units());
        let exponent = (self.exponent * f64::from(LINEAR_POWER)) as u8;
        BeamPower { channel, least: FeedShare::from_units(units.round() as u16), exponent }
    }
}
