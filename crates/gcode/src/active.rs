//! The modal state for display and for a breakpoint (DNC, *Beyond the source*).
//!
//! Invariant: it is a value of a fixed size, read between two blocks. Two equal values mean the same modes, apart from
//! the machine position and the state that a program has saved for itself.

use crate::canon_modes::{FeedMode, LengthUnit, PathControl, Plane};
use crate::compensation::Side;
use crate::modal::ModalState;
use crate::modal_groups::{ArcCentres, DistanceMode, MotionMode, SpindleRotation};
use crate::pose::Pose;
use std::fmt;

/// Modal codes in force between two blocks. Lengths are in `units`, angles in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActiveCodes {
    /// Motion mode, drilling cycles included; `None` after G80.
    pub motion: Option<MotionMode>,
    /// Plane of arcs.
    pub plane: Plane,
    /// Length unit of the program.
    pub units: LengthUnit,
    /// Meaning of axis words.
    pub distance: DistanceMode,
    /// Meaning of centre words.
    pub arc_centres: ArcCentres,
    /// Meaning of F words.
    pub feed_mode: FeedMode,
    /// Feed rate in units per minute or per turn; 0 where none is set.
    pub feed_rate: f64,
    /// Coordinate system in force, 1 … 9 for G54 … G59.3.
    pub coordinate_system: u8,
    /// Origin of the coordinate system, in machine coordinates.
    pub origin: Pose,
    /// Rotation of the coordinate system about Z, in degrees counter-clockwise.
    pub rotation_degrees: f64,
    /// Offset of G52 and G92.
    pub g92_offset: Pose,
    /// Tool length offset in force.
    pub tool_offset: Pose,
    /// Side of cutter compensation; `None` after G40.
    pub compensation: Option<Side>,
    /// Treatment of junctions between moves.
    pub path_control: PathControl,
    /// Tolerance for merging nearly straight moves (G64 Q).
    pub naivecam_tolerance: f64,
    /// Whether G99 is in force, otherwise G98.
    pub retract_to_r: bool,
    /// Whether G7 is in force: X words are diameters.
    pub lathe_diameter: bool,
    /// Commanded direction of the spindle.
    pub spindle: SpindleRotation,
    /// Spindle speed in turns per minute; under G96 in metres or feet per minute.
    pub spindle_speed: f64,
    /// Whether G96 is in force.
    pub constant_surface_speed: bool,
    /// Maximum spindle speed in turns per minute under G96; 0 under G97.
    pub max_spindle_speed: f64,
    /// Whether mist is on (M7).
    pub mist: bool,
    /// Whether flood is on (M8).
    pub flood: bool,
    /// Whether the operator's feed override is enabled.
    pub feed_override: bool,
    /// Whether the operator's spindle speed override is enabled.
    pub speed_override: bool,
    /// Whether adaptive feed is enabled (M52).
    pub adaptive_feed: bool,
    /// Whether feed hold is enabled (M53).
    pub feed_hold: bool,
    /// Tool of the last T word; 0 is none.
    pub selected_tool: u32,
    /// Tool in the spindle; 0 is none.
    pub current_tool: u32,
}

/// Code of a coordinate system 1 … 9: G54 … G59.3.
#[must_use]
pub fn system_name(system: u8) -> &'static str {
    let names = ["G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"];
    names.get(usize::from(system).wrapping_sub(1)).unwrap_or(&"G54")
}

impl From<&ModalState> for ActiveCodes {
    fn from(state: &ModalState) -> ActiveCodes {
        ActiveCodes {
            motion: state.motion,
            plane: state.plane,
            units: state.units,
            distance: state.distance,
            arc_centres: state.arc_centres,
            feed_mode: state.feed_mode,
            feed_rate: state.feed_rate,
            coordinate_system: state.coordinate_system,
            origin: state.origin,
            rotation_degrees: state.rotation_degrees,
            g92_offset: state.g92_offset,
            tool_offset: state.tool_offset,
            compensation: state.compensation.map(|compensation| compensation.side),
            path_control: state.path_control,
            naivecam_tolerance: state.naivecam_tolerance,
            retract_to_r: state.retract_to_r,
            lathe_diameter: state.lathe_diameter,
            spindle: state.spindle,
            spindle_speed: state.spindle_speed,
            constant_surface_speed: state.constant_surface_speed,
            max_spindle_speed: state.max_spindle_speed,
            mist: state.mist,
            flood: state.flood,
            feed_override: state.feed_override,
            speed_override: state.speed_override,
            adaptive_feed: state.adaptive_feed,
            feed_hold: state.feed_hold,
            selected_tool: state.selected_tool,
            current_tool: state.current_tool,
        }
    }
}

impl ActiveCodes {
    /// Code of the coordinate system in force: G54 … G59.3.
    #[must_use]
    pub fn system_name(&self) -> &'static str {
        system_name(self.coordinate_system)
    }

    /// Whether a drilling cycle is in force.
    #[must_use]
    pub fn is_in_cycle(&self) -> bool {
        matches!(self.motion, Some(MotionMode::Cycle(_)))
    }

    /// Writes the modes that are checked first: motion, plane, units, compensation, tool length, coordinate system.
    fn write_geometry(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(motion) = self.motion {
            write!(f, "{} ", motion.name())?;
        }
        if self.lathe_diameter {
            f.write_str("G7 ")?;
        }
        f.write_str(match self.plane {
            Plane::Xy => "G17",
            Plane::Zx => "G18",
            Plane::Yz => "G19",
            Plane::Uv => "G17.1",
            Plane::Wu => "G18.1",
            Plane::Vw => "G19.1",
        })?;
        f.write_str(if self.units == LengthUnit::Inch { " G20" } else { " G21" })?;
        f.write_str(match self.compensation {
            None => " G40",
            Some(Side::Left) => " G41",
            Some(Side::Right) => " G42",
        })?;
        f.write_str(if self.tool_offset == Pose::ZERO { " G49 " } else { " G43 " })?;
        f.write_str(self.system_name())
    }

    /// Writes path control, cycle, distances, feed mode and spindle mode.
    fn write_modes(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.path_control {
            PathControl::ExactPath => f.write_str(" G61")?,
            PathControl::ExactStop => f.write_str(" G61.1")?,
            PathControl::Continuous { tolerance } => {
                f.write_str(" G64")?;
                if tolerance > 0.0 {
                    write!(f, " P{}", ShortDecimal(tolerance))?;
                }
                if tolerance > 0.0 && self.naivecam_tolerance != tolerance {
                    write!(f, " Q{}", ShortDecimal(self.naivecam_tolerance))?;
                }
            }
        }
        f.write_str(match (self.is_in_cycle(), self.retract_to_r) {
            (false, _) => " G80",
            (true, false) => " G98",
            (true, true) => " G99",
        })?;
        f.write_str(if self.distance == DistanceMode::Absolute { " G90" } else { " G91" })?;
        f.write_str(if self.arc_centres == ArcCentres::Absolute { " G90.1" } else { " G91.1" })?;
        if self.g92_offset != Pose::ZERO {
            f.write_str(" G92")?;
        }
        f.write_str(match self.feed_mode {
            FeedMode::InverseTime => " G93",
            FeedMode::UnitsPerMinute => " G94",
            FeedMode::UnitsPerRevolution => " G95",
        })?;
        match self.constant_surface_speed {
            false => f.write_str(" G97"),
            true if self.max_spindle_speed > 0.0 && self.max_spindle_speed < 1e9 => {
                write!(f, " G96 D{}", ShortDecimal(self.max_spindle_speed))
            }
            true => f.write_str(" G96"),
        }
    }

    /// Writes spindle, coolant, and the overrides that differ from the state at program start.
    fn write_switches(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.spindle {
            SpindleRotation::Stopped => " M5",
            SpindleRotation::Clockwise => " M3",
            SpindleRotation::Counterclockwise => " M4",
        })?;
        f.write_str(match (self.mist, self.flood) {
            (false, false) => " M9",
            (true, false) => " M7",
            (false, true) => " M8",
            (true, true) => " M7 M8",
        })?;
        f.write_str(match (self.feed_override, self.speed_override) {
            (true, true) => "",
            (false, false) => " M49",
            (false, true) => " M50 P0",
            (true, false) => " M51 P0",
        })?;
        f.write_str(if self.adaptive_feed { " M52" } else { "" })?;
        f.write_str(if self.feed_hold { "" } else { " M53 P0" })
    }
}

/// Writes the codes in the usual notation: `G1 G17 G21 G40 G49 G54 G64 G80 G90 G91.1 G94 G97 M3 M9 T2 F600 S12000`. T
/// is the tool in the spindle.
impl fmt::Display for ActiveCodes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_geometry(f)?;
        self.write_modes(f)?;
        self.write_switches(f)?;
        write!(f, " T{} F{} S{}", self.current_tool, ShortDecimal(self.feed_rate), ShortDecimal(self.spindle_speed))
    }
}

/// A number that is displayed with at most four decimals and without trailing zeros.
struct ShortDecimal(f64);

impl fmt::Display for ShortDecimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{:.4}", self.0);
        f.write_str(text.trim_end_matches('0').trim_end_matches('.'))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Interpreter, Setup};

    fn after(lines: &[&str]) -> String {
        let mut interpreter = Interpreter::new(Setup::default());
        for line in lines {
            interpreter.line(line.as_bytes(), &mut Vec::new()).expect("valid");
        }
        ActiveCodes::from(interpreter.state()).to_string()
    }

    #[test]
    fn it_is_written_as_the_field_writes_it() {
        assert_eq!(after(&[]), "G17 G21 G40 G49 G54 G64 G80 G90 G91.1 G94 G97 M5 M9 T0 F0 S0");
        assert_eq!(
            after(&["T2 M6", "S12000 M3", "G1 X1 F600"]),
            "G1 G17 G21 G40 G49 G54 G64 G80 G90 G91.1 G94 G97 M3 M9 T2 F600 S12000"
        );
        assert_eq!(
            after(&[
                "G18 G20 G7 G91 G90.1 G59.2 G64 P0.002 Q0.001",
                "M7",
                "M8",
                "M49",
                "G96 D2500 S300",
                "M4",
                "G95 F0.25"
            ]),
            "G7 G18 G20 G40 G49 G59.2 G64 P0.002 Q0.001 G80 G91 G90.1 G95 G96 D2500 M4 M7 M8 M49 T0 F0.25 S300"
        );
        let drilling =
            after(&["T1 M6", "G43", "G92 X1", "F100 G98 G81 X5 Z-1 R2", "M50 P0", "M51 P1", "M52 P1", "M53 P0"]);
        assert_eq!(
            drilling,
            "G81 G17 G21 G40 G43 G54 G64 G98 G90 G91.1 G92 G94 G97 M5 M9 M50 P0 M52 M53 P0 T1 F100 S0"
        );
        assert!(after(&["G41.1 D4"]).contains(" G41 ") && after(&["G42.1 D4"]).contains(" G42 "));
    }

    #[test]
    fn what_is_written_brings_it_back() {
        let lines = ["G19 G91 G61.1 G56", "G99 F321.5", "S900 M3", "M8", "M51 P0"];
        let written = after(&lines);
        let [codes, overrides] =
            written.split_once(" M51 P0").map(|(codes, rest)| [codes, rest]).expect("as asked for");
        assert_eq!(after(&[codes, "M51 P0", overrides]), written);
    }
}
