//! The order of arming and marking of a scribe: `marker` of a `[[cutter]]` (CUT-21).
//!
//! Invariant: the marker is armed before it is on, and off before it is disarmed.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Times of a marker, `marker` of a `[[cutter]]`: the code that switches it on then switches `arm`, too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MarkerStart {
    /// Time in ms from `arm` to the output of the marker.
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub arm_ms: f64,
    /// Time in ms from the output of the marker to the first motion.
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub on_ms: f64,
}

impl MarkerStart {
    /// Checks the figures of the cutter of this name.
    ///
    /// # Errors
    /// `E2112`
    pub(crate) fn check(&self, cutter: &str) -> Result<(), NumberedError> {
        within(&format!("cutter {cutter}: marker.arm_ms"), self.arm_ms, 0.0, 10_000.0)?;
        within(&format!("cutter {cutter}: marker.on_ms"), self.on_ms, 0.0, 10_000.0)
    }
}
