//! Predefined named parameters, from which a program reads the state of the machine.
//!
//! Invariant: they are read-only, and their values are those of LinuxCNC 2.9.

use crate::canon_modes::{FeedMode, Plane, Probing};
use crate::compensation::Side;
use crate::cutting::HalValue;
use crate::modal::ModalState;
use crate::modal_groups::{ArcCentres, DistanceMode, MotionMode, SpindleRotation};
use crate::pose::Axis;
use crate::unknown::UnknownModes;

/// A predefined named parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum SystemParameter {
    Position(Axis),
    /// In machine coordinates and program units.
    MachinePosition(Axis),
    Fixed(f64),
    Line,
    MotionMode,
    Plane,
    Metric,
    Imperial,
    Absolute,
    Incremental,
    InverseTime,
    UnitsPerMinute,
    UnitsPerRevolution,
    ConstantTurns,
    ConstantSurfaceSpeed,
    CoordinateSystem,
    ToolOffset,
    RetractToR,
    RetractToOldZ,
    ArcCentresAbsolute,
    SpindleOn,
    SpindleClockwise,
    Mist,
    Flood,
    SpeedOverride,
    FeedOverride,
    AdaptiveFeed,
    FeedHold,
    Feed,
    SpindleSpeed,
    CurrentTool,
    SelectedTool,
    ReturnedValue,
    HasReturnedValue,
    CallLevel,
    Compensation,
    LatheDiameter,
    LatheRadius,
    /// Pocket of the tool in the spindle.
    CurrentPocket,
    /// Pocket of the selected tool; -1 for none.
    SelectedPocket,
    /// Value of the plasma controller; 0 on a machine without a material table.
    Hal(HalValue),
}

impl SystemParameter {
    /// Returns the predefined parameter of this name, in lower case.
    pub(crate) fn of_name(name: &str) -> Option<SystemParameter> {
        use SystemParameter as P;
        let name = name.strip_prefix('_')?;
        if let Some(axis) = name.strip_prefix("abs_").and_then(parse_axis) {
            return Some(P::MachinePosition(axis));
        }
        if let Some(axis) = parse_axis(name) {
            return Some(P::Position(axis));
        }
        Some(match name {
            "line" => P::Line,
            "motion_mode" => P::MotionMode,
            "plane" => P::Plane,
            "metric" => P::Metric,
            "imperial" => P::Imperial,
            "absolute" => P::Absolute,
            "incremental" => P::Incremental,
            "inverse_time" => P::InverseTime,
            "units_per_minute" => P::UnitsPerMinute,
            "coord_system" => P::CoordinateSystem,
            "tool_offset" => P::ToolOffset,
            "retract_r_plane" => P::RetractToR,
            "retract_old_z" => P::RetractToOldZ,
            "ijk_absolute_mode" => P::ArcCentresAbsolute,
            "spindle_on" => P::SpindleOn,
            "spindle_cw" => P::SpindleClockwise,
            "mist" => P::Mist,
            "flood" => P::Flood,
            "speed_override" => P::SpeedOverride,
            "feed_override" => P::FeedOverride,
            "adaptive_feed" => P::AdaptiveFeed,
            "feed_hold" => P::FeedHold,
            "feed" => P::Feed,
            "rpm" => P::SpindleSpeed,
            "current_tool" => P::CurrentTool,
            "selected_tool" => P::SelectedTool,
            "value" => P::ReturnedValue,
            "value_returned" => P::HasReturnedValue,
            "call_level" => P::CallLevel,
            "units_per_rev" => P::UnitsPerRevolution,
            "spindle_rpm_mode" => P::ConstantTurns,
            "spindle_css_mode" => P::ConstantSurfaceSpeed,
            "ccomp" => P::Compensation,
            "lathe_diameter_mode" => P::LatheDiameter,
            "lathe_radius_mode" => P::LatheRadius,
            "current_pocket" => P::CurrentPocket,
            "selected_pocket" => P::SelectedPocket,
            "vmajor" => P::Fixed(2.9),
            "vminor" => P::Fixed(0.0),
            "task" | "remap_level" => P::Fixed(0.0),
            _ => return None,
        })
    }

    /// Returns the mode that it shows.
    pub(crate) const fn modes(self) -> UnknownModes {
        use SystemParameter as P;
        match self {
            P::Position(_) | P::MachinePosition(_) | P::Fixed(_) | P::Line | P::CallLevel => UnknownModes::NONE,
            P::MotionMode => UnknownModes::MOTION,
            P::Plane => UnknownModes::PLANE,
            P::Metric | P::Imperial => UnknownModes::UNITS,
            P::Absolute | P::Incremental => UnknownModes::DISTANCE,
            P::InverseTime | P::UnitsPerMinute | P::UnitsPerRevolution => UnknownModes::FEED_MODE,
            P::ConstantTurns | P::ConstantSurfaceSpeed | P::SpindleOn | P::SpindleClockwise => UnknownModes::SPINDLE,
            P::CoordinateSystem => UnknownModes::SYSTEM,
            P::RetractToR | P::RetractToOldZ => UnknownModes::RETRACT,
            P::ArcCentresAbsolute => UnknownModes::ARC_CENTRES,
            P::Mist | P::Flood | P::SpeedOverride | P::FeedOverride | P::AdaptiveFeed | P::FeedHold => {
                UnknownModes::SWITCHES
            }
            P::Feed | P::SpindleSpeed | P::ToolOffset => UnknownModes::NONE,
            P::CurrentTool | P::CurrentPocket => UnknownModes::CURRENT_TOOL,
            P::SelectedTool | P::SelectedPocket => UnknownModes::SELECTED_TOOL,
            P::ReturnedValue | P::HasReturnedValue => UnknownModes::RETURNED,
            P::Compensation => UnknownModes::COMPENSATION,
            P::LatheDiameter | P::LatheRadius => UnknownModes::LATHE_DIAMETER,
            P::Hal(_) => UnknownModes::CUTTING,
        }
    }

    /// Returns the value in this state; `line` counts from 1.
    pub(crate) fn value(self, state: &ModalState, line: u32) -> f64 {
        use SystemParameter as P;
        let truth = |condition: bool| f64::from(u8::from(condition));
        match self {
            P::Position(axis) => state.position[axis],
            P::MachinePosition(axis) => state.machine_position()[axis],
            P::Fixed(value) => value,
            P::Hal(_) => 0.0,
            P::Line => line.into(),
            P::MotionMode => match state.motion {
                Some(MotionMode::Traverse) => 0.0,
                Some(MotionMode::Feed) => 10.0,
                Some(MotionMode::ArcClockwise) => 20.0,
                Some(MotionMode::ArcCounterclockwise) => 30.0,
                Some(MotionMode::SpindleFeed) => 330.0,
                Some(MotionMode::RigidTap) => 331.0,
                Some(MotionMode::ThreadingCycle) => 760.0,
                Some(MotionMode::Cycle(cycle)) => cycle.tenths().into(),
                Some(MotionMode::ControlPoint) => 52.0,
                Some(MotionMode::Probe(Probing { away, must_trip })) => 382.0 + 2.0 * truth(away) + truth(!must_trip),
                Some(MotionMode::CubicSpline | MotionMode::QuadraticSpline | MotionMode::EndOfPoints) | None => 800.0,
            },
            P::Plane => match state.plane {
                Plane::Xy => 170.0,
                Plane::Zx => 180.0,
                Plane::Yz => 190.0,
                Plane::Uv => 171.0,
                Plane::Wu => 181.0,
                Plane::Vw => 191.0,
            },
            P::Metric => truth(state.is_metric()),
            P::Imperial => truth(!state.is_metric()),
            P::Absolute => truth(state.distance == DistanceMode::Absolute),
            P::Incremental => truth(state.distance == DistanceMode::Incremental),
            P::InverseTime => truth(state.feed_mode == FeedMode::InverseTime),
            P::UnitsPerMinute => truth(state.feed_mode == FeedMode::UnitsPerMinute),
            P::UnitsPerRevolution => truth(state.feed_mode == FeedMode::UnitsPerRevolution),
            P::ConstantTurns => truth(!state.constant_surface_speed),
            P::ConstantSurfaceSpeed => truth(state.constant_surface_speed),
            P::CoordinateSystem => match state.coordinate_system {
                system @ 0..=6 => 530.0 + 10.0 * f64::from(system),
                system => 584.0 + f64::from(system),
            },
            P::ToolOffset => truth(state.tool_offset.0.iter().any(|length| *length != 0.0)),
            P::RetractToR => truth(state.retract_to_r),
            P::RetractToOldZ => truth(!state.retract_to_r),
            P::ArcCentresAbsolute => truth(state.arc_centres == ArcCentres::Absolute),
            P::SpindleOn => truth(state.spindle != SpindleRotation::Stopped),
            P::SpindleClockwise => truth(state.spindle == SpindleRotation::Clockwise),
            P::Mist => truth(state.mist),
            P::Flood => truth(state.flood),
            P::SpeedOverride => truth(state.speed_override),
            P::FeedOverride => truth(state.feed_override),
            P::AdaptiveFeed => truth(state.adaptive_feed),
            P::FeedHold => truth(state.feed_hold),
            P::Feed => state.feed_rate,
            P::SpindleSpeed => state.spindle_speed,
            P::CurrentTool => state.current_tool.into(),
            P::SelectedTool => state.selected_tool.into(),
            P::ReturnedValue => state.returned_value.unwrap_or(0.0),
            P::HasReturnedValue => truth(state.returned_value.is_some()),
            P::CallLevel => state.call_level.into(),
            // The caller, which has the tool table, returns these values itself.
            P::CurrentPocket => 0.0,
            P::SelectedPocket => -1.0,
            P::Compensation => match state.compensation.map(|compensation| compensation.side) {
                None => 400.0,
                Some(Side::Left) => 410.0,
                Some(Side::Right) => 420.0,
            },
            P::LatheDiameter => truth(state.lathe_diameter),
            P::LatheRadius => truth(!state.lathe_diameter),
        }
    }
}

fn parse_axis(name: &str) -> Option<Axis> {
    match name.as_bytes() {
        [letter] => Axis::of_letter(*letter),
        _ => None,
    }
}
