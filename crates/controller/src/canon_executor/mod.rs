//! The canonical function executor: turns canonical functions into moves of the machine's axes, in mm and machine
//! coordinates.
//!
//! Invariant: units, offsets and rotation are applied here and nowhere else. A move of an axis that the machine does
//! not have is rejected, and an unsupported function is rejected by name.

mod analog;
mod cut_areas;
mod entered_length;
mod feed;
mod feed_override;
mod jet;
mod orient;
mod probing;
mod surface_speed;
mod switching;
mod thread;
mod tool_height;
mod unknown_path;

use std::sync::Arc;

use retrace_config::{CutterKind, MachineConfig};
use retrace_gcode::{Axis, Canon, LengthUnit, Material, Nurbs, PathControl, Plane, Pose};
use retrace_motion::{Arc as ArcMove, FeedRate, PathMode};

use crate::canon_error::CanonError;
use crate::cutter_track::CutterTrack;
use crate::motion_sink::MotionSink;
use crate::question::MachineResult;
use crate::spline::chords;

use cut_areas::CutAreas;
use entered_length::LengthCorrection;
use feed_override::FeedOverrideSwitch;
use surface_speed::SurfaceSpeed;
use tool_height::LayerState;

/// Minimum deviation of the chords of splines, mm.
const MIN_DEVIATION_MM: f64 = 0.001;

/// Transformation between machine and program coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorkOffset {
    /// The coordinate system, 1 … 9 for G54 … G59.3.
    pub system: u8,
    /// Its origin with the offsets of G92 and of the tool, mm and degrees. In a rotated system, G92 is rotated with it.
    pub origin_mm: Pose,
    /// Rotation about Z, degrees counter-clockwise.
    pub rotation_deg: f64,
}

impl WorkOffset {
    /// Whether machine and program coordinates are equal.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.origin_mm == Pose::ZERO && self.rotation_deg == 0.0
    }

    /// Offsets to subtract from the coordinates of the machine's axes, mm. None where the system is rotated.
    #[must_use]
    pub fn translation<const A: usize>(&self, machine: &MachineConfig) -> Option<[f64; A]> {
        if self.rotation_deg != 0.0 {
            return None;
        }
        let mut origin = [0.0; A];
        for (slot, axis) in origin.iter_mut().zip(&machine.axes) {
            *slot = self.origin_mm[Axis::ALL[axis.index()]];
        }
        Some(origin)
    }
}

/// The state between canonical functions.
#[derive(Clone, Debug)]
pub(crate) struct CanonExecutor<'m> {
    machine: &'m MachineConfig,
    /// The machine's axes, as axes of a position.
    axes: Vec<Axis>,
    unit: LengthUnit,
    /// The coordinate system, 1 … 9 for G54 … G59.3.
    system: u8,
    /// Offsets in mm.
    g5x: Pose,
    g92: Pose,
    tool: Pose,
    /// Rotation about Z, as sine and cosine.
    rotation: (f64, f64),
    rotation_deg: f64,
    /// In mm per minute, from the units in force when it was set. Under G93 the interpreter calculates it block by
    /// block.
    /// Feed rate in force, mm/min.
    feed_mm_min: f64,
    /// Feed per turn of the spindle (G95), mm; `None` under G93 and G94.
    feed_mm_per_turn: Option<f64>,
    /// Commanded speed of the spindle, turns per minute.
    rpm: f64,
    /// The speed by X, under G96.
    surface_speed: Option<SurfaceSpeed>,
    /// Whether the spindle is held at an angle (M19).
    is_oriented: bool,
    path: PathMode,
    /// The sources of the path mode: the path control as programmed, and the naive CAM tolerance (G64 Q), both in mm.
    path_control: PathControl,
    naive_cam_mm: f64,
    /// The last position in mm, machine coordinates, as the program has it.
    at: Pose,
    /// A tool length that was entered in a pause, where the program's own offset does not include it.
    correction: Option<LengthCorrection>,
    /// Way in counts and feed in mm/s of the last probing move, which stops soon enough: a program has many alike.
    fitting_probe: Option<([i64; 9], f64)>,
    /// Whether the next straight move ends at machine coordinates.
    to_machine_coordinates: bool,
    selected_tool: u32,
    /// Whether M62 P3 has forbidden the cutters.
    is_cutter_forbidden: bool,
    /// Whether the program ignores the input that proves a cutter (M62 P1).
    is_proof_ignored: bool,
    /// Whether the height stays where it is controlled.
    is_height_held: bool,
    /// The material; `None` without a material table.
    material: Option<Arc<Material>>,
    cutters: CutterTrack,
    /// Where the layer of the tool axis is.
    layer: LayerState,
    /// Where the sheet was sensed last, X and Y, and the path of the tool axis there, in mm.
    sensed_at: Option<[f64; 3]>,
    /// Whether the spindle is on.
    spindle_turns: Option<bool>,
    /// What the program learns of the last question, until it is taken.
    learned: Option<MachineResult>,
    /// The thread that is being collected.
    thread: Option<thread::CollectedThread>,
    /// Whether the spindle has been started or changed since it was known to be at speed, and its speed then.
    awaits_speed: bool,
    rpm_reached: f64,
    /// What the contours have enclosed, where the height behind them depends on it.
    cut_areas: Option<CutAreas>,
    /// Whether the operator's overrides apply.
    feed_override: FeedOverrideSwitch,
}

impl<'m> CanonExecutor<'m> {
    /// Creates an executor at the machine's position, with the state in which every program begins.
    #[must_use]
    pub(crate) fn new(machine: &'m MachineConfig) -> Self {
        let axes: Vec<Axis> = machine.axes.iter().map(|a| Axis::ALL[a.index()]).collect();
        let at = axes.iter().zip(&machine.stands_at_mm).fold(Pose::ZERO, |at, (&axis, &mm)| at.with(axis, mm));
        Self {
            machine,
            axes,
            unit: LengthUnit::Millimetre,
            system: 1,
            g5x: Pose::ZERO,
            g92: Pose::ZERO,
            tool: Pose::ZERO,
            rotation: (0.0, 1.0),
            rotation_deg: 0.0,
            feed_mm_min: 0.0,
            feed_mm_per_turn: None,
            rpm: 0.0,
            surface_speed: None,
            is_oriented: false,
            path: PathMode::blend(machine.blend_tolerance_mm),
            path_control: PathControl::Continuous { tolerance: 0.0 },
            naive_cam_mm: 0.0,
            at,
            correction: None,
            fitting_probe: None,
            to_machine_coordinates: false,
            selected_tool: 0,
            is_cutter_forbidden: false,
            is_proof_ignored: false,
            is_height_held: false,
            material: None,
            cutters: CutterTrack::new(machine),
            layer: LayerState::Zero,
            sensed_at: None,
            spindle_turns: Some(false),
            learned: None,
            thread: None,
            awaits_speed: true,
            rpm_reached: 0.0,
            cut_areas: machine.tool_layer().filter(|layer| layer.retracts()).map(|_| CutAreas::default()),
            feed_override: FeedOverrideSwitch::default(),
        }
    }

    /// Executes one canonical function of program line `line` into `sink`.
    ///
    /// # Errors
    /// The reason why it cannot be executed; nothing has been given to the sink then.
    pub(crate) fn execute<const A: usize>(
        &mut self,
        canon: &Canon,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        if let Some(result) = self.thread(canon, line, sink) {
            return result;
        }
        match canon {
            Canon::StraightTraverse(end) => self.straight(end, FeedRate::Rapid, line, sink),
            Canon::StraightFeed(end) => self.straight(end, self.feed(), line, sink),
            Canon::ArcFeed(arc) => self.arc(arc, line, sink),
            Canon::NurbsFeed(spline) => self.spline(spline, line, sink),
            Canon::StraightProbe(end, probing) => self.probe(end, *probing, line, sink),
            Canon::UnknownMotion(end) => self.unknown_motion(end, line, sink),
            Canon::FollowBranch(branch) => {
                self.follow_branch(branch, sink);
                Ok(())
            }
            Canon::UseLengthUnits(unit) => self.change_state(|t| t.unit = *unit),
            Canon::SetG5xOffset { system, offset } => {
                self.change_state(|t| (t.system, t.g5x) = (*system, t.in_mm(offset)))
            }
            Canon::SetG92Offset(offset) => self.change_state(|t| t.g92 = t.in_mm(offset)),
            Canon::UseToolLengthOffset(offset) => self.change_state(|t| t.set_tool_offset(t.in_mm(offset))),
            Canon::MachineCoordinates => self.change_state(|t| t.to_machine_coordinates = true),
            Canon::SetXyRotation(degrees) => self.change_state(|t| {
                t.rotation_deg = *degrees;
                t.rotation = degrees.to_radians().sin_cos();
            }),
            Canon::SetFeedMode(mode) => self.set_feed_mode(*mode),
            Canon::SetFeedRate(feed) => self.change_state(|t| t.set_feed(*feed * t.unit.millimetres())),
            Canon::SetMotionControlMode(path) => self.change_state(|t| t.set_path_control(*path)),
            Canon::SetNaivecamTolerance(tolerance) => {
                self.change_state(|t| t.set_naive_cam(tolerance * t.unit.millimetres()))
            }
            Canon::Message(text) | Canon::Print(text) => Ok(sink.message(text.to_string(), line)?),
            _ => self.switching(canon, line, sink),
        }
    }

    /// End of the last move: the coordinates of the machine's own axes, mm.
    #[must_use]
    pub(crate) fn position<const A: usize>(&self) -> [f64; A] {
        let stands = self.actual_position();
        let mut own = [0.0; A];
        for (slot, &axis) in own.iter_mut().zip(&self.axes) {
            *slot = stands[axis];
        }
        own
    }

    /// Actual position behind the last move.
    fn actual_position(&self) -> Pose {
        self.correction.map_or(self.at, |correction| correction.move_end(&self.at, &self.at, false))
    }

    /// The transformation between machine and program coordinates that is in force.
    #[must_use]
    pub(crate) fn work_offset(&self) -> WorkOffset {
        let ([dx, dy], (sin, cos)) = (self.machine.pierce_mode.offset_mm(), self.rotation);
        let shift = Pose::xyz(dx * cos - dy * sin, dx * sin + dy * cos, 0.0);
        WorkOffset {
            system: self.system,
            origin_mm: self.g5x.plus(&self.g92).plus(&self.tool).plus(&shift),
            rotation_deg: self.rotation_deg,
        }
    }

    /// The material in force, on a machine with a material table.
    #[must_use]
    pub(crate) fn material(&self) -> Option<&Arc<Material>> {
        self.material.as_ref()
    }

    fn change_state(&mut self, change: impl FnOnce(&mut Self)) -> Result<(), CanonError> {
        change(self);
        Ok(())
    }

    fn in_mm(&self, pose: &Pose) -> Pose {
        pose.scaled_lengths(self.unit.millimetres())
    }

    /// Machine position in mm of a position in program coordinates and units.
    fn machine_position(&self, program: &Pose) -> Pose {
        let mut at = self.in_mm(program).plus(&self.g92);
        let [x, y] = self.machine.pierce_mode.offset_mm();
        (at[Axis::X], at[Axis::Y]) = (at[Axis::X] + x, at[Axis::Y] + y);
        if self.rotation_deg != 0.0 {
            let ((sin, cos), x, y) = (self.rotation, at[Axis::X], at[Axis::Y]);
            at[Axis::X] = x * cos - y * sin;
            at[Axis::Y] = x * sin + y * cos;
        }
        at.plus(&self.g5x).plus(&self.tool)
    }

    /// Position in program coordinates and units of a machine position in mm.
    fn program_position(&self, machine: &Pose) -> Pose {
        let mut at = machine.minus(&self.g5x).minus(&self.tool);
        if self.rotation_deg != 0.0 {
            let ((sin, cos), x, y) = (self.rotation, at[Axis::X], at[Axis::Y]);
            at[Axis::X] = x * cos + y * sin;
            at[Axis::Y] = y * cos - x * sin;
        }
        let [x, y] = self.machine.pierce_mode.offset_mm();
        (at[Axis::X], at[Axis::Y]) = (at[Axis::X] - x, at[Axis::Y] - y);
        at.minus(&self.g92).scaled_lengths(1.0 / self.unit.millimetres())
    }

    /// Coordinates of the machine's own axes.
    fn machine_coordinates<const A: usize>(&self, position: &Pose) -> Result<[f64; A], CanonError> {
        for axis in Axis::ALL {
            if !self.axes.contains(&axis) && (position[axis] - self.at[axis]).abs() > 1e-9 {
                return Err(CanonError::NoSuchAxis(char::from(axis.letter())));
            }
        }
        let mut own = [0.0; A];
        for (slot, &axis) in own.iter_mut().zip(&self.axes) {
            *slot = position[axis];
        }
        Ok(own)
    }

    fn feed(&self) -> FeedRate {
        FeedRate::PerSecond(self.feed_mm_min / 60.0)
    }

    /// The path mode that was programmed last.
    fn path_mode(&self) -> PathMode {
        match self.path_control {
            PathControl::ExactStop => PathMode::ExactStop,
            PathControl::ExactPath => PathMode::ExactPath,
            PathControl::Continuous { tolerance: named } => {
                let tolerance_mm = if named > 0.0 { named } else { self.machine.blend_tolerance_mm };
                PathMode::Blend { tolerance_mm, merge_mm: own_naive_cam(named, self.naive_cam_mm) }
            }
        }
    }

    /// Sets the naive CAM tolerance, which follows the G64 that it belongs to.
    fn set_naive_cam(&mut self, tolerance_mm: f64) {
        self.naive_cam_mm = tolerance_mm;
        self.path = self.path_mode();
    }

    fn set_path_control(&mut self, path: PathControl) {
        self.path_control = match path {
            PathControl::Continuous { tolerance } => {
                PathControl::Continuous { tolerance: tolerance * self.unit.millimetres() }
            }
            exact => exact,
        };
        self.path = self.path_mode();
    }

    fn straight<const A: usize>(
        &mut self,
        end: &Pose,
        feed: FeedRate,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        let position = self.machine_position(end);
        let is_machine = std::mem::take(&mut self.to_machine_coordinates);
        let really =
            self.correction.map_or(position, |correction| correction.move_end(&self.at, &position, is_machine));
        let own = self.machine_coordinates(&really)?;
        let is_rapid = matches!(feed, FeedRate::Rapid);
        if !is_rapid && self.leaves_cut_out() {
            return Ok(());
        }
        self.switch_feed_override(line, sink)?;
        if is_rapid {
            self.cutters.before_rapid(self.machine, line, sink)?;
        } else {
            self.before_feed(line, sink)?;
        }
        self.layer_before_move(&own, is_rapid, line, sink)?;
        self.give_line((&self.position(), own), feed, self.path, line, sink)?;
        self.record_move_end(position, &really);
        self.follow_contour();
        Ok(())
    }

    /// Whether a feed move is left out: this run pierces only, and a cutter is on.
    fn leaves_cut_out(&self) -> bool {
        let mut cutters = self.machine.cutters.iter().filter(|cutter| cutter.kind != CutterKind::Spindle);
        self.machine.pierce_mode.cuts_nothing() && cutters.any(|of| self.cutters.is_lit(self.machine, of.fire))
    }

    fn arc<const A: usize>(
        &mut self,
        arc: &retrace_gcode::ArcFeed,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        if self.leaves_cut_out() {
            return Ok(());
        }
        let [first, second, _] = arc.plane.axes();
        let index = |axis: Axis| self.axes.iter().position(|&a| a == axis);
        let (Some(p), Some(q)) = (index(first), index(second)) else {
            let missing = if index(first).is_none() { first } else { second };
            return Err(CanonError::NoSuchAxis(char::from(missing.letter())));
        };
        if self.rotation_deg != 0.0 && arc.plane != Plane::Xy {
            return Err(CanonError::NotSupported("an arc in G18 or G19 in a rotated coordinate system"));
        }
        let mut centre = arc.end;
        centre[first] = arc.first_centre;
        centre[second] = arc.second_centre;
        let (position, mut centre) = (self.machine_position(&arc.end), self.machine_position(&centre));
        let mut really = position;
        if let Some(correction) = &self.correction {
            let axis = correction.axis();
            let is_in_plane = [first, second].contains(&axis);
            let Some(mm) = correction.arc_shift(&self.at, is_in_plane) else {
                return Err(CanonError::NotSupported(
                    "an arc in the tool axis that begins at machine coordinates, with a tool length that was entered,",
                ));
            };
            centre[axis] += mm;
            really = if is_in_plane {
                really.with(axis, really[axis] + mm)
            } else {
                correction.move_end(&self.at, &position, false)
            };
        }
        let own = ArcMove {
            plane: [p, q],
            centre_mm: [centre[first], centre[second]],
            rotation: arc.turns,
            end_mm: self.machine_coordinates(&really)?,
        };
        self.switch_feed_override(line, sink)?;
        self.before_feed(line, sink)?;
        self.layer_before_move(&own.end_mm, false, line, sink)?;
        self.give_arc(&own, line, sink)?;
        self.record_move_end(position, &really);
        if let Some(areas) = self.cut_areas.as_mut().filter(|_| arc.plane == Plane::Xy) {
            areas.follow_arc([centre[Axis::X], centre[Axis::Y]], arc.turns, [really[Axis::X], really[Axis::Y]]);
        }
        Ok(())
    }

    /// Splits a spline into chords within a tenth of the blend tolerance, and at least a micrometre.
    fn spline<const A: usize>(
        &mut self,
        spline: &Nurbs,
        line: u32,
        sink: &mut impl MotionSink<A>,
    ) -> Result<(), CanonError> {
        if self.leaves_cut_out() {
            return Ok(());
        }
        let (deviation_mm, inside) = match self.path {
            PathMode::Blend { tolerance_mm, .. } => ((tolerance_mm / 10.0).max(MIN_DEVIATION_MM), self.path),
            _ => (MIN_DEVIATION_MM, PathMode::blend(MIN_DEVIATION_MM)),
        };
        self.switch_feed_override(line, sink)?;
        self.before_feed(line, sink)?;
        // The mode in force is that of the spline's end; inside, a chord is not a separate block.
        let mut held = None;
        let feed = self.feed();
        let mut start = self.position();
        chords(spline, deviation_mm / self.unit.millimetres(), |(x, y)| {
            let mut position = self.machine_position(&Pose::xyz(x, y, 0.0));
            for axis in &Axis::ALL[2..] {
                position[*axis] = self.at[*axis];
            }
            let really = self.correction.map_or(position, |correction| correction.move_end(&self.at, &position, false));
            let own: [f64; A] = self.machine_coordinates(&really)?;
            // A chord early: the one before is still held back.
            if let Some(before) = held.replace(own) {
                self.give_line((&start, before), feed, inside, line, sink)?;
                start = before;
            }
            self.record_move_end(position, &really);
            self.follow_contour();
            Ok::<(), CanonError>(())
        })?;
        match held {
            Some(last) => self.give_line((&start, last), feed, self.path, line, sink),
            None => Ok(()),
        }
    }
}

/// The naive CAM tolerance in mm, where it differs from the path tolerance: a G64 without Q makes them equal, so equal
/// values need no separate one.
fn own_naive_cam(path_mm: f64, naive_cam_mm: f64) -> Option<f64> {
    ((naive_cam_mm - path_mm).abs() > 1e-9 * path_mm).then_some(naive_cam_mm)
}
