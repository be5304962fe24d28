//! Change of tools by the operator, `[manual_tool_change]` (PRB-21).
//!
//! Invariant: a tool is measured only on a machine with a probe, and where the setter, or the surface that it touches,
//! is known.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::NumberedError;
use crate::probe_config::ProbeConfig;
use crate::value_range::within;

/// Tool change at M6.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ToolChange {
    /// The machine changes the tool, or no change is needed.
    #[default]
    Automatic,
    /// The operator changes the tool: M6 stops, shows the tool, and waits for cycle start (PRB-21).
    Manual,
}

/// How a changed tool is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum ToolMeasurement {
    /// It is not: the tool table has its length.
    #[default]
    None,
    /// At the tool setter, `probe.setter_mm`.
    Setter,
    /// Touched off at the work or at a touch plate, `touch_mm`.
    Touch,
}

/// Change of tools by the operator, `[manual_tool_change]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ToolChangeSection {
    /// Machine coordinates in mm where the tool is changed: X, Y, Z. M6 goes up or down to Z first. Without it M6 does
    /// not move.
    position_mm: Option<[f64; 3]>,
    /// Whether the tool is measured behind the change.
    measure: ToolMeasurement,
    /// Where the tool is touched off, mm in the work coordinates in force: X, Y, and the height of the surface there.
    touch_mm: Option<[f64; 3]>,
    /// Maximum travel in mm down to the tool setter, or to the surface.
    travel_mm: f64,
}

impl Default for ToolChangeSection {
    fn default() -> Self {
        Self { position_mm: None, measure: ToolMeasurement::None, touch_mm: None, travel_mm: 100.0 }
    }
}

/// Change of tools by the operator, checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ToolChangeConfig {
    /// Machine coordinates where the tool is changed, mm: X, Y, Z.
    pub position_mm: Option<[f64; 3]>,
    /// Maximum travel down to the tool setter or the surface, mm, where the tool is measured behind the change.
    pub measured_within_mm: Option<f64>,
    /// Where it is touched off, in mm of the work coordinates in force; `None`: at the tool setter.
    pub touch_mm: Option<[f64; 3]>,
}

impl ToolChangeConfig {
    /// Whether M6 does more than stop and wait for the operator.
    #[must_use]
    pub const fn is_subprogram(&self) -> bool {
        self.position_mm.is_some() || self.measured_within_mm.is_some()
    }
}

impl ToolChangeSection {
    /// Checks the section.
    pub(crate) fn checked(self, change: ToolChange, probe: &ProbeConfig) -> Result<ToolChangeConfig, NumberedError> {
        let refused = |cause: &str, remedy: &str| Err(NumberedError::new("E2112", cause.to_owned(), remedy));
        for mm in self.position_mm.unwrap_or_default() {
            within("manual_tool_change.position_mm", mm, -1e6, 1e6)?;
        }
        within("manual_tool_change.travel_mm", self.travel_mm, 0.1, 10_000.0)?;
        if self != Self::default() && change != ToolChange::Manual {
            return refused(
                "[manual_tool_change] of a machine that changes its tools itself",
                "tool_change = \"manual\"",
            );
        }
        for mm in self.touch_mm.unwrap_or_default() {
            within("manual_tool_change.touch_mm", mm, -1e6, 1e6)?;
        }
        let touches = self.measure == ToolMeasurement::Touch;
        if touches && (probe.input.is_none() || self.touch_mm.is_none()) {
            return refused(
                "manual_tool_change.measure = \"touch\" needs a probe input and the place of the surface",
                "declare [[card.input]] with use = \"probe\", and touch_mm in [manual_tool_change]",
            );
        }
        if !touches && self.touch_mm.is_some() {
            return refused("manual_tool_change.touch_mm of a tool that is not touched off", "measure = \"touch\"");
        }
        let at_setter = self.measure == ToolMeasurement::Setter;
        if at_setter && (probe.input.is_none() || probe.setter_mm.is_none()) {
            return refused(
                "manual_tool_change.measure needs a probe input and the position of the tool setter",
                "declare [[card.input]] with use = \"probe\", and setter_mm in [probe]",
            );
        }
        let measured_within_mm = (at_setter || touches).then_some(self.travel_mm);
        Ok(ToolChangeConfig { position_mm: self.position_mm, measured_within_mm, touch_mm: self.touch_mm })
    }
}
