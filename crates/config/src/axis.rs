//! An axis of a machine: pulses, limits, travel, and homing.
//!
//! Invariant: checked axes are in the order of [`AXIS_LETTERS`], each at most once, with every value in its range.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::numbered_error::NumberedError;
use crate::value_range::within;

/// Axis letters, in the order of positions.
pub const AXIS_LETTERS: [char; 9] = ['x', 'y', 'z', 'a', 'b', 'c', 'u', 'v', 'w'];

/// An axis, `[[axis]]`.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisConfig {
    /// Letter of the axis: x, y, z, a, b, c, u, v or w.
    pub name: char,
    /// Pulses per mm (degree), 0.001 to 10⁶.
    pub pulses_per_mm: f64,
    /// Maximum velocity, mm/s.
    pub max_velocity_mm_per_s: f64,
    /// Maximum acceleration, mm/s².
    pub max_acceleration_mm_per_s2: f64,
    /// Maximum jerk, mm/s³.
    pub max_jerk_mm_per_s3: f64,
    /// Soft limits: lowest and highest machine position in mm.
    pub travel_mm: [f64; 2],
    /// Backlash in mm, compensated by the card.
    #[serde(default)]
    pub backlash_mm: f64,
    /// Jog speed in mm/s.
    #[serde(default)]
    jog_mm_per_s: Option<f64>,
    /// Homing over a switch.
    #[serde(default)]
    pub(crate) home: Option<HomeSection>,
}

/// End of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SwitchEnd {
    /// The lower end.
    Lower,
    /// The upper end.
    Upper,
}

/// Homing of an axis: fast to the switch, to rest, slowly off it again.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct HomeSection {
    /// End of the axis where the switch is.
    switch: SwitchEnd,
    /// Machine position at which the switch opens, in mm; by default the soft limit of that end.
    position_mm: Option<f64>,
    /// Speed to the switch in mm/s.
    search_mm_per_s: Option<f64>,
    /// Speed off the switch in mm/s.
    latch_mm_per_s: Option<f64>,
    /// Acceleration in mm/s².
    acceleration_mm_per_s2: Option<f64>,
    /// Maximum travel to the switch in mm.
    max_travel_mm: Option<f64>,
}

/// Homing of an axis: fast toward its switch, to rest, slowly off it again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HomeConfig {
    /// Whether the switch is at the upper end.
    pub upper: bool,
    /// Machine position where the switch opens, mm.
    pub position_mm: f64,
    /// Speed toward the switch, mm/s.
    pub search_mm_per_s: f64,
    /// Speed off the switch, mm/s.
    pub latch_mm_per_s: f64,
    /// Acceleration, mm/s².
    pub acceleration_mm_per_s2: f64,
    /// Maximum distance to the switch, mm.
    pub max_travel_mm: f64,
}

impl AxisConfig {
    /// Length of so many pulses, in mm (degrees).
    #[must_use]
    pub fn mm_of(&self, pulses: i64) -> f64 {
        pulses as f64 / self.pulses_per_mm
    }

    /// Number of pulses nearest to a length in mm (degrees), half away from zero.
    #[must_use]
    pub fn pulses_of(&self, mm: f64) -> i64 {
        (mm * self.pulses_per_mm).round() as i64
    }

    /// An axis with these limits, and defaults for everything else.
    pub(crate) const fn plain(name: char) -> Self {
        Self {
            name,
            pulses_per_mm: 1000.0,
            max_velocity_mm_per_s: 100.0,
            max_acceleration_mm_per_s2: 1000.0,
            max_jerk_mm_per_s3: 20_000.0,
            travel_mm: [-2000.0, 2000.0],
            backlash_mm: 0.0,
            jog_mm_per_s: None,
            home: None,
        }
    }

    /// The same axis without a home switch.
    pub(crate) fn without_home(&self) -> Self {
        Self { home: None, ..self.clone() }
    }

    /// Index of the axis in a nine-axis position.
    #[must_use]
    pub fn index(&self) -> usize {
        AXIS_LETTERS.iter().position(|&l| l == self.name).unwrap_or(0)
    }

    /// Whether the axis is rotary, so that its positions are degrees.
    #[must_use]
    pub const fn is_rotary(&self) -> bool {
        matches!(self.name, 'a' | 'b' | 'c')
    }

    /// Jog speed, mm/s: half of the maximum velocity where none is given.
    #[must_use]
    pub fn jog_mm_s(&self) -> f64 {
        self.jog_mm_per_s.unwrap_or(self.max_velocity_mm_per_s / 2.0)
    }

    /// Changes the speed of manual moves, at most to the highest speed of the axis.
    pub fn set_jog_mm_s(&mut self, mm_per_s: f64) {
        self.jog_mm_per_s = Some(mm_per_s.min(self.max_velocity_mm_per_s));
    }

    /// Homing of the axis. None where it has no switch.
    ///
    /// # Errors
    /// `E2112` for a value out of its range.
    pub(crate) fn homing(&self) -> Result<Option<HomeConfig>, NumberedError> {
        let Some(written) = &self.home else { return Ok(None) };
        let upper = written.switch == SwitchEnd::Upper;
        let [low, high] = self.travel_mm;
        let fast = written.search_mm_per_s.unwrap_or(self.max_velocity_mm_per_s / 5.0);
        let home = HomeConfig {
            upper,
            position_mm: written.position_mm.unwrap_or(if upper { high } else { low }),
            search_mm_per_s: fast,
            latch_mm_per_s: written.latch_mm_per_s.unwrap_or(fast / 20.0),
            acceleration_mm_per_s2: written.acceleration_mm_per_s2.unwrap_or(self.max_acceleration_mm_per_s2 / 4.0),
            max_travel_mm: written.max_travel_mm.unwrap_or(1.1 * (high - low)),
        };
        let key = |key: &str| format!("axis {}: home.{key}", self.name);
        within(&key("position_mm"), home.position_mm, -1e6, 1e6)?;
        within(&key("search_mm_per_s"), fast, 0.001, self.max_velocity_mm_per_s)?;
        within(&key("latch_mm_per_s"), home.latch_mm_per_s, 0.000_01, fast)?;
        within(&key("acceleration_mm_per_s2"), home.acceleration_mm_per_s2, 0.000_1, self.max_acceleration_mm_per_s2)?;
        within(&key("max_travel_mm"), home.max_travel_mm, 0.001, 4e9 / self.pulses_per_mm)?;
        Ok(Some(home))
    }

    fn check(&self) -> Result<(), NumberedError> {
        let key = |key: &str| format!("axis {}: {key}", self.name);
        within(&key("pulses_per_mm"), self.pulses_per_mm, 0.001, 1e6)?;
        within(&key("max_velocity_mm_per_s"), self.max_velocity_mm_per_s, 0.001, 1e5)?;
        within(&key("max_acceleration_mm_per_s2"), self.max_acceleration_mm_per_s2, 0.001, 1e7)?;
        within(&key("max_jerk_mm_per_s3"), self.max_jerk_mm_per_s3, 0.001, 1e10)?;
        let [least, greatest] = self.travel_mm;
        within(&key("travel_mm"), least, -1e6, 1e6)?;
        within(&key("travel_mm"), greatest, -1e6, 1e6)?;
        if least >= greatest {
            let what = format!("axis {}: travel_mm = [{least}, {greatest}]: the first is the lower end", self.name);
            return Err(refuse(what));
        }
        within(&key("backlash_mm"), self.backlash_mm, 0.0, 10.0)?;
        within(&key("jog_mm_per_s"), self.jog_mm_s(), 0.000_1, self.max_velocity_mm_per_s)
    }
}

pub(crate) fn refuse(what: String) -> NumberedError {
    NumberedError::new("E2112", what, "see `retrace machine new` for a commented machine file")
}

/// Checks axes as written in the machine file, and sorts them.
pub(crate) fn checked(mut axes: Vec<AxisConfig>) -> Result<Vec<AxisConfig>, NumberedError> {
    if axes.is_empty() {
        return Err(refuse("the machine has no [[axis]]".into()));
    }
    for axis in &mut axes {
        axis.name = axis.name.to_ascii_lowercase();
        if !AXIS_LETTERS.contains(&axis.name) {
            return Err(refuse(format!("axis `{}`: an axis is x, y, z, a, b, c, u, v or w", axis.name)));
        }
        axis.check()?;
    }
    axes.sort_by_key(AxisConfig::index);
    if let Some(twice) = axes.windows(2).find(|w| w[0].name == w[1].name) {
        return Err(refuse(format!("axis {} is there twice", twice[0].name)));
    }
    Ok(axes)
}
