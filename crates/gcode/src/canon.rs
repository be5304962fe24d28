//! Canonical functions: the machine-independent steps that a program becomes.
//!
//! Invariant: names, order and arguments are those of LinuxCNC's canonical functions. Lengths are in the program's units in force
//! (the last [`Canon::UseLengthUnits`]), angles in degrees, positions in the program's coordinate system.

use crate::block::BlockNumber;
use crate::pose::{Axis, Pose};
use crate::spline::Nurbs;
use crate::tool::Tool;
use std::sync::Arc;

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LengthUnit {
    /// 25.4 mm.
    Inch,
    /// Millimetre.
    Millimetre,
}

impl LengthUnit {
    /// How many millimetres one unit is.
    #[must_use]
    pub const fn millimetres(self) -> f64 {
        match self {
            LengthUnit::Inch => 25.4,
            LengthUnit::Millimetre => 1.0,
        }
    }
}

/// A plane of arcs, with its axes in the order in which [`Canon::ArcFeed`] counts them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Plane {
    /// G17: first X, second Y, normal Z.
    Xy,
    /// G18: first Z, second X, normal Y.
    Zx,
    /// G19: first Y, second Z, normal X.
    Yz,
    /// G17.1: U and V. No arc lies in it.
    Uv,
    /// G18.1: W and U. No arc lies in it.
    Wu,
    /// G19.1: V and W. No arc lies in it.
    Vw,
}

impl Plane {
    /// First, second and normal axis.
    #[must_use]
    pub const fn axes(self) -> [Axis; 3] {
        match self {
            Plane::Xy => [Axis::X, Axis::Y, Axis::Z],
            Plane::Zx => [Axis::Z, Axis::X, Axis::Y],
            Plane::Yz => [Axis::Y, Axis::Z, Axis::X],
            Plane::Uv => [Axis::U, Axis::V, Axis::W],
            Plane::Wu => [Axis::W, Axis::U, Axis::V],
            Plane::Vw => [Axis::V, Axis::W, Axis::U],
        }
    }

    /// Whether arcs may lie in it.
    #[must_use]
    pub const fn has_arcs(self) -> bool {
        matches!(self, Plane::Xy | Plane::Zx | Plane::Yz)
    }
}

/// How the path is followed at the joints of blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathControl {
    /// G61: exactly along the path, without a needless stop.
    ExactPath,
    /// G61.1: a full stop at the end of each block.
    ExactStop,
    /// G64: blended; deviation at most the tolerance in program units, 0 when the program names none.
    Continuous {
        /// Blend tolerance in program units, at least 0.
        tolerance: f64,
    },
}

/// How the feed rate is meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FeedMode {
    /// G93: F is the inverse of the minutes that the block takes.
    InverseTime,
    /// G94: units a minute.
    UnitsPerMinute,
    /// G95: units a turn of the spindle.
    UnitsPerRevolution,
}

/// What ends a probing move, and whether it is a fault when nothing does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Probing {
    /// G38.4, G38.5: the loss of contact ends it; else contact does.
    pub away: bool,
    /// G38.2, G38.4: reaching the end is a fault.
    pub must_answer: bool,
}

/// An input of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitInput {
    /// On or off (P word).
    Digital(i32),
    /// A value (E word).
    Analog(i32),
}

/// What is waited for at an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitFor {
    /// Nothing: its value is taken as it is.
    Immediate,
    /// That it goes on.
    Rise,
    /// That it goes off.
    Fall,
    /// That it is on.
    High,
    /// That it is off.
    Low,
}

/// M66.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaitForInput {
    /// The input that is asked.
    pub input: WaitInput,
    /// What is waited for.
    pub wait_for: WaitFor,
    /// For how long at most, seconds.
    pub timeout: f64,
}

/// A circular or helical arc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArcFeed {
    /// The plane in which it turns.
    pub plane: Plane,
    /// The end position on all axes.
    pub end: Pose,
    /// Centre on the first axis of the plane.
    pub first_centre: f64,
    /// Centre on the second axis of the plane.
    pub second_centre: f64,
    /// Begun turns: positive counter-clockwise, negative clockwise, seen from the positive end of the normal axis; never 0.
    pub turns: i32,
}

/// One canonical function.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)] // the names are the definition; arguments that need a word have one
pub enum Canon {
    /// The interpreter has gone back to its initial state (program opened or closed).
    OnReset,
    /// The program ended at its closing percent sign.
    Finish,
    UseLengthUnits(LengthUnit),
    /// Origin of the coordinate system 1 … 9 (G54 … G59.3) that is now in force.
    SetG5xOffset {
        system: u8,
        offset: Pose,
    },
    SetG92Offset(Pose),
    /// Rotation of the coordinate system about Z, degrees.
    SetXyRotation(f64),
    SetFeedReference,
    SetFeedMode(FeedMode),
    /// Program units a minute.
    SetFeedRate(f64),
    StraightTraverse(Pose),
    StraightFeed(Pose),
    ArcFeed(ArcFeed),
    /// Along a spline in the plane of X and Y; the other axes stay.
    NurbsFeed(Nurbs),
    TurnProbeOn,
    /// Towards the end, until the probe answers as the kind of probing has it (G38.2 … G38.5).
    StraightProbe(Pose, Probing),
    TurnProbeOff,
    SelectPlane(Plane),
    SetMotionControlMode(PathControl),
    /// Tolerance of the merging of nearly straight runs, program units.
    SetNaivecamTolerance(f64),
    /// Seconds.
    Dwell(f64),
    /// Turns a minute, at least 0.
    SetSpindleSpeed(f64),
    StartSpindleClockwise,
    StartSpindleCounterclockwise,
    StopSpindleTurning,
    /// Constant surface speed with this highest number of turns a minute; 0 is constant turns (G97).
    SetSpindleMode(f64),
    /// Turn the spindle to an angle and hold it there: 0 the shortest way, 1 and 2 as M19 has it, 2 and 3 as G87 does.
    OrientSpindle {
        degrees: f64,
        mode: u8,
    },
    /// Wait for the angle, for so many seconds at most.
    WaitSpindleOrientComplete(f64),
    /// From here on feed moves keep step with the spindle: program units a turn.
    StartSpeedFeedSynch {
        pitch: f64,
    },
    StopSpeedFeedSynch,
    /// In to X Y Z and back, in step with the spindle that turns round there.
    RigidTap([f64; 3]),
    StartChange,
    /// Put the selected tool into the spindle; the number of the tool, 0 for none.
    ChangeTool {
        tool: u32,
        /// The tool that was in the spindle before, which may be the same.
        was: u32,
        /// Its line of the tool table, from 1; 0 for none.
        index: u32,
        /// What the table's comment says of it.
        remark: Option<Box<str>>,
    },
    SelectTool(u32),
    /// The tool in the spindle is now called so (M61).
    ChangeToolNumber {
        tool: u32,
        /// Its line of the tool table, from 1; 0 for none.
        index: u32,
    },
    /// G10 L1, L10, L11: the data of a tool, in machine units; its place in the table, from 1, or 0 for the tool in the spindle.
    SetToolTableEntry {
        index: u32,
        tool: Tool,
    },
    /// G10 L0: the tool table is read again from its file.
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
    /// Output on, in step with the motion (M62).
    SetMotionOutputBit(i32),
    /// Output off, in step with the motion (M63).
    ClearMotionOutputBit(i32),
    /// Output on, at once (M64).
    SetAuxOutputBit(i32),
    /// Output off, at once (M65).
    ClearAuxOutputBit(i32),
    /// Analog output, in step with the motion (M67).
    SetMotionOutputValue {
        output: i32,
        value: f64,
    },
    /// Analog output, at once (M68).
    SetAuxOutputValue {
        output: i32,
        value: f64,
    },
    /// An input is asked for (M66); the answer becomes parameter 5399.
    Wait(WaitForInput),
    /// M100 … M199: what the machine has declared under this number.
    UserCode {
        number: u8,
        p: Option<f64>,
        q: Option<f64>,
    },
    /// The straight move that follows ends at machine coordinates, on the axes that it moves (G53, G28, G30).
    MachineCoordinates,
    Comment(Arc<str>),
    /// A comment of the interpreter itself on a change of mode.
    Note(&'static str),
    /// For the operator (MSG, DEBUG).
    Message(Arc<str>),
    /// For standard output (PRINT).
    Print(Arc<str>),
    /// A log file of this name begins, or goes on at its end (LOGOPEN, LOGAPPEND).
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

impl Canon {
    /// Whether the run waits here for cycle start: M0, M1, M60.
    #[must_use]
    pub const fn waits_for_cycle_start(&self) -> bool {
        matches!(self, Canon::ProgramStop | Canon::OptionalProgramStop)
    }
}

/// One canonical function with the block that it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct CanonStep {
    /// Line of the program, counted from 1; 0 before the first line and after the last. Steps of a subprogram in another file have the
    /// line that called it.
    pub line: u32,
    /// The N word of that line.
    pub number: Option<BlockNumber>,
    /// What is to be done.
    pub canon: Canon,
}

impl Canon {
    /// Whether the machine takes time for it by itself: a motion, a dwell, a wait, a stop, a tool change or a user code.
    #[must_use]
    pub const fn takes_time(&self) -> bool {
        matches!(
            self,
            Canon::StraightTraverse(_)
                | Canon::StraightFeed(_)
                | Canon::ArcFeed(_)
                | Canon::NurbsFeed(_)
                | Canon::StraightProbe(..)
                | Canon::RigidTap(_)
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
