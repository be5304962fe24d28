//! Canonical functions: the machine-independent steps that the interpreter makes of a program.
//!
//! Invariant: names, order and arguments are those of LinuxCNC's canonical functions. Lengths are in the program's
//! units in force (the last [`Canon::UseLengthUnits`]), angles in degrees, positions in the program's coordinate
//! system.

use crate::block_number::BlockNumber;
use crate::canon_modes::{FeedMode, LengthUnit, PathControl, Plane, Probing};
use crate::cutting::CuttingSwitch;
use crate::material::Material;
use crate::pose::Pose;
use crate::spline::Nurbs;
use crate::tool::Tool;
use std::sync::Arc;

/// An input of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitInput {
    /// Digital input (P word).
    Digital(i32),
    /// Analog input (E word).
    Analog(i32),
}

/// Condition that a wait at an input ends with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitFor {
    /// No wait: the present value is read.
    Immediate,
    /// The input changes to on.
    Rise,
    /// The input changes to off.
    Fall,
    /// The input is on.
    High,
    /// The input is off.
    Low,
}

/// A wait for an input (M66).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaitForInput {
    /// Input to read.
    pub input: WaitInput,
    /// Condition to wait for.
    pub wait_for: WaitFor,
    /// Maximum time in seconds.
    pub timeout: f64,
}

/// A circular or helical arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArcFeed {
    /// Plane of the arc.
    pub plane: Plane,
    /// End position on all axes.
    pub end: Pose,
    /// Centre on the first axis of the plane.
    pub first_centre: f64,
    /// Centre on the second axis of the plane.
    pub second_centre: f64,
    /// Number of turns begun: positive counter-clockwise, negative clockwise, seen from the positive end of the normal
    /// axis; never 0.
    pub turns: i32,
}

/// State in which a check follows another branch, or the joined path behind the branches (PRB-18). Unknown values are
/// NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct BranchStart {
    /// Whether the program comes here whatever the machine answers.
    pub is_certain: bool,
    /// State behind another line than the last one; `None` where the path continues behind it.
    pub state: Option<BranchState>,
}

/// State that canonical functions before a branch have set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BranchState {
    /// Unit of what follows.
    pub units: LengthUnit,
    /// Coordinate system in force, 1 … 9.
    pub system: u8,
    /// Origin of the coordinate system.
    pub origin: Pose,
    /// Rotation of the coordinate system, in degrees.
    pub rotation_degrees: f64,
    /// Offset of G52 and G92.
    pub g92_offset: Pose,
    /// Tool length offset.
    pub tool_offset: Pose,
    /// Position in program coordinates.
    pub position: Pose,
    /// Feed rate in units per minute, or per turn.
    pub feed_rate: f64,
    /// Meaning of the feed rate; `None` where it is unknown.
    pub feed_mode: Option<FeedMode>,
    /// Speed of the spindle in turns per minute; under G96 in metres or feet per minute.
    pub spindle_speed: f64,
    /// Highest speed of the spindle under G96, in turns per minute; 0 under G97.
    pub max_spindle_speed: f64,
    /// Whether the spindle turns; `None` where it is unknown.
    pub spindle_turns: Option<bool>,
}

/// One canonical function.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)] // the names are the definition; arguments that need an explanation have one
pub enum Canon {
    /// The interpreter has returned to its initial state (program opened or closed).
    OnReset,
    /// The program ended at its closing percent sign.
    Finish,
    UseLengthUnits(LengthUnit),
    /// Sets the origin of the coordinate system 1 … 9 (G54 … G59.3) that is now in force.
    SetG5xOffset {
        system: u8,
        offset: Pose,
    },
    SetG92Offset(Pose),
    /// Sets the rotation of the coordinate system about Z, in degrees.
    SetXyRotation(f64),
    SetFeedReference,
    SetFeedMode(FeedMode),
    /// Sets the feed rate in program units per minute.
    SetFeedRate(f64),
    StraightTraverse(Pose),
    StraightFeed(Pose),
    ArcFeed(ArcFeed),
    /// Moves along a spline in the plane of X and Y; the other axes stay.
    NurbsFeed(Nurbs),
    /// A motion whose way is not known, to this end. In a check only; an unknown coordinate is a NaN.
    UnknownMotion(Pose),
    /// The path behind a branch on an unknown value. In a check only.
    FollowBranch(Box<BranchStart>),
    TurnProbeOn,
    /// Moves towards the end until the probe responds as the kind of probing requires (G38.2 … G38.5).
    StraightProbe(Pose, Probing),
    TurnProbeOff,
    SelectPlane(Plane),
    SetMotionControlMode(PathControl),
    /// Sets the tolerance for merging nearly straight moves, in program units.
    SetNaivecamTolerance(f64),
    /// Dwells for this time in seconds.
    Dwell(f64),
    /// Sets the spindle speed in turns per minute, at least 0.
    SetSpindleSpeed(f64),
    /// Starts the spindle or cutter of this number (`$`; M3). 0 is the spindle of a program without `$`.
    StartSpindleClockwise(u8),
    /// M4.
    StartSpindleCounterclockwise(u8),
    /// M5.
    StopSpindleTurning(u8),
    /// Selects constant surface speed with this maximum in turns per minute; 0 selects constant speed (G97).
    SetSpindleMode(f64),
    /// Turns the spindle to an angle and holds it there. Direction: 0 the shortest, 1 and 2 as in M19, 2 and 3 as in
    /// G87. `timeout_s`: the time that the wait behind it has, if there is one.
    OrientSpindle {
        degrees: f64,
        mode: u8,
        timeout_s: Option<f64>,
    },
    /// Waits for the angle, at most this time in seconds.
    WaitSpindleOrientComplete(f64),
    /// Synchronises the following feed moves with the spindle, in program units per turn.
    StartSpeedFeedSynch {
        pitch: f64,
        /// Angle from the index at which the thread begins, degrees (G33 Q, which LinuxCNC does not have).
        start_degrees: f64,
    },
    StopSpeedFeedSynch,
    /// Taps to X Y Z and back, synchronised with the spindle, which reverses there.
    RigidTap {
        /// X, Y and Z of the depth.
        end: [f64; 3],
        /// Speed of the spindle on the way back, in parts of that on the way in.
        return_factor: f64,
    },
    StartChange,
    /// Changes to the selected tool; the number of the tool, 0 for none.
    ChangeTool {
        tool: u32,
        /// Tool that was in the spindle before, which may be the same.
        was: u32,
        /// Entry in the tool table, from 1; 0 for none.
        index: u32,
        /// Comment on the tool in the tool table.
        comment: Option<Box<str>>,
    },
    SelectTool(u32),
    /// Declares this number for the tool in the spindle (M61).
    ChangeToolNumber {
        tool: u32,
        /// Entry in the tool table, from 1; 0 for none.
        index: u32,
    },
    /// G10 L1, L10, L11: sets the data of a tool, in machine units. The entry in the table is counted from 1; 0 is the
    /// tool in the spindle.
    SetToolTableEntry {
        index: u32,
        tool: Tool,
    },
    /// G10 L0: reloads the tool table from its file.
    ReloadToolData,
    UseToolLengthOffset(Pose),
    MistOn,
    MistOff,
    FloodOn,
    FloodOff,
    EnableFeedOverride,
    DisableFeedOverride,
    EnableSpeedOverride,
    DisableSpeedOverride,
    EnableAdaptiveFeed,
    DisableAdaptiveFeed,
    EnableFeedHold,
    DisableFeedHold,
    /// Switches an output on, synchronised with motion (M62).
    SetMotionOutputBit(i32),
    /// Switches an output off, synchronised with motion (M63).
    ClearMotionOutputBit(i32),
    /// Switches an output on immediately (M64).
    SetAuxOutputBit(i32),
    /// Switches an output off immediately (M65).
    ClearAuxOutputBit(i32),
    /// Sets an analog output, synchronised with motion (M67).
    SetMotionOutputValue {
        output: i32,
        value: f64,
    },
    /// Sets an analog output immediately (M68).
    SetAuxOutputValue {
        output: i32,
        value: f64,
    },
    /// Reads an input (M66); the result becomes parameter 5399.
    Wait(WaitForInput),
    /// M100 … M199: the action that the machine file declares for this number.
    UserCode {
        number: u8,
        p: Option<f64>,
        q: Option<f64>,
    },
    /// The material of the following contours: from M190, from a comment `(o=0, …)`, and at the beginning of a program.
    /// Only on a machine with a material table.
    SelectMaterial(Arc<Material>),
    /// Allows or forbids a function of the cut cycle (M62 to M65 with P1 to P3 on a machine with a material table).
    SetCutting(CuttingSwitch, bool),
    /// M159: figure 601 to 609 of a pierce in motion. The material with it follows.
    SetPierceValue {
        number: u16,
        value: f64,
    },
    /// The straight move that follows ends at machine coordinates, on the axes that it moves (G53, G28, G30).
    MachineCoordinates,
    Comment(Arc<str>),
    /// A comment of the interpreter on a change of mode.
    Note(&'static str),
    /// A message for the operator (MSG, DEBUG).
    Message(Arc<str>),
    /// Text for standard output (PRINT).
    Print(Arc<str>),
    /// Opens a log file of this name, truncated or for appending (LOGOPEN, LOGAPPEND).
    LogOpen {
        file: Arc<str>,
        append: bool,
    },
    /// A line for the log file (LOG).
    Log(Arc<str>),
    LogClose,
    /// M0.
    ProgramStop,
    /// M1.
    OptionalProgramStop,
    PalletShuttle,
    /// M2, M30.
    ProgramEnd,
}

impl Canon {}

/// One canonical function with the block that it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct CanonStep {
    /// Line of the program, counted from 1; 0 before the first line and after the last. Steps of a subprogram in
    /// another file have the line of the call.
    pub line: u32,
    /// N word of that line.
    pub number: Option<BlockNumber>,
    /// The canonical function.
    pub canon: Canon,
}

impl Canon {
    /// Whether the machine needs time for this step: a motion, a dwell, a wait, a stop, a tool change or a user code.
    #[must_use]
    pub const fn takes_time(&self) -> bool {
        matches!(
            self,
            Canon::StraightTraverse(_)
                | Canon::StraightFeed(_)
                | Canon::ArcFeed(_)
                | Canon::NurbsFeed(_)
                | Canon::UnknownMotion(_)
                | Canon::StraightProbe(..)
                | Canon::RigidTap { .. }
                | Canon::Dwell(_)
                | Canon::Wait(_)
                | Canon::WaitSpindleOrientComplete(_)
                | Canon::ProgramStop
                | Canon::OptionalProgramStop
                | Canon::PalletShuttle
                | Canon::ChangeTool { .. }
                | Canon::UserCode { .. }
        )
    }
}
