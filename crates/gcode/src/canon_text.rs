//! Canonical functions as text, one a line, as LinuxCNC's `rs274 -g` prints them.
//!
//! Invariant: the counter goes up by one with every line but those of PRINT, which go out as they are.

use crate::canon::{ArcFeed, Canon, FeedMode, LengthUnit, PathControl, Plane, Step};
use crate::pose::{Axis, Pose};
use std::io::{self, Write};

/// Writes steps in the form of `rs274 -g`: `    7 N0020  STRAIGHT_FEED(1.0000, …)`.
#[derive(Debug)]
pub struct CanonText<W> {
    out: W,
    lines: u64,
}

impl<W: Write> CanonText<W> {
    /// A writer that counts from 1.
    pub fn new(out: W) -> CanonText<W> {
        CanonText { out, lines: 0 }
    }

    /// Writes one step.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(&mut self, step: &Step) -> io::Result<()> {
        if let Canon::Print(text) = &step.canon {
            return writeln!(self.out, "{text}");
        }
        self.lines += 1;
        write!(self.out, "{:5} ", self.lines)?;
        match step.number {
            Some(number) => write!(self.out, "{:<7}", format!("N{number}"))?,
            None => self.out.write_all(b"N..... ")?,
        }
        self.call(&step.canon)?;
        self.out.write_all(b"\n")
    }

    /// The writer back.
    pub fn into_inner(self) -> W {
        self.out
    }

    fn call(&mut self, canon: &Canon) -> io::Result<()> {
        let out = &mut self.out;
        match canon {
            Canon::UseLengthUnits(LengthUnit::Inch) => write!(out, "USE_LENGTH_UNITS(CANON_UNITS_INCHES)"),
            Canon::UseLengthUnits(LengthUnit::Millimetre) => write!(out, "USE_LENGTH_UNITS(CANON_UNITS_MM)"),
            Canon::SetG5xOffset { system, offset } => {
                write!(out, "SET_G5X_OFFSET({system}, ")?;
                six(out, offset)
            }
            Canon::SetG92Offset(offset) => pose(out, "SET_G92_OFFSET", offset),
            Canon::SetXyRotation(degrees) => write!(out, "SET_XY_ROTATION({degrees:.4})"),
            Canon::SetFeedMode(FeedMode::InverseTime | FeedMode::UnitsPerMinute) => write!(out, "SET_FEED_MODE(0, 0)"),
            Canon::SetFeedRate(rate) => write!(out, "SET_FEED_RATE({rate:.4})"),
            Canon::StraightTraverse(end) => pose(out, "STRAIGHT_TRAVERSE", end),
            Canon::StraightFeed(end) => pose(out, "STRAIGHT_FEED", end),
            Canon::ArcFeed(feed) => arc(out, feed),
            Canon::SelectPlane(Plane::Xy) => write!(out, "SELECT_PLANE(CANON_PLANE_XY)"),
            Canon::SelectPlane(Plane::Zx) => write!(out, "SELECT_PLANE(CANON_PLANE_XZ)"),
            Canon::SelectPlane(Plane::Yz) => write!(out, "SELECT_PLANE(CANON_PLANE_YZ)"),
            Canon::SetMotionControlMode(mode) => path_control(out, *mode),
            Canon::SetNaivecamTolerance(tolerance) => write!(out, "SET_NAIVECAM_TOLERANCE({tolerance:.4})"),
            Canon::Dwell(seconds) => write!(out, "DWELL({seconds:.4})"),
            Canon::SetSpindleSpeed(rpm) => write!(out, "SET_SPINDLE_SPEED(0, {rpm:.4})"),
            Canon::SetSpindleMode(limit) => write!(out, "SET_SPINDLE_MODE(0 {limit:.4})"),
            Canon::ChangeTool(tool) => write!(out, "CHANGE_TOOL({tool})"),
            Canon::SelectTool(tool) => write!(out, "SELECT_TOOL({tool})"),
            Canon::ChangeToolNumber(tool) => write!(out, "CHANGE_TOOL_NUMBER({tool})"),
            Canon::UseToolLengthOffset(offset) => tool_offset(out, offset),
            Canon::SetMotionOutputBit(bit) => write!(out, "SET_MOTION_OUTPUT_BIT({bit})"),
            Canon::ClearMotionOutputBit(bit) => write!(out, "CLEAR_MOTION_OUTPUT_BIT({bit})"),
            Canon::SetAuxOutputBit(bit) => write!(out, "SET_AUX_OUTPUT_BIT({bit})"),
            Canon::ClearAuxOutputBit(bit) => write!(out, "CLEAR_AUX_OUTPUT_BIT({bit})"),
            Canon::Comment(text) => write!(out, "COMMENT(\"{text}\")"),
            Canon::Note(text) => write!(out, "COMMENT(\"{text}\")"),
            Canon::Message(text) => write!(out, "MESSAGE(\"{text}\")"),
            plain => out.write_all(plain_name(plain).as_bytes()),
        }
    }
}

/// The functions without an argument of their own.
const fn plain_name(canon: &Canon) -> &'static str {
    match canon {
        Canon::OnReset => "ON_RESET()",
        Canon::Finish => "FINISH()",
        Canon::SetFeedReference => "SET_FEED_REFERENCE(CANON_XYZ)",
        Canon::StartSpindleClockwise => "START_SPINDLE_CLOCKWISE(0)",
        Canon::StartSpindleCounterclockwise => "START_SPINDLE_COUNTERCLOCKWISE(0)",
        Canon::StopSpindleTurning => "STOP_SPINDLE_TURNING(0)",
        Canon::StartChange => "START_CHANGE()",
        Canon::MistOn => "MIST_ON()",
        Canon::MistOff => "MIST_OFF()",
        Canon::FloodOn => "FLOOD_ON()",
        Canon::FloodOff => "FLOOD_OFF()",
        Canon::EnableFeedOverride => "ENABLE_FEED_OVERRIDE()",
        Canon::DisableFeedOverride => "DISABLE_FEED_OVERRIDE()",
        Canon::EnableSpeedOverride => "ENABLE_SPEED_OVERRIDE(0)",
        Canon::DisableSpeedOverride => "DISABLE_SPEED_OVERRIDE(0)",
        Canon::EnableAdaptiveFeed => "ENABLE_ADAPTIVE_FEED()",
        Canon::DisableAdaptiveFeed => "DISABLE_ADAPTIVE_FEED()",
        Canon::EnableFeedHold => "ENABLE_FEED_HOLD()",
        Canon::DisableFeedHold => "DISABLE_FEED_HOLD()",
        Canon::ProgramStop => "PROGRAM_STOP()",
        Canon::OptionalProgramStop => "OPTIONAL_PROGRAM_STOP()",
        Canon::PalletShuttle => "PALLET_SHUTTLE()",
        Canon::ProgramEnd => "PROGRAM_END()",
        _ => "",
    }
}

fn six(out: &mut impl Write, pose: &Pose) -> io::Result<()> {
    let [x, y, z, a, b, c, ..] = pose.0;
    write!(out, "{x:.4}, {y:.4}, {z:.4}, {a:.4}, {b:.4}, {c:.4})")
}

fn pose(out: &mut impl Write, name: &str, pose: &Pose) -> io::Result<()> {
    write!(out, "{name}(")?;
    six(out, pose)
}

fn arc(out: &mut impl Write, feed: &ArcFeed) -> io::Result<()> {
    let [first, second, normal] = feed.plane.axes();
    write!(
        out,
        "ARC_FEED({:.4}, {:.4}, {:.4}, {:.4}, {}, {:.4}, {:.4}, {:.4}, {:.4})",
        feed.end[first],
        feed.end[second],
        feed.first_centre,
        feed.second_centre,
        feed.turns,
        feed.end[normal],
        feed.end[Axis::A],
        feed.end[Axis::B],
        feed.end[Axis::C]
    )
}

fn path_control(out: &mut impl Write, mode: PathControl) -> io::Result<()> {
    match mode {
        PathControl::ExactPath => write!(out, "SET_MOTION_CONTROL_MODE(CANON_EXACT_PATH)"),
        PathControl::ExactStop => write!(out, "SET_MOTION_CONTROL_MODE(CANON_EXACT_STOP)"),
        PathControl::Continuous { tolerance } => {
            write!(out, "SET_MOTION_CONTROL_MODE(CANON_CONTINUOUS, {tolerance:.6})")
        }
    }
}

fn tool_offset(out: &mut impl Write, offset: &Pose) -> io::Result<()> {
    let [x, y, z, a, b, c, u, v, w] = offset.0;
    write!(out, "USE_TOOL_LENGTH_OFFSET({x:.4} {y:.4} {z:.4}, {a:.4} {b:.4} {c:.4}, {u:.4} {v:.4} {w:.4})")
}
