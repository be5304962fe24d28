//! From canonical functions to moves of the machine's axes, in mm and machine coordinates.
//!
//! Invariant: units, offsets and rotation are applied here and nowhere else; a move of an axis that the machine does not have is
//! refused, and what no rule here knows is refused by name.

use retrace_gcode::{Axis, Canon, FeedMode, LengthUnit, Nurbs, PathControl, Plane, Pose};
use retrace_link::{Change, channel};
use retrace_motion::{Arc, Feed, MoveError, PathMode};

use crate::cutter_track::CutterTrack;
use crate::feed::{Refused, Switch};
use crate::item::Kind;
use crate::job::Finding;
use crate::machine::{Machine, ToolChange};
use crate::sink::Sink;
use crate::spline::chords;
use crate::switching::{Class, InReverse, Switching};

/// Chords of splines come no nearer than this has to be, mm.
const LEAST_DEVIATION_MM: f64 = 0.001;

/// Why a canonical function cannot be run on this machine.
#[derive(Clone, Debug, PartialEq)]
pub enum Untrackable {
    /// E4301: an axis is moved that the machine does not have.
    NoSuchAxis(char),
    /// E4302: a canonical function that is not supported yet.
    NotSupported(&'static str),
    /// E4303: an output that the card does not have.
    NoSuchOutput(i32),
    /// E4306: a rapid move while the cutter of this name is on.
    RapidWhileLit(String),
    /// The planner's refusal.
    Move(MoveError),
    /// The job was given up.
    Cancelled,
}

impl Untrackable {
    /// Number, what is wrong, what to do.
    fn parts(&self) -> (&'static str, String, &'static str) {
        match self {
            Self::NoSuchAxis(axis) => (
                "E4301",
                format!("axis {axis} is moved, and the machine has no such axis"),
                "add the axis to the machine file, or take its words out of the program",
            ),
            Self::NotSupported(what) => ("E4302", format!("{what} is not supported yet"), "take it out of the program"),
            Self::NoSuchOutput(n) => ("E4303", format!("there is no output {n}"), "an output is a number from 0 to 63"),
            Self::RapidWhileLit(cutter) => (
                "E4306",
                format!("a rapid move (G0) while the {cutter} is on"),
                "switch it off before the move (M5, M65 …), use G1, or write rapid_lit = true in its [[cutter]] table",
            ),
            Self::Move(error) => (error.number(), error.to_string(), "correct the move"),
            Self::Cancelled => ("", String::new(), ""),
        }
    }

    /// Number, what is wrong and what to do, in one line.
    #[must_use]
    pub fn explain(&self) -> String {
        let (number, what, remedy) = self.parts();
        format!("error[{number}]: {what}; {remedy}")
    }

    /// As a finding of program line `line`.
    #[must_use]
    pub fn finding(&self, line: u32) -> Finding {
        let (number, what, remedy) = self.parts();
        let word = match self {
            Self::NoSuchAxis(axis) => Some(*axis),
            _ => None,
        };
        Finding { line, word, number, what, remedy: remedy.into() }
    }
}

impl From<Refused> for Untrackable {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Move(error) => Self::Move(error),
            Refused::Cancelled => Self::Cancelled,
        }
    }
}

impl From<crate::feed::Cancelled> for Untrackable {
    fn from(_: crate::feed::Cancelled) -> Self {
        Self::Cancelled
    }
}

/// What lies between machine and program coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorkOffset {
    /// The coordinate system, 1 … 9 for G54 … G59.3.
    pub system: u8,
    /// Its origin with the offset of G92 and the tool's, mm and degrees; of a rotated system G92 is turned with it.
    pub origin_mm: Pose,
    /// Rotation about Z, degrees counter-clockwise.
    pub rotation_deg: f64,
}

impl WorkOffset {
    /// Are machine and program coordinates the same?
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.origin_mm == Pose::ZERO && self.rotation_deg == 0.0
    }

    /// What to take from each coordinate of the machine's axes, mm; none where the system is rotated.
    #[must_use]
    pub fn translation<const A: usize>(&self, machine: &Machine) -> Option<[f64; A]> {
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
pub struct Track<'m> {
    machine: &'m Machine,
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
    /// In mm a minute, from the units in force when it was set; under G93 the interpreter reckons it block by block.
    feed_mm_min: f64,
    path: PathMode,
    /// What the path mode is made of: the path control as it was programmed, and the naive cam tolerance (G64 Q); both in mm.
    path_control: PathControl,
    naive_cam_mm: f64,
    /// The last position in mm, machine coordinates.
    at: Pose,
    selected_tool: u32,
    cutters: CutterTrack,
}

impl<'m> Track<'m> {
    /// Where the machine stands, with the state in which every program begins.
    #[must_use]
    pub fn new(machine: &'m Machine) -> Self {
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
            path: PathMode::blend(machine.blend_tolerance_mm),
            path_control: PathControl::Continuous { tolerance: 0.0 },
            naive_cam_mm: 0.0,
            at,
            selected_tool: 0,
            cutters: CutterTrack::new(machine),
        }
    }

    /// Runs one canonical function of program line `line` into `sink`.
    ///
    /// # Errors
    /// Why it cannot be run; nothing has been given to the sink then.
    pub fn run<const A: usize>(
        &mut self,
        canon: &Canon,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        match canon {
            Canon::StraightTraverse(end) => self.straight(end, Feed::Rapid, line, sink),
            Canon::StraightFeed(end) => self.straight(end, self.feed(), line, sink),
            Canon::ArcFeed(arc) => self.arc(arc, line, sink),
            Canon::NurbsFeed(spline) => self.spline(spline, line, sink),
            Canon::UseLengthUnits(unit) => self.state(|t| t.unit = *unit),
            Canon::SetG5xOffset { system, offset } => self.state(|t| (t.system, t.g5x) = (*system, t.in_mm(offset))),
            Canon::SetG92Offset(offset) => self.state(|t| t.g92 = t.in_mm(offset)),
            Canon::UseToolLengthOffset(offset) => self.state(|t| t.tool = t.in_mm(offset)),
            Canon::SetXyRotation(degrees) => self.state(|t| {
                t.rotation_deg = *degrees;
                t.rotation = degrees.to_radians().sin_cos();
            }),
            Canon::SetFeedRate(feed) => self.state(|t| t.feed_mm_min = *feed * t.unit.millimetres()),
            Canon::SetMotionControlMode(path) => self.state(|t| t.set_path_control(*path)),
            Canon::SetNaivecamTolerance(tolerance) => self.state(|t| t.set_naive_cam(tolerance * t.unit.millimetres())),
            Canon::Message(text) | Canon::Print(text) => Ok(sink.message(text.to_string(), line)?),
            _ => self.switching(canon, line, sink),
        }
    }

    /// Where the last move ended: the coordinates of the machine's own axes, mm.
    #[must_use]
    pub fn position<const A: usize>(&self) -> [f64; A] {
        let mut own = [0.0; A];
        for (slot, &axis) in own.iter_mut().zip(&self.axes) {
            *slot = self.at[axis];
        }
        own
    }

    /// What lies between machine and program coordinates now.
    #[must_use]
    pub fn work_offset(&self) -> WorkOffset {
        WorkOffset {
            system: self.system,
            origin_mm: self.g5x.plus(&self.g92).plus(&self.tool),
            rotation_deg: self.rotation_deg,
        }
    }

    fn state(&mut self, change: impl FnOnce(&mut Self)) -> Result<(), Untrackable> {
        change(self);
        Ok(())
    }

    fn in_mm(&self, pose: &Pose) -> Pose {
        pose.scaled_lengths(self.unit.millimetres())
    }

    /// Machine position in mm of a position in program coordinates and units.
    fn machine_position(&self, program: &Pose) -> Pose {
        let mut at = self.in_mm(program).plus(&self.g92);
        if self.rotation_deg != 0.0 {
            let ((sin, cos), x, y) = (self.rotation, at[Axis::X], at[Axis::Y]);
            at[Axis::X] = x * cos - y * sin;
            at[Axis::Y] = x * sin + y * cos;
        }
        at.plus(&self.g5x).plus(&self.tool)
    }

    /// The coordinates of the machine's own axes.
    fn of_machine<const A: usize>(&self, position: &Pose) -> Result<[f64; A], Untrackable> {
        for axis in Axis::ALL {
            if !self.axes.contains(&axis) && (position[axis] - self.at[axis]).abs() > 1e-9 {
                return Err(Untrackable::NoSuchAxis(char::from(axis.letter())));
            }
        }
        let mut own = [0.0; A];
        for (slot, &axis) in own.iter_mut().zip(&self.axes) {
            *slot = position[axis];
        }
        Ok(own)
    }

    fn feed(&self) -> Feed {
        Feed::PerSecond(self.feed_mm_min / 60.0)
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

    /// The naive cam tolerance follows the G64 that it belongs to.
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
        feed: Feed,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        let position = self.machine_position(end);
        let own = self.of_machine(&position)?;
        if matches!(feed, Feed::Rapid) {
            self.cutters.before_rapid(self.machine, line, sink)?;
        } else {
            self.cutters.before_feed(self.machine, line, sink);
        }
        sink.straight(own, feed, self.path, line)?;
        self.at = position;
        Ok(())
    }

    fn arc<const A: usize>(
        &mut self,
        arc: &retrace_gcode::ArcFeed,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        let [first, second, _] = arc.plane.axes();
        let index = |axis: Axis| self.axes.iter().position(|&a| a == axis);
        let (Some(p), Some(q)) = (index(first), index(second)) else {
            let missing = if index(first).is_none() { first } else { second };
            return Err(Untrackable::NoSuchAxis(char::from(missing.letter())));
        };
        if self.rotation_deg != 0.0 && arc.plane != Plane::Xy {
            return Err(Untrackable::NotSupported("an arc in G18 or G19 in a rotated coordinate system"));
        }
        let mut centre = arc.end;
        centre[first] = arc.first_centre;
        centre[second] = arc.second_centre;
        let (position, centre) = (self.machine_position(&arc.end), self.machine_position(&centre));
        let own = Arc {
            plane: [p, q],
            centre_mm: [centre[first], centre[second]],
            rotation: arc.turns,
            end_mm: self.of_machine(&position)?,
        };
        self.cutters.before_feed(self.machine, line, sink);
        sink.arc(&own, self.feed(), self.path, line)?;
        self.at = position;
        Ok(())
    }

    /// Chords within a tenth of the blend tolerance, and a micrometre at least.
    fn spline<const A: usize>(
        &mut self,
        spline: &Nurbs,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        let (deviation_mm, inside) = match self.path {
            PathMode::Blend { tolerance_mm, .. } => ((tolerance_mm / 10.0).max(LEAST_DEVIATION_MM), self.path),
            _ => (LEAST_DEVIATION_MM, PathMode::blend(LEAST_DEVIATION_MM)),
        };
        self.cutters.before_feed(self.machine, line, sink);
        // The mode in force is that of the spline's end; inside, a chord is no block of its own.
        let mut held = None;
        let feed = self.feed();
        chords(spline, deviation_mm / self.unit.millimetres(), |(x, y)| {
            let mut position = self.machine_position(&Pose::xyz(x, y, 0.0));
            for axis in &Axis::ALL[2..] {
                position[*axis] = self.at[*axis];
            }
            let own: [f64; A] = self.of_machine(&position)?;
            if let Some(before) = held.replace(own) {
                sink.straight(before, feed, inside, line)?;
            }
            self.at = position;
            Ok::<(), Untrackable>(())
        })?;
        match held {
            Some(last) => Ok(sink.straight(last, feed, self.path, line)?),
            None => Ok(()),
        }
    }

    fn switching<const A: usize>(
        &mut self,
        canon: &Canon,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        match canon {
            Canon::StartSpindleClockwise => self.switch("M3", channel::SPINDLE, 1, line, sink),
            Canon::StartSpindleCounterclockwise => self.switch("M4", channel::SPINDLE, -1, line, sink),
            Canon::StopSpindleTurning => self.switch("M5", channel::SPINDLE, 0, line, sink),
            Canon::MistOn => self.switch("M7", channel::MIST, 1, line, sink),
            Canon::FloodOn => self.switch("M8", channel::FLOOD, 1, line, sink),
            Canon::MistOff => self.switch("M9", channel::MIST, 0, line, sink),
            Canon::FloodOff => self.switch("M9", channel::FLOOD, 0, line, sink),
            Canon::SetSpindleSpeed(rpm) => {
                let thousandths = (rpm * 1000.0).clamp(0.0, f64::from(i32::MAX)).round() as i32;
                self.switch("S", channel::SPEED, thousandths, line, sink)
            }
            Canon::SelectTool(tool) => {
                self.selected_tool = *tool;
                self.exclusive("T", &[], self.machine.switching.of("T"), line, sink)
            }
            Canon::ChangeTool { tool, remark, .. } => self.change_tool(*tool, remark.as_deref(), line, sink),
            Canon::SetMotionOutputBit(n) => self.switch_output("M62", digital(*n, 1)?, line, sink),
            Canon::ClearMotionOutputBit(n) => self.switch_output("M63", digital(*n, 0)?, line, sink),
            Canon::SetAuxOutputBit(n) => self.switch_output("M64", digital(*n, 1)?, line, sink),
            Canon::ClearAuxOutputBit(n) => self.switch_output("M65", digital(*n, 0)?, line, sink),
            Canon::Dwell(seconds) => {
                let periods = (seconds / self.machine.period_s()).ceil().clamp(0.0, f64::from(u32::MAX)) as u32;
                let dwell = Switch { line, kind: Kind::Dwell, code: "G4", periods, ..Switch::default() };
                Ok(sink.exclusive(dwell)?)
            }
            Canon::ProgramStop => {
                let stop = Switch { line, kind: Kind::ProgramStop, code: "M0", ..Switch::default() };
                Ok(sink.exclusive(stop)?)
            }
            Canon::OptionalProgramStop => {
                let stop = Switch { line, kind: Kind::OptionalStop, code: "M1", ..Switch::default() };
                Ok(sink.exclusive(stop)?)
            }
            // no pallet to move
            Canon::PalletShuttle => Ok(()),
            Canon::SetSpindleMode(css) if *css > 0.0 => Err(Untrackable::NotSupported("constant surface speed (G96)")),
            // these wait for a spindle whose turning the card can follow
            Canon::SetFeedMode(FeedMode::UnitsPerRevolution) => Err(Untrackable::NotSupported("feed per turn (G95)")),
            Canon::StartSpeedFeedSynch { .. } => Err(Untrackable::NotSupported("thread cutting (G33, G76)")),
            Canon::RigidTap(_) => Err(Untrackable::NotSupported("rigid tapping (G33.1)")),
            Canon::OrientSpindle { .. } | Canon::WaitSpindleOrientComplete(_) => {
                Err(Untrackable::NotSupported("orienting the spindle (M19, G87)"))
            }
            Canon::StraightProbe(..) => Err(Untrackable::NotSupported("probing (G38)")),
            Canon::Wait(_) => Err(Untrackable::NotSupported("waiting for an input (M66)")),
            Canon::SetMotionOutputValue { .. } => Err(Untrackable::NotSupported("an analog output (M67)")),
            Canon::SetAuxOutputValue { .. } => Err(Untrackable::NotSupported("an analog output (M68)")),
            Canon::UserCode { number, .. } => self.user_code(*number, line, sink),
            // nothing of these moves or switches anything on this machine
            Canon::OnReset
            | Canon::Finish
            | Canon::SetFeedMode(_)
            | Canon::SelectPlane(_)
            | Canon::SetFeedReference
            | Canon::SetSpindleMode(_)
            | Canon::StopSpeedFeedSynch
            | Canon::StartChange
            | Canon::ChangeToolNumber { .. }
            | Canon::EnableFeedOverride
            | Canon::DisableFeedOverride
            | Canon::EnableSpeedOverride
            | Canon::DisableSpeedOverride
            | Canon::EnableAdaptiveFeed
            | Canon::DisableAdaptiveFeed
            | Canon::EnableFeedHold
            | Canon::DisableFeedHold
            | Canon::Comment(_)
            | Canon::Note(_)
            | Canon::TurnProbeOn
            | Canon::TurnProbeOff
            | Canon::SetToolTableEntry { .. }
            | Canon::ReloadToolData
            | Canon::LogOpen { .. }
            | Canon::Log(_)
            | Canon::LogClose
            | Canon::ProgramEnd => Ok(()),
            // `run` has these; a new canonical function is one that the compiler asks for here
            Canon::StraightTraverse(_)
            | Canon::StraightFeed(_)
            | Canon::ArcFeed(_)
            | Canon::NurbsFeed(_)
            | Canon::UseLengthUnits(_)
            | Canon::SetG5xOffset { .. }
            | Canon::SetG92Offset(_)
            | Canon::UseToolLengthOffset(_)
            | Canon::SetXyRotation(_)
            | Canon::SetFeedRate(_)
            | Canon::SetMotionControlMode(_)
            | Canon::SetNaivecamTolerance(_)
            | Canon::Message(_)
            | Canon::Print(_) => Ok(()),
        }
    }

    /// M6: where the operator changes the tool, what is to be put in is told where the motion stops.
    fn change_tool<const A: usize>(
        &mut self,
        tool: u32,
        remark: Option<&str>,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        let change = Change { channel: channel::TOOL, value: tool as i32 };
        let Switching { periods, until, in_reverse, .. } = self.machine.switching.of("M6");
        let manual = self.machine.tool_change == ToolChange::Manual;
        if manual {
            let remark = remark.map(|remark| format!(" ({remark})")).unwrap_or_default();
            let what = if tool == 0 { "take the tool out".into() } else { format!("put in tool {tool}{remark}") };
            sink.message(format!("tool change: {what}, then cycle start"), line)?;
        }
        let kind = if manual { Kind::ToolChange } else { Kind::Switch };
        let one_way = in_reverse == InReverse::Barrier;
        let changes = &[change];
        Ok(sink.exclusive(Switch { line, kind, code: "M6", changes, periods, until, one_way, undone: false })?)
    }

    /// M100 to M199 switch the output that the machine file declares for them.
    fn user_code<const A: usize>(&mut self, number: u8, line: u32, sink: &mut impl Sink<A>) -> Result<(), Untrackable> {
        let Some(code) = self.machine.switching.user_code(number) else {
            return Err(Untrackable::NotSupported("a user code that the machine file does not declare"));
        };
        let change = Change { channel: code.output, value: code.value };
        self.carry_out(code.name, change, code.switching, line, sink)
    }

    /// Switches one output, in passing or at rest, as the machine file has it for `code`.
    fn switch<const A: usize>(
        &mut self,
        code: &'static str,
        channel: u8,
        value: i32,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        self.carry_out(code, Change { channel, value }, self.machine.switching.of(code), line, sink)
    }

    /// Switches a digital output by M62 … M65.
    fn switch_output<const A: usize>(
        &mut self,
        code: &'static str,
        change: Change,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        self.carry_out(code, change, self.machine.switching.of(code), line, sink)
    }

    fn carry_out<const A: usize>(
        &mut self,
        code: &'static str,
        change: Change,
        switching: Switching,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        self.cutters.switched(self.machine, &[change]);
        match (switching.class, switching.in_reverse) {
            (Class::Synchronous, InReverse::AsIs) => sink.lasting_action(change, line),
            (Class::Synchronous, _) => sink.action(change, line),
            (Class::Exclusive, _) => return self.exclusive(code, &[change], switching, line, sink),
        }
        Ok(())
    }

    fn exclusive<const A: usize>(
        &self,
        code: &'static str,
        changes: &[Change],
        switching: Switching,
        line: u32,
        sink: &mut impl Sink<A>,
    ) -> Result<(), Untrackable> {
        let Switching { periods, until, in_reverse, .. } = switching;
        let (one_way, undone) = (in_reverse == InReverse::Barrier, in_reverse == InReverse::Undone);
        Ok(sink.exclusive(Switch { line, kind: Kind::Switch, code, changes, periods, until, one_way, undone })?)
    }
}

/// The naive cam tolerance in mm, where it is not just the one of the path: a G64 without Q has them equal, so that equal ones ask
/// for nothing of their own.
fn own_naive_cam(path_mm: f64, naive_cam_mm: f64) -> Option<f64> {
    ((naive_cam_mm - path_mm).abs() > 1e-9 * path_mm).then_some(naive_cam_mm)
}

fn digital(number: i32, value: i32) -> Result<Change, Untrackable> {
    match u8::try_from(number) {
        Ok(n) if usize::from(n) < channel::DIGITAL => Ok(Change { channel: n, value }),
        _ => Err(Untrackable::NoSuchOutput(number)),
    }
}
