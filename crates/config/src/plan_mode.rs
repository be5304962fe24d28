//! How the speed along the path is planned: `plan = "fast"` in the machine file, or `--plan fast`.
//!
//! Invariant: the path and the limits are the same in every mode.

use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the speed along the path is planned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum PlanMode {
    /// The plan of the look-ahead.
    Fast,
    /// The plan of the look-ahead, made faster on curves, up to the limits of the axes. It takes longer to plan.
    #[default]
    Best,
}

impl PlanMode {
    /// Names of all modes.
    pub const NAMES: [&'static str; 2] = ["fast", "best"];
}

impl FromStr for PlanMode {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "fast" => Ok(Self::Fast),
            "best" => Ok(Self::Best),
            other => Err(format!("`{other}` is neither `fast` nor `best`")),
        }
    }
}

impl From<PlanMode> for retrace_motion::PlanMode {
    fn from(mode: PlanMode) -> Self {
        match mode {
            PlanMode::Fast => Self::Fast,
            PlanMode::Best => Self::Best,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MachineConfig;

    #[test]
    fn the_machine_file_chooses_the_mode() {
        let mode = |text: &str| MachineConfig::parse(text, "m.toml").map(|machine| machine.plan_mode);
        assert_eq!(mode("name = \"m\"\n"), Ok(PlanMode::Best));
        assert_eq!(mode("plan = \"fast\"\n"), Ok(PlanMode::Fast));
        assert!(mode("plan = \"good\"\n").is_err());
        assert_eq!(PlanMode::NAMES.map(str::parse), [Ok(PlanMode::Fast), Ok(PlanMode::Best)]);
    }
}
