//! The machine file as written, and the errors of its text.
//!
//! Invariant: a missing key has the value of the built-in machine; an unknown key is rejected with the nearest known
//! one.

use std::collections::BTreeMap;

use retrace_motion::{Blending, GlideRatio, RatioOf};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::axis::AxisConfig;
use crate::card_config::CardSection;
use crate::cost_config::CostConfig;
use crate::cutter::CutterSection;
use crate::manual_config::{HomingSection, ManualSection};
use crate::numbered_error::{NumberedError, nearest};
use crate::plan_mode::PlanMode;
use crate::probe_config::ProbeSection;
use crate::serial::SerialSection;
use crate::spindle_config::SpindleSection;
use crate::switching::CodeSettings;
use crate::tool_change_config::{ToolChange, ToolChangeSection};
use crate::value_range::within;

/// Settings of the handwheel.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WheelSettings {
    /// Counts per second of the handwheel that give full rate (1.0).
    #[schemars(range(min = 1.0, max = 100_000.0))]
    pub full_rate_counts_per_s: f64,
    /// Length of the moving average of the handwheel's speed, in ms: 1 to 500 control periods (REV-12).
    pub filter_ms: f64,
}

impl Default for WheelSettings {
    fn default() -> Self {
        Self { full_rate_counts_per_s: 100.0, filter_ms: 100.0 }
    }
}

/// Outputs while retracing (REV-14).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum RetraceOutputs {
    /// The operator switches them manually.
    #[default]
    Manual,
    /// Recorded actions are replayed, also in reverse.
    Replayed,
}

/// What happens to a running program when the page in control of the machine loses its link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum OnLostControl {
    /// It runs on: a tablet that goes to sleep must not spoil a cut.
    #[default]
    Run,
    /// It is held.
    Hold,
}

/// Name of an output, `[[output]]`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct OutputSection {
    /// Number of the output.
    #[schemars(range(max = 63))]
    pub(crate) number: u8,
    /// Name at the screen and in messages.
    pub(crate) name: String,
}

/// Method of blending corners between lines under G64 (SMO-2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum BlendingMethod {
    /// The fastest glide that an optimiser finds.
    #[default]
    Optimum,
    /// The glide of the source document, with a set ratio.
    Source,
}

/// Base of a glide ratio.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum GlideRatioOf {
    /// The lengths of the tracks.
    #[default]
    Length,
    /// The highest speeds of the tracks.
    Speed,
}

/// Blending, `[blending]`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct BlendingSettings {
    /// Method of blending.
    method: BlendingMethod,
    /// Ratio of the `source` method, above 0 and at most 1.
    #[schemars(range(min = 0.0, max = 1.0))]
    glide_ratio: f64,
    /// Base of the ratio.
    ratio_of: GlideRatioOf,
}

impl Default for BlendingSettings {
    fn default() -> Self {
        Self { method: BlendingMethod::Optimum, glide_ratio: 0.2, ratio_of: GlideRatioOf::Length }
    }
}

impl BlendingSettings {
    /// The method, with its ratio checked even if it is not used.
    pub(crate) fn checked(self) -> Result<Blending, NumberedError> {
        let of = match self.ratio_of {
            GlideRatioOf::Length => RatioOf::Length,
            GlideRatioOf::Speed => RatioOf::Speed,
        };
        let ratio = GlideRatio::new(self.glide_ratio, of).map_err(|error| {
            let what = format!("blending.glide_ratio = {}: {error}", self.glide_ratio);
            NumberedError::new("E2112", what, "a number above 0 and at most 1")
        })?;
        Ok(match self.method {
            BlendingMethod::Optimum => Blending::Optimum,
            BlendingMethod::Source => Blending::Source(ratio),
        })
    }
}

/// The machine file of retrace, TOML. A missing key has the value of the built-in machine. On rotary axes read degree
/// for mm.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(title = "Machine file of retrace")]
pub(crate) struct MachineFile {
    /// Name of the machine in reports.
    pub(crate) name: String,
    /// Control period *T* in ms: the time of one record.
    #[schemars(range(min = 0.1, max = 20.0))]
    pub(crate) control_period_ms: f64,
    /// Highest speed along the path in mm/s; rapid moves use it.
    #[schemars(range(min = 0.001, max = 100_000.0))]
    pub(crate) path_velocity_mm_per_s: f64,
    /// Share of acceleration and jerk that the plan leaves, so that the rate can change at any time, in per cent.
    #[schemars(range(min = 1.0, max = 50.0))]
    pub(crate) override_reserve_percent: f64,
    /// Tolerance of a G64 without P in mm.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub(crate) blend_tolerance_mm: f64,
    /// Duration of the motion that can be retraced, in hours.
    #[schemars(range(min = 0.0, max = 24.0))]
    pub(crate) history_hours: f64,
    /// Duration of the motion that is planned ahead, in s.
    #[schemars(range(min = 0.05, max = 10.0))]
    pub(crate) look_ahead_s: f64,
    /// Maximum size of a streamed program that is stored, in MiB.
    #[schemars(range(min = 1.0, max = 1_048_576.0))]
    pub(crate) stream_quota_mib: f64,
    /// Whether the position is known without homing; by default if no axis has a `home`.
    pub(crate) homed: Option<bool>,
    /// Axis that takes the tool away from the work, upward; by default z.
    pub(crate) tool_axis: Option<char>,
    /// Machine position of the tool axis in mm at which the other axes can move safely.
    pub(crate) retract_mm: Option<f64>,
    /// Outputs while retracing.
    pub(crate) retrace_outputs: RetraceOutputs,
    /// Outputs that cut and have no `[[cutter]]`: 64 is then a torch, any other output a jet.
    pub(crate) cutting_outputs: Vec<u8>,
    /// Whether a dry run takes the time of what it leaves off: run-up of a cutter, its pierce, dwells with it on.
    pub(crate) dry_waits: bool,
    /// Cutters: torch, jet, beam, marker, spindle.
    pub(crate) cutter: Vec<CutterSection>,
    /// Rates for the cost of a program.
    pub(crate) cost: Option<CostConfig>,
    /// Names of outputs.
    pub(crate) output: Vec<OutputSection>,
    /// Tool change at M6.
    pub(crate) tool_change: ToolChange,
    /// Change of tools by the operator: where, and whether they are measured.
    pub(crate) manual_tool_change: ToolChangeSection,
    /// The spindle.
    pub(crate) spindle: SpindleSection,
    /// What happens to a running program when the page in control of the machine loses its link. A jog, the handwheel
    /// and reverse run always end.
    pub(crate) on_lost_control: OnLostControl,
    /// How the speed along the path is planned: `best` takes longer to plan and saves machine time on curves.
    pub(crate) plan: PlanMode,
    /// Axes, in any order.
    pub(crate) axis: Vec<AxisConfig>,
    /// Blending of corners.
    pub(crate) blending: BlendingSettings,
    /// Homing.
    pub(crate) homing: HomingSection,
    /// Manual operation.
    pub(crate) manual: ManualSection,
    /// Probing.
    pub(crate) probe: ProbeSection,
    /// The handwheel.
    pub(crate) wheel: WheelSettings,
    /// The motion card.
    pub(crate) card: CardSection,
    /// Programs over a serial line.
    pub(crate) serial: SerialSection,
    /// What the M, S and T codes switch, by code: `[code.M3]`.
    pub(crate) code: BTreeMap<String, CodeSettings>,
}

impl Default for MachineFile {
    fn default() -> Self {
        Self {
            name: "built-in".into(),
            control_period_ms: 1.0,
            path_velocity_mm_per_s: 100.0,
            override_reserve_percent: 10.0,
            blend_tolerance_mm: 0.05,
            history_hours: 0.5,
            look_ahead_s: 0.5,
            stream_quota_mib: 4096.0,
            homed: None,
            tool_axis: None,
            retract_mm: None,
            retrace_outputs: RetraceOutputs::Manual,
            cutting_outputs: Vec::new(),
            dry_waits: false,
            cutter: Vec::new(),
            cost: None,
            output: Vec::new(),
            tool_change: ToolChange::Automatic,
            manual_tool_change: ToolChangeSection::default(),
            spindle: SpindleSection::default(),
            on_lost_control: OnLostControl::Run,
            plan: PlanMode::default(),
            axis: ['x', 'y', 'z'].map(AxisConfig::plain).into(),
            blending: BlendingSettings::default(),
            homing: HomingSection::default(),
            manual: ManualSection::default(),
            probe: ProbeSection::default(),
            wheel: WheelSettings::default(),
            card: CardSection::default(),
            serial: SerialSection::default(),
            code: BTreeMap::new(),
        }
    }
}

/// JSON schema of the machine file, for editors (`docs/machine-file.schema.json`).
#[must_use]
pub fn machine_file_schema() -> serde_json::Value {
    schemars::schema_for!(MachineFile).to_value()
}

impl MachineFile {
    /// Parses the text of a file. `name` names it in messages.
    pub(crate) fn read(text: &str, name: &str) -> Result<Self, NumberedError> {
        toml::from_str(text).map_err(|error| misread(&error, name))
    }

    /// Checks that each number outside of lists is in its range: `E2112` where it is not.
    pub(crate) fn ranges(&self) -> [Result<(), NumberedError>; 9] {
        let period_ms = self.control_period_ms;
        // A control period out of range has its own error.
        let has_period = (0.1..=20.0).contains(&period_ms);
        let mean_ms = if has_period { [period_ms, 500.0 * period_ms] } else { [0.0, f64::INFINITY] };
        [
            within("control_period_ms", period_ms, 0.1, 20.0),
            within("path_velocity_mm_per_s", self.path_velocity_mm_per_s, 0.001, 100_000.0),
            within("override_reserve_percent", self.override_reserve_percent, 1.0, 50.0),
            within("blend_tolerance_mm", self.blend_tolerance_mm, 0.0, 100.0),
            within("history_hours", self.history_hours, 0.0, 24.0),
            within("stream_quota_mib", self.stream_quota_mib, 1.0, 1_048_576.0),
            within("look_ahead_s", self.look_ahead_s, 0.05, 10.0),
            within("wheel.full_rate_counts_per_s", self.wheel.full_rate_counts_per_s, 1.0, 100_000.0),
            within("wheel.filter_ms", self.wheel.filter_ms, mean_ms[0], mean_ms[1]),
        ]
    }
}

/// Error for a machine file that cannot be parsed: where, and what may have been meant.
fn misread(error: &toml::de::Error, name: &str) -> NumberedError {
    let remedy = unknown_key(error.message())
        .unwrap_or_else(|| "correct the line; `retrace machine new` shows a commented machine file".into());
    NumberedError::new("E2111", format!("{name}: {}", error.to_string().trim_end()), remedy)
}

/// The error in one line: where, what, and what may have been meant. `text` is the text that was parsed.
pub(crate) fn misread_in_a_line(error: &toml::de::Error, text: &str, name: &str) -> NumberedError {
    let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    let message = error.message().lines().next().unwrap_or_default();
    let message = message.split(", expected one of").next().unwrap_or_default();
    let remedy = misread(error, name).remedy;
    NumberedError::new("E2111", format!("{name}: line {line}, column {column}: {message}"), remedy)
}

/// From serde's "unknown field `x`, expected one of `a`, `b`": the nearest known key.
fn unknown_key(message: &str) -> Option<String> {
    let mut quoted = message.strip_prefix("unknown field ")?.split('`').skip(1).step_by(2);
    let unknown = quoted.next()?;
    let known: Vec<&str> = quoted.collect();
    Some(match nearest(unknown, known.iter().copied()) {
        Some(key) => format!("did you mean `{key}`?"),
        None => format!("known keys here: {}", known.join(", ")),
    })
}
