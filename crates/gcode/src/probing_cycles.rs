//! Probing cycles, as subprograms that every program can call (PRB-20).
//!
//! Invariant: a subprogram of the program, or in a file that its source finds, replaces one of these.

use crate::sub_files::SubFile;

/// What the probing cycles know of the machine; lengths in mm, feeds in mm/min.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProbingFigures {
    /// Effective diameter of the ball of the probe.
    pub ball_mm: Option<f64>,
    /// Feed of the first, fast touch.
    pub feed_mm_min: f64,
    /// Feed of the second touch, which is the result.
    pub slow_feed_mm_min: f64,
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
            ("_probe_ball", self.ball_mm.unwrap_or(-1.0)),
            ("_probe_feed", self.feed_mm_min),
            ("_probe_slow_feed", self.slow_feed_mm_min),
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
        const CYCLES: &[(&str, &str)] = &[$(($name, include_str!(concat!("../probing/", $name, ".ngc")))),*];
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

/// Returns the probing cycle of this name, in lower case.
pub(crate) fn find(name: &str) -> Option<SubFile> {
    let (name, text) = CYCLES.iter().find(|(known, _)| *known == name)?;
    Some(SubFile { name: format!("{name}.ngc"), text: Ok((*text).into()) })
}
