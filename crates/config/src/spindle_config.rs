//! The spindle, `[spindle]` (SPN-1, SPN-8).
//!
//! Invariant: without a word about it, nothing follows a spindle that the card does not measure.

use schemars::JsonSchema;
use serde::Deserialize;

/// What the feed of G95 follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FeedPerTurn {
    /// The measured speed, which needs an encoder: no card reads one yet, and G95 is refused.
    #[default]
    Measured,
    /// The commanded speed, S: the spindle is taken to turn at it.
    Commanded,
}

/// The spindle, `[spindle]`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct SpindleSection {
    /// What the feed of G95 follows.
    pub(crate) feed_per_turn: FeedPerTurn,
    /// Highest speed in turns per minute under G96. Without it, G96 needs a D word.
    #[schemars(range(min = 1.0, max = 1_000_000.0))]
    pub(crate) max_rpm: Option<f64>,
    /// Lowest speed in turns per minute under G96.
    #[schemars(range(min = 0.0, max = 1_000_000.0))]
    pub(crate) min_rpm: f64,
    /// Output by which M19 tells the drive to turn the spindle to its angle and to hold it there.
    #[schemars(range(max = 63))]
    pub(crate) orient_output: Option<u8>,
    /// Input by which the drive reports that the spindle is at its angle.
    #[schemars(range(max = 15))]
    pub(crate) orient_input: Option<u8>,
    /// Angle of the drive in degrees: the only R that M19 may have.
    #[schemars(range(min = 0.0, max = 360.0))]
    pub(crate) orient_angle_deg: f64,
}
