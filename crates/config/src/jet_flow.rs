//! The order of water and abrasive of a jet: `jet` of a `[[cutter]]` (CUT-19).
//!
//! Invariant: the abrasive is switched within the time for which the water is on.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Abrasive and purge of a jet, `jet` of a `[[cutter]]`: the code that opens the jet then switches the abrasive, too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct JetFlow {
    /// Time in s from the water, and its `ok`, to the abrasive.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub abrasive_delay_s: f64,
    /// Length in mm before the end of a contour from which the abrasive is off: what is in the hose still arrives.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub abrasive_lag_mm: f64,
    /// Time in s for which the water flows on at the end of a contour without abrasive, to clean the mixing tube.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub purge_s: f64,
}

impl JetFlow {
    /// Checks the figures of the cutter of this name.
    ///
    /// # Errors
    /// `E2112`
    pub(crate) fn check(&self, cutter: &str) -> Result<(), NumberedError> {
        let named = |what: &str| format!("cutter {cutter}: jet.{what}");
        within(&named("abrasive_delay_s"), self.abrasive_delay_s, 0.0, 10.0)?;
        within(&named("abrasive_lag_mm"), self.abrasive_lag_mm, 0.0, 100.0)?;
        within(&named("purge_s"), self.purge_s, 0.0, 10.0)
    }
}
