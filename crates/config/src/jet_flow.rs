//! The order of pressure, water and abrasive of a jet: `jet` of a `[[cutter]]` (CUT-18, CUT-19).
//!
//! Invariant: the abrasive is switched within the time for which the water is on, and a stated lead before it.

use retrace_link::{InputWait, MAX_INPUTS};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Pressure, abrasive and purge of a jet, `jet` of a `[[cutter]]`: the code that opens the jet then switches its
/// `pressure` and its `abrasive`, too.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct JetFlow {
    /// Time in s from the water, and its `ok`, to the abrasive.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub abrasive_delay_s: f64,
    /// Time in s by which the abrasive is on before the water: it needs that long through its hose.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub abrasive_lead_s: f64,
    /// Length in mm before the end of a contour from which the abrasive is off: what is in the hose still arrives.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub abrasive_lag_mm: f64,
    /// Time in s for which the water flows on at the end of a contour without abrasive, to clean the mixing tube.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub purge_s: f64,
    /// Input that is active while the pressure is high. Without one, the output is trusted.
    #[schemars(range(max = 15))]
    pub pressure_input: Option<u8>,
    /// Longest time in s from the output of the pressure to that input; later is an alarm.
    #[schemars(range(min = 0.1, max = 60.0))]
    pub pressure_s: f64,
    /// Time in s after which that input usually becomes active. `retrace check` counts it; it has no other effect.
    #[schemars(range(min = 0.0, max = 60.0))]
    pub usual_pressure_s: f64,
}

impl Default for JetFlow {
    fn default() -> Self {
        Self {
            abrasive_delay_s: 0.0,
            abrasive_lead_s: 0.0,
            abrasive_lag_mm: 0.0,
            purge_s: 0.0,
            pressure_input: None,
            pressure_s: 10.0,
            usual_pressure_s: 0.3,
        }
    }
}

impl JetFlow {
    /// Checks the figures of the cutter of this name.
    ///
    /// # Errors
    /// `E2112`
    pub(crate) fn check(&self, cutter: &str) -> Result<(), NumberedError> {
        let named = |what: &str| format!("cutter {cutter}: jet.{what}");
        within(&named("abrasive_delay_s"), self.abrasive_delay_s, 0.0, 10.0)?;
        within(&named("abrasive_lead_s"), self.abrasive_lead_s, 0.0, 10.0)?;
        within(&named("abrasive_lag_mm"), self.abrasive_lag_mm, 0.0, 100.0)?;
        within(&named("purge_s"), self.purge_s, 0.0, 10.0)?;
        let input = f64::from(self.pressure_input.unwrap_or(0));
        within(&named("pressure_input"), input, 0.0, (MAX_INPUTS - 1) as f64)?;
        within(&named("pressure_s"), self.pressure_s, 0.1, 60.0)?;
        within(&named("usual_pressure_s"), self.usual_pressure_s, 0.0, 60.0)?;
        if self.abrasive_delay_s > 0.0 && self.abrasive_lead_s > 0.0 {
            let cause = format!("{} and abrasive_delay_s exclude each other", named("abrasive_lead_s"));
            return Err(NumberedError::new("E2112", cause, "one of them: the abrasive before the water, or behind it"));
        }
        Ok(())
    }

    /// Why it does not fit the outputs of its cutter, if so, and the remedy.
    pub(crate) fn doubt(&self, is_jet: bool, abrasive: bool, pressure: bool) -> Option<(&'static str, &'static str)> {
        if !is_jet || !abrasive && !pressure {
            let remedy = "kind = \"jet\" and the output of the abrasive, or of the pressure";
            return Some(("`jet` without an abrasive or a pressure", remedy));
        }
        if !abrasive && (self.abrasive_lead_s > 0.0 || self.abrasive_lag_mm > 0.0) {
            return Some(("lead or lag of an abrasive without `abrasive`", "the output of the abrasive"));
        }
        let what = ("jet.pressure_input without `pressure`", "the output that raises the pressure");
        (!pressure && self.pressure_input.is_some()).then_some(what)
    }

    /// What high pressure waits for.
    #[must_use]
    pub fn pressure_wait(&self, period_us: u32) -> Option<InputWait> {
        let timeout_periods = (self.pressure_s * 1e6 / f64::from(period_us)).ceil() as u32;
        self.pressure_input.map(|input| InputWait::new(input, true, timeout_periods))
    }
}
