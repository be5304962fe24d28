//! The modal state: everything that a block inherits from the blocks before it.
//!
//! Invariant: all lengths are in the program's units in force. [`ModalState`] and the parameters together determine the
//! effect of a block.

use crate::angle::rotate;
use crate::canon_modes::{FeedMode, LengthUnit, PathControl, Plane};
use crate::compensation::Compensation;
use crate::compensation_queue::CompensationQueue;
use crate::cutting::CuttingState;
use crate::drilling_cycle::DrillingSeries;
use crate::modal_groups::{ArcCentres, DistanceMode, MotionMode, SpindleRotation};
use crate::open_contour::OpenContour;
use crate::pose::{Axis, Pose};
use crate::saved_state::SavedState;
use crate::spline::ControlPoint;
use crate::unknown::UnknownModes;

/// The whole modal state between two blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct ModalState {
    /// Motion mode; `None` after G80.
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
    /// Feed rate in units per minute; 0 where none is set.
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
    /// Position in program coordinates; under cutter compensation that of the tool, not of the programmed path.
    pub position: Pose,
    /// Cutter radius compensation; `None` after G40.
    pub compensation: Option<Compensation>,
    /// Whether G40 has ended a compensated path and no straight move has followed.
    pub has_left_compensation: bool,
    /// Whether the program has probed: its position, and the parameters of the result, are assumptions.
    pub has_probed: bool,
    /// Vector from the end of the programmed path to the tool since that G40, along the machine's axes, in program
    /// units; `None` after a motion.
    pub tool_shift: Option<Pose>,
    /// Moves that the next corner of a compensated path may still change, and the functions after them.
    pub(crate) waiting: CompensationQueue,
    /// Treatment of junctions between moves.
    pub path_control: PathControl,
    /// Tolerance for merging nearly straight moves.
    pub naivecam_tolerance: f64,
    /// Whether G99 is in force, otherwise G98.
    pub retract_to_r: bool,
    /// Series of drilling cycles; `None` after another motion.
    pub series: Option<DrillingSeries>,
    /// Commanded direction of the spindle.
    pub spindle: SpindleRotation,
    /// Spindle speed in turns per minute; with constant surface speed in metres or feet per minute.
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
    /// Cutting: material, share of the feed rate, small holes. Initial on a machine without a material table.
    pub cutting: CuttingState,
    /// The contour that is being cut, if its ends differ from what the program says.
    pub(crate) contour: Option<Box<OpenContour>>,
    /// Return value of the last subprogram.
    pub returned_value: Option<f64>,
    /// Number of open calls of subprograms.
    pub call_level: u32,
    /// Whether G7 is in force: X words are diameters.
    pub lathe_diameter: bool,
    /// Direction in which the last G5 has ended, in program units.
    pub spline_direction: (f64, f64),
    /// Order of the spline that G5.2 collects points for.
    pub spline_order: u32,
    /// Control points that G5.2 has collected.
    pub control_points: Vec<ControlPoint>,
    /// States that M70 and M73 have saved, for each level of calls.
    pub(crate) saved_states: Vec<Option<SavedState>>,
    /// Modes that a check does not know.
    pub(crate) unknown: UnknownModes,
}

impl ModalState {
    /// Returns the state before the first block, at the machine's zero.
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
            waiting: CompensationQueue::default(),
            path_control: PathControl::Continuous { tolerance: 0.0 },
            naivecam_tolerance: 0.0,
            retract_to_r: true,
            series: None,
            spindle: SpindleRotation::Stopped,
            spindle_speed: 0.0,
            constant_surface_speed: false,
            max_spindle_speed: 0.0,
            mist: false,
            flood: false,
            feed_override: true,
            speed_override: true,
            adaptive_feed: false,
            feed_hold: true,
            selected_tool: 0,
            current_tool: 0,
            cutting: CuttingState::default(),
            contour: None,
            returned_value: None,
            call_level: 0,
            lathe_diameter: false,
            spline_direction: (0.0, 0.0),
            spline_order: 0,
            control_points: Vec::new(),
            saved_states: Vec::new(),
            unknown: UnknownModes::default(),
        }
    }

    /// Whether lengths are in millimetres.
    #[must_use]
    pub fn is_metric(&self) -> bool {
        self.units == LengthUnit::Millimetre
    }

    /// Returns the position on the programmed path, which differs from the tool position under cutter compensation
    /// only.
    #[must_use]
    #[inline]
    pub fn path_position(&self) -> &Pose {
        match &self.compensation {
            Some(Compensation { programmed: Some(programmed), .. }) => programmed,
            _ => &self.position,
        }
    }

    /// Returns the position of the machine (its controlled point without the tool offset) in machine coordinates and
    /// program units.
    #[must_use]
    pub fn machine_position(&self) -> Pose {
        self.to_machine(&self.position)
    }

    /// Converts a point of the program to machine coordinates, both in program units.
    #[must_use]
    pub fn to_machine(&self, point: &Pose) -> Pose {
        let mut machine = point.plus(&self.g92_offset);
        (machine[Axis::X], machine[Axis::Y]) = rotate(machine[Axis::X], machine[Axis::Y], self.rotation_degrees);
        machine.plus(&self.origin).plus(&self.tool_offset)
    }
}
