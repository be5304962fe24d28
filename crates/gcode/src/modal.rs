//! The modal state: everything that a block takes over from the blocks before it.
//!
//! Invariant: all lengths are in the program's units in force; [`State`] and the parameters together decide what a block does.

use crate::angle::rotate;
use crate::canon::{FeedMode, LengthUnit, PathControl, Plane, Probing};
use crate::compensation::Compensation;
use crate::drilling_cycle::{DrillingCycle, DrillingSeries};
use crate::interp::{Context, Queue};
use crate::pose::{Axis, Pose};
use crate::spline::ControlPoint;

/// The motion modes that are carried out; none is G80.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionMode {
    /// G0.
    Traverse,
    /// G1.
    Feed,
    /// G2.
    ArcClockwise,
    /// G3.
    ArcCounterclockwise,
    /// G33: in step with the spindle.
    SpindleFeed,
    /// G33.1.
    RigidTap,
    /// G76.
    ThreadingCycle,
    /// G73, G74, G81 … G89.
    Cycle(DrillingCycle),
    /// G5; never a mode that is in force.
    CubicSpline,
    /// G5.1; never a mode that is in force.
    QuadraticSpline,
    /// G5.2.
    ControlPoint,
    /// G5.3; never a mode that is in force.
    EndOfPoints,
    /// G38.2 to G38.5.
    Probe(Probing),
}

impl MotionMode {
    /// How it is written.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            MotionMode::Traverse => "G0",
            MotionMode::Feed => "G1",
            MotionMode::ArcClockwise => "G2",
            MotionMode::ArcCounterclockwise => "G3",
            MotionMode::SpindleFeed => "G33",
            MotionMode::RigidTap => "G33.1",
            MotionMode::ThreadingCycle => "G76",
            MotionMode::Cycle(cycle) => cycle.name(),
            MotionMode::CubicSpline => "G5",
            MotionMode::QuadraticSpline => "G5.1",
            MotionMode::ControlPoint => "G5.2",
            MotionMode::EndOfPoints => "G5.3",
            MotionMode::Probe(Probing { away: false, must_answer: true }) => "G38.2",
            MotionMode::Probe(Probing { away: false, must_answer: false }) => "G38.3",
            MotionMode::Probe(Probing { away: true, must_answer: true }) => "G38.4",
            MotionMode::Probe(Probing { away: true, must_answer: false }) => "G38.5",
        }
    }

    /// G2 or G3.
    #[must_use]
    pub const fn is_arc(self) -> bool {
        matches!(self, MotionMode::ArcClockwise | MotionMode::ArcCounterclockwise)
    }
}

/// What axis words mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DistanceMode {
    /// G90: the end.
    Absolute,
    /// G91: from the current position.
    Incremental,
}

/// What the centre words of an arc mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArcCentres {
    /// G90.1: the centre.
    Absolute,
    /// G91.1: from the start.
    Incremental,
}

/// What the spindle was told to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpindleRotation {
    /// M5.
    Stopped,
    /// M3.
    Clockwise,
    /// M4.
    Counterclockwise,
}

/// The whole modal state between two blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct ModalState {
    /// The motion mode; none after G80.
    pub motion: Option<MotionMode>,
    /// The plane of arcs.
    pub plane: Plane,
    /// The program's length unit.
    pub units: LengthUnit,
    /// What axis words mean.
    pub distance: DistanceMode,
    /// What centre words mean.
    pub arc_centres: ArcCentres,
    /// What F words mean.
    pub feed_mode: FeedMode,
    /// Units a minute; 0 is none.
    pub feed_rate: f64,
    /// The coordinate system in force, 1 … 9 for G54 … G59.3.
    pub coordinate_system: u8,
    /// Its origin in machine coordinates.
    pub origin: Pose,
    /// Its rotation about Z, degrees counter-clockwise.
    pub rotation_degrees: f64,
    /// The offset of G52 and G92.
    pub g92_offset: Pose,
    /// The tool length offset in force.
    pub tool_offset: Pose,
    /// The position in program coordinates; under cutter compensation that of the tool, not of the programmed path.
    pub position: Pose,
    /// Cutter radius compensation; none after G40.
    pub compensation: Option<Compensation>,
    /// G40 has ended a compensated path, and no straight move has come since.
    pub has_left_compensation: bool,
    /// It has probed: its position, and the parameters of the answer, are taken for granted.
    pub has_probed: bool,
    /// From the end of the programmed path to where the tool stands since that G40, along the machine's axes, program units;
    /// none after a motion.
    pub tool_shift: Option<Pose>,
    /// Moves that the next corner of a compensated path may still change, and what came after them.
    pub(crate) waiting: Queue,
    /// How joints are run through.
    pub path_control: PathControl,
    /// Tolerance of the merging of nearly straight runs.
    pub naivecam_tolerance: f64,
    /// G99; else G98.
    pub retract_to_r: bool,
    /// The series of drilling cycles; none after another motion.
    pub series: Option<DrillingSeries>,
    /// What the spindle was told to do.
    pub spindle: SpindleRotation,
    /// Turns a minute, or with constant surface speed metres or feet a minute.
    pub spindle_speed: f64,
    /// G96.
    pub constant_surface_speed: bool,
    /// The highest number of turns a minute that G96 allows; 0 under G97.
    pub highest_spindle_speed: f64,
    /// M7.
    pub mist: bool,
    /// M8.
    pub flood: bool,
    /// Whether the operator's feed override acts.
    pub feed_override: bool,
    /// Whether the operator's spindle speed override acts.
    pub speed_override: bool,
    /// M52.
    pub adaptive_feed: bool,
    /// M53.
    pub feed_hold: bool,
    /// The tool of the last T word; 0 is none.
    pub selected_tool: u32,
    /// The tool in the spindle; 0 is none.
    pub current_tool: u32,
    /// What the last subprogram has returned.
    pub returned_value: Option<f64>,
    /// How many calls of subprograms are open.
    pub call_level: u32,
    /// G7: X words are diameters.
    pub lathe_diameter: bool,
    /// The direction in which the last G5 has ended, program units.
    pub spline_direction: (f64, f64),
    /// The order of the spline that G5.2 collects points for.
    pub spline_order: u32,
    /// What G5.2 has collected.
    pub control_points: Vec<ControlPoint>,
    /// What M70 and M73 have put away, for each level of calls.
    pub(crate) contexts: Vec<Option<Context>>,
}

impl ModalState {
    /// What holds before the first block, at the machine's zero.
    #[must_use]
    pub fn initial(units: LengthUnit) -> ModalState {
        ModalState {
            motion: None,
            plane: Plane::Xy,
            units,
            distance: DistanceMode::Absolute,
            arc_centres: ArcCentres::Incremental,
            feed_mode: FeedMode::UnitsPerMinute,
            feed_rate: 0.0,
            coordinate_system: 1,
            origin: Pose::ZERO,
            rotation_degrees: 0.0,
            g92_offset: Pose::ZERO,
            tool_offset: Pose::ZERO,
            position: Pose::ZERO,
            compensation: None,
            has_left_compensation: false,
            has_probed: false,
            tool_shift: None,
            waiting: Queue::default(),
            path_control: PathControl::Continuous { tolerance: 0.0 },
            naivecam_tolerance: 0.0,
            retract_to_r: true,
            series: None,
            spindle: SpindleRotation::Stopped,
            spindle_speed: 0.0,
            constant_surface_speed: false,
            highest_spindle_speed: 0.0,
            mist: false,
            flood: false,
            feed_override: true,
            speed_override: true,
            adaptive_feed: false,
            feed_hold: true,
            selected_tool: 0,
            current_tool: 0,
            returned_value: None,
            call_level: 0,
            lathe_diameter: false,
            spline_direction: (0.0, 0.0),
            spline_order: 0,
            control_points: Vec::new(),
            contexts: Vec::new(),
        }
    }

    /// Whether lengths are in millimetres.
    #[must_use]
    pub fn is_metric(&self) -> bool {
        self.units == LengthUnit::Millimetre
    }

    /// Where the programmed path stands: the position, but for cutter compensation.
    #[must_use]
    #[inline]
    pub fn path_position(&self) -> &Pose {
        match &self.compensation {
            Some(Compensation { programmed: Some(programmed), .. }) => programmed,
            _ => &self.position,
        }
    }

    /// The position of the machine (its controlled point with the tool offset taken off) in machine coordinates and program units.
    #[must_use]
    pub fn machine_position(&self) -> Pose {
        self.to_machine(&self.position)
    }

    /// A point of the program in machine coordinates, both in program units.
    #[must_use]
    pub fn to_machine(&self, point: &Pose) -> Pose {
        let mut machine = point.plus(&self.g92_offset);
        (machine[Axis::X], machine[Axis::Y]) = rotate(machine[Axis::X], machine[Axis::Y], self.rotation_degrees);
        machine.plus(&self.origin).plus(&self.tool_offset)
    }
}
