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
}
