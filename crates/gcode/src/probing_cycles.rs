//! Shipped subprograms that every program can call: the probing cycles (PRB-20), and the change of tools by the
//! operator (PRB-21).
//!
//! Invariant: a subprogram of the program, or in a file that its source finds, replaces one of these.

use crate::sub_files::SubFile;

/// What the probing cycles know of the machine; lengths in mm, feeds in mm/min.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbingFigures {
    /// Effective diameter of the ball of the probe.
    pub ball_diameter_mm: Option<f64>,
    /// Feed of the first, fast touch.
    pub feed_mm_per_min: f64,
    /// Feed of the second touch, which is the result.
    pub slow_feed_mm_per_min: f64,
    /// Distance to which the probe backs off between the touches, and at the end.
    pub back_off_mm: f64,
    /// Largest difference of the touches.
    pub agree_mm: f64,
    /// Machine coordinates of the tool setter: X and Y, and Z where a tool without length would touch.
    pub tool_setter_mm: Option<[f64; 3]>,
}

impl ProbingFigures {
    /// Returns them as named parameters.
    #[must_use]
    pub fn named_values(&self) -> Vec<(String, f64)> {
        let setter = self.tool_setter_mm.unwrap_or_default();
        let values = [
            ("_probe_ball", self.ball_diameter_mm.unwrap_or(-1.0)),
            ("_probe_feed", self.feed_mm_per_min),
            ("_probe_slow_feed", self.slow_feed_mm_per_min),
            ("_probe_back_off", self.back_off_mm),
            ("_probe_agree", self.agree_mm),
            ("_has_tool_setter", f64::from(u8::from(self.tool_setter_mm.is_some()))),
            ("_tool_setter_x", setter[0]),
            ("_tool_setter_y", setter[1]),
            ("_tool_setter_z", setter[2]),
        ];
        values.map(|(name, value)| (name.to_owned(), value)).to_vec()
    }
}

macro_rules! cycles {
    ($($name:literal),* $(,)?) => {
        /// Names and texts.
        const CYCLES: &[(&str, &str)] = &[$(($name, include_str!(concat!("../subprograms/", $name, ".ngc")))),*];
    };
}

cycles!(
    "probe_surface",
    "probe_edge",
    "probe_outside_corner",
    "probe_inside_corner",
    "probe_bore",
    "probe_boss",
    "probe_slot",
    "probe_web",
    "probe_angle",
    "probe_tool_setter",
    "probe_tool_at_work",
    "probe_calibrate",
    "probe_touch",
    "probe_descend",
    "probe_between",
    "probe_radius",
);

/// Returns names and texts of the probing cycles.
#[must_use]
pub fn probing_cycles() -> &'static [(&'static str, &'static str)] {
    CYCLES
}

/// What M6 does on a machine whose operator changes the tool (PRB-21); lengths in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolChangeFigures {
    /// Machine coordinates where the tool is changed: X, Y, Z.
    pub position_mm: Option<[f64; 3]>,
    /// Maximum travel down to the tool setter or the surface, where the tool is measured behind the change.
    pub measured_within_mm: Option<f64>,
    /// Where it is touched off, in work coordinates: X, Y and the height of the surface; `None`: at the tool setter.
    pub touch_mm: Option<[f64; 3]>,
}

impl ToolChangeFigures {
    /// Returns them as named parameters.
    #[must_use]
    pub fn named_values(&self) -> Vec<(String, f64)> {
        let [x, y, z] = self.position_mm.unwrap_or_default();
        let [touch_x, touch_y, touch_z] = self.touch_mm.unwrap_or_default();
        let values = [
            ("_has_tool_change_position", f64::from(u8::from(self.position_mm.is_some()))),
            ("_tool_change_x", x),
            ("_tool_change_y", y),
            ("_tool_change_z", z),
            ("_tool_change_measures", f64::from(u8::from(self.measured_within_mm.is_some()))),
            ("_tool_change_touches", f64::from(u8::from(self.touch_mm.is_some()))),
            ("_tool_touch_x", touch_x),
            ("_tool_touch_y", touch_y),
            ("_tool_touch_z", touch_z),
            ("_tool_change_travel", self.measured_within_mm.unwrap_or(0.0)),
        ];
        values.map(|(name, value)| (name.to_owned(), value)).to_vec()
    }
}

/// Name of the subprogram that M6 calls.
pub(crate) const TOOL_CHANGE: &str = "tool_change";

const CHANGE: (&str, &str) = (TOOL_CHANGE, include_str!("../subprograms/tool_change.ngc"));

/// Returns the texts of all shipped subprograms.
pub fn shipped_subprograms() -> impl Iterator<Item = &'static str> {
    CYCLES.iter().chain(&[CHANGE]).map(|(_, text)| *text)
}

/// Returns the shipped subprogram of this name, in lower case.
pub(crate) fn find(name: &str) -> Option<SubFile> {
    let (name, text) = CYCLES.iter().chain(&[CHANGE]).find(|(known, _)| *known == name)?;
    Some(SubFile { name: format!("{name}.ngc"), text: Ok((*text).into()) })
}
