//! The machine file of retrace: axes, limits, card settings, switching codes, cutters, homing and serial lines; and the
//! table of the materials that it cuts.
//!
//! ```text
//!  TOML text ─> machine_file ─> axis, cutter, card_config, ─> MachineConfig ─> limits, card_settings, rate_limits
//!               (sections)      switching, serial, …         (checked)        of the planner and of the card
//! ```
//!
//! A [`MachineConfig`] is parsed from text, or is the built-in machine. [`MachineConfig::check_machine`] reports every
//! error of a file at once; [`machine_file_schema`] is the JSON schema of the file. Errors of this and of the crates
//! above are [`NumberedError`]s: a number of `docs/errors.md`, a cause, and a remedy.
//!
//! Lengths are in mm (degrees on rotary axes), times in s unless a name says otherwise.
//!
//! Invariant: a [`MachineConfig`] that exists is valid: every number is in its range, every name refers to something,
//! the plan has its reserve, and the rate law fits the card.
//!
//! # Examples
//!
//! ```
//! use retrace_config::MachineConfig;
//! let machine = MachineConfig::parse("control_period_ms = 2.0", "mill.toml")?;
//! assert_eq!((machine.axes.len(), machine.period_us), (3, 2000));
//! let error = MachineConfig::parse("control_period_ms = 0.0", "mill.toml").unwrap_err();
//! assert_eq!(error.number, "E2112");
//! # Ok::<(), retrace_config::NumberedError>(())
//! ```
#![forbid(unsafe_code)]

mod analog_declaration;
mod analog_input;
mod analog_output;
mod analog_output_conflicts;
mod axis;
mod beam_power;
mod card_config;
mod card_settings;
mod channel_names;
mod cost_config;
mod cutter;
mod cutter_doubt;
mod cutter_inputs;
mod cutter_start;
mod height_control;
mod input_names;
mod jet_flow;
mod machine_changes;
mod machine_check;
mod machine_config;
mod machine_file;
mod manual_config;
mod marker_start;
mod material;
mod material_table;
mod material_table_update;
mod numbered_error;
mod pierce_mode;
mod plan_mode;
mod probe_config;
mod probing_limits;
mod probing_machine;
mod qtplasmac_file;
mod rate_limits;
mod serial;
mod sheet_contacts;
mod sheet_sensing;
mod spindle_config;
mod spindle_pwm_config;
mod spindle_settings;
mod switching;
mod tool_change_config;
mod value_range;

pub use analog_input::AnalogInput;
pub use analog_output::{AnalogOutput, analog_amount};
pub use axis::{AXIS_LETTERS, AxisConfig, HomeConfig};
pub use beam_power::BeamPowerConfig;
pub use card_config::CardConfig;
pub use channel_names::{ChannelNames, amount_text, channel_name};
pub use cost_config::{CostConfig, ProgramCost};
pub use cutter::{CutterConfig, CutterKind, SingleBlockStep, ZWords};
pub use cutter_start::{CutterProof, CutterRestart, CutterStart};
pub use height_control::{HeightControlConfig, HeightControlOfCutter};
pub use jet_flow::JetFlow;
pub use machine_changes::machine_changes;
pub use machine_check::MachineCheck;
pub use machine_config::{MachineConfig, MaterialFile};
pub use machine_file::{OnLostControl, RetraceOutputs, WheelSettings, machine_file_schema};
pub use manual_config::ManualConfig;
pub use marker_start::MarkerStart;
pub use material::{FIRST_TEMPORARY_MATERIAL, MaterialConfig, MaterialUnits};
pub use material_table::MaterialTable;
pub use numbered_error::{NumberedError, nearest};
pub use pierce_mode::PierceMode;
pub use plan_mode::PlanMode;
pub use probe_config::{AfterTouch, ProbeConfig};
pub use probing_limits::ProbingLimits;
pub use rate_limits::{IN_FLIGHT_RECORDS, StoppingTimes};
pub use serial::{CharacterCode, Handshake, Parity, ProgramEnds, SerialSettings};
pub use sheet_sensing::{SheetSensing, TipUp, ToolLayer};
pub use spindle_config::{EncoderConfig, EncoderDirection, FeedPerTurn};
pub use spindle_settings::{SpindleConfig, SpindleOrientation, SpindleReady};
pub use switching::{CodeClass, CodeSettings, CodeSwitching, InReverse, SwitchingTable, UserCode, WaitsFor};
pub use tool_change_config::{ToolChange, ToolChangeConfig};
