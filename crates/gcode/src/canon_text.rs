//! Canonical functions as text, one per line, as LinuxCNC's `rs274 -g` prints them.
//!
//! Invariant: the counter increases by one with every line except those of PRINT, which are printed unchanged.

use crate::canon::{ArcFeed, Canon, CanonStep};
use crate::canon_modes::{FeedMode, LengthUnit, PathControl, Plane};
use crate::output_text::{LineHead, TextBuffer, TextPiece};
use crate::pose::{Axis, Pose};
use crate::tool::Tool;
use std::io::{self, Write};

/// Writer of steps in the format of `rs274 -g`: `    7 N0020  STRAIGHT_FEED(1.0000, …)`.
#[derive(Debug)]
pub struct CanonText<W> {
    out: W,
    head: LineHead,
    /// Lines not yet written.
    text: TextBuffer,
    ends: LastCoordinates,
}

impl<W: Write> CanonText<W> {
    /// Creates a writer whose counter starts at 1.
    pub fn new(out: W) -> CanonText<W> {
        CanonText { out, head: LineHead::new(), text: TextBuffer::new(), ends: LastCoordinates::default() }
    }

    /// Appends one step. Its line is buffered and written later, at the latest by [`CanonText::into_inner`].
    ///
    /// # Errors
    /// Errors of the underlying writer.
    pub fn write(&mut self, step: &CanonStep) -> io::Result<()> {
        if let Canon::Wait(_) | Canon::UserCode { .. } | Canon::MachineCoordinates = &step.canon {
            // LinuxCNC prints nothing for waits, user codes and machine coordinates.
            return Ok(());
        }
        let text = &mut self.text;
        if let Canon::Print(message) = &step.canon {
            writeln!(text, "{message}")?;
        } else {
            self.head.push_head(text, step.number.map(|number| (number.value(), number.digits())));
            match &step.canon {
                Canon::StraightFeed(end) => self.ends.write(text, b"STRAIGHT_FEED(", end)?,
                Canon::StraightTraverse(end) => self.ends.write(text, b"STRAIGHT_TRAVERSE(", end)?,
                other => call(text, other)?,
            }
            text.push_fixed(b"\n");
        }
        if self.text.should_flush() { self.flush() } else { Ok(()) }
    }

    /// Writes the buffered lines.
    ///
    /// # Errors
    /// Errors of the underlying writer.
    pub fn flush(&mut self) -> io::Result<()> {
        let written = self.out.write_all(self.text.text());
        self.text.clear();
        written?;
        self.out.flush()
    }

    /// Writes the buffered lines and returns the writer.
    ///
    /// # Errors
    /// Errors of the underlying writer.
    pub fn into_inner(mut self) -> io::Result<W> {
        self.flush()?;
        Ok(self.out)
    }
}

/// The last coordinates of straight moves. Most moves leave some of them unchanged.
#[derive(Debug, Default)]
struct LastCoordinates([(u64, TextPiece); 6]);

impl LastCoordinates {
    /// Writes the name of a move and its end.
    #[inline]
    fn write<const N: usize>(&mut self, out: &mut TextBuffer, name: &[u8; N], end: &Pose) -> io::Result<()> {
        out.push_fixed(name);
        let [x, y, z, a, b, c] = &mut self.0;
        coordinate(out, x, end[Axis::X])?;
        out.push_fixed(b", ");
        coordinate(out, y, end[Axis::Y])?;
        out.push_fixed(b", ");
        coordinate(out, z, end[Axis::Z])?;
        // Most machines have no rotary axes.
        if end[Axis::A].to_bits() | end[Axis::B].to_bits() | end[Axis::C].to_bits() == 0 {
            out.push_fixed(b", 0.0000, 0.0000, 0.0000)");
            return Ok(());
        }
        for (last, axis) in [(a, Axis::A), (b, Axis::B), (c, Axis::C)] {
            out.push_fixed(b", ");
            coordinate(out, last, end[axis])?;
        }
        out.push_fixed(b")");
        Ok(())
    }
}

/// Writes a coordinate, using the last text if the value is the same.
#[inline]
fn coordinate(out: &mut TextBuffer, last: &mut (u64, TextPiece), value: f64) -> io::Result<()> {
    // Only the initial piece is empty.
    if last.0 != value.to_bits() || last.1 == TextPiece::default() {
        let Some(piece) = TextPiece::format_number(value) else { return write!(out, "{value:.4}") };
        *last = (value.to_bits(), piece);
    }
    out.push_piece(&last.1);
    Ok(())
}

fn call(out: &mut TextBuffer, canon: &Canon) -> io::Result<()> {
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
        Canon::SetFeedMode(FeedMode::UnitsPerRevolution) => write!(out, "SET_FEED_MODE(0, 1)"),
        Canon::SetFeedRate(rate) => {
            out.push_fixed(b"SET_FEED_RATE(");
            push_numbers(out, &[*rate])
        }
        Canon::StraightTraverse(end) => pose(out, "STRAIGHT_TRAVERSE", end),
        Canon::StraightFeed(end) => pose(out, "STRAIGHT_FEED", end),
        Canon::ArcFeed(feed) => arc(out, feed),
        Canon::UnknownMotion(_) | Canon::FollowBranch(_) => Ok(()),
        Canon::NurbsFeed(spline) => write!(out, "NURBS_FEED({}, ...)", spline.points.len()),
        Canon::StraightProbe(end, _) => pose(out, "STRAIGHT_PROBE", end),
        Canon::SelectPlane(Plane::Xy) => write!(out, "SELECT_PLANE(CANON_PLANE_XY)"),
        Canon::SelectPlane(Plane::Zx) => write!(out, "SELECT_PLANE(CANON_PLANE_XZ)"),
        Canon::SelectPlane(Plane::Yz) => write!(out, "SELECT_PLANE(CANON_PLANE_YZ)"),
        Canon::SelectPlane(_) => write!(out, "SELECT_PLANE(CANON_PLANE_UNKNOWN)"),
        Canon::SetMotionControlMode(mode) => path_control(out, *mode),
        Canon::SetNaivecamTolerance(tolerance) => {
            out.push_fixed(b"SET_NAIVECAM_TOLERANCE(");
            push_numbers(out, &[*tolerance])
        }
        Canon::Dwell(seconds) => {
            out.push_fixed(b"DWELL(");
            push_numbers(out, &[*seconds])
        }
        Canon::SetSpindleSpeed(rpm) => write!(out, "SET_SPINDLE_SPEED(0, {rpm:.4})"),
        Canon::SetSpindleMode(limit) => write!(out, "SET_SPINDLE_MODE(0 {limit:.4})"),
        Canon::ChangeTool { index, .. } => write!(out, "CHANGE_TOOL({index})"),
        Canon::OrientSpindle { degrees, mode, .. } => write!(out, "ORIENT_SPINDLE(0, {degrees:.4}, {mode})"),
        Canon::WaitSpindleOrientComplete(seconds) => write!(out, "SPINDLE.0.WAIT_ORIENT_COMPLETE({seconds:.4})"),
        Canon::StartSpeedFeedSynch { pitch, start_degrees: 0.0 } => write!(out, "START_SPEED_FEED_SYNC({pitch:.6},0)"),
        Canon::StartSpeedFeedSynch { pitch, start_degrees } => {
            write!(out, "START_SPEED_FEED_SYNC({pitch:.6},0,{start_degrees:.4})")
        }
        // As `rs274` prints it, without the factor.
        Canon::RigidTap { end, .. } => {
            out.push_fixed(b"RIGID_TAP(");
            push_numbers(out, end)
        }
        Canon::StartSpindleClockwise(spindle) => write!(out, "START_SPINDLE_CLOCKWISE({spindle})"),
        Canon::StartSpindleCounterclockwise(spindle) => write!(out, "START_SPINDLE_COUNTERCLOCKWISE({spindle})"),
        Canon::StopSpindleTurning(spindle) => write!(out, "STOP_SPINDLE_TURNING({spindle})"),
        // These three are retrace's own.
        Canon::SelectMaterial(material) => write!(out, "SELECT_MATERIAL({}, \"{}\")", material.number, material.name),
        Canon::SetCutting(switch, on) => write!(out, "SET_CUTTING({switch:?}, {})", u8::from(*on)),
        Canon::SetPierceValue { number, value } => write!(out, "SET_PIERCE_VALUE({number}, {value:.6})"),
        Canon::SelectTool(tool) => write!(out, "SELECT_TOOL({tool})"),
        Canon::ChangeToolNumber { index, .. } => write!(out, "CHANGE_TOOL_NUMBER({index})"),
        Canon::UseToolLengthOffset(offset) => tool_offset(out, offset),
        Canon::SetMotionOutputBit(bit) => write!(out, "SET_MOTION_OUTPUT_BIT({bit})"),
        Canon::ClearMotionOutputBit(bit) => write!(out, "CLEAR_MOTION_OUTPUT_BIT({bit})"),
        Canon::SetAuxOutputBit(bit) => write!(out, "SET_AUX_OUTPUT_BIT({bit})"),
        Canon::ClearAuxOutputBit(bit) => write!(out, "CLEAR_AUX_OUTPUT_BIT({bit})"),
        Canon::SetToolTableEntry { index, tool } => tool_entry(out, *index, tool),
        Canon::SetMotionOutputValue { output, value } => write!(out, "SET_MOTION_OUTPUT_VALUE({output},{value:.6})"),
        Canon::SetAuxOutputValue { output, value } => write!(out, "SET_AUX_OUTPUT_VALUE({output},{value:.6})"),
        Canon::LogOpen { file, append: false } => write!(out, "LOGOPEN(\"{file}\")"),
        Canon::LogOpen { file, append: true } => write!(out, "LOGAPPEND(\"{file}\")"),
        Canon::Log(text) => write!(out, "LOG(\"{text}\")"),
        Canon::Comment(text) => write!(out, "COMMENT(\"{text}\")"),
        Canon::Note(text) => write!(out, "COMMENT(\"{text}\")"),
        Canon::Message(text) => write!(out, "MESSAGE(\"{text}\")"),
        plain => {
            out.push_text(plain_name(plain).as_bytes());
            Ok(())
        }
    }
}

/// Returns the name of a function without arguments.
const fn plain_name(canon: &Canon) -> &'static str {
    match canon {
        Canon::OnReset => "ON_RESET()",
        Canon::Finish => "FINISH()",
        Canon::SetFeedReference => "SET_FEED_REFERENCE(CANON_XYZ)",
        Canon::StopSpeedFeedSynch => "STOP_SPEED_FEED_SYNCH()",
        Canon::StartChange => "START_CHANGE()",
        Canon::TurnProbeOn => "TURN_PROBE_ON()",
        Canon::TurnProbeOff => "TURN_PROBE_OFF()",
        Canon::ReloadToolData => "RELOAD_TOOLDATA()",
        Canon::LogClose => "LOGCLOSE()",
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

/// Writes numbers separated by commas and a closing parenthesis.
fn push_numbers(out: &mut TextBuffer, numbers: &[f64]) -> io::Result<()> {
    for (index, value) in numbers.iter().enumerate() {
        if index > 0 {
            out.push_fixed(b", ");
        }
        out.push_number(*value)?;
    }
    out.push_fixed(b")");
    Ok(())
}

fn six(out: &mut TextBuffer, pose: &Pose) -> io::Result<()> {
    push_numbers(out, &pose.0[..6])
}

fn pose(out: &mut TextBuffer, name: &str, pose: &Pose) -> io::Result<()> {
    out.push_text(name.as_bytes());
    out.push_fixed(b"(");
    six(out, pose)
}

fn arc(out: &mut TextBuffer, feed: &ArcFeed) -> io::Result<()> {
    let [first, second, normal] = feed.plane.axes();
    out.push_fixed(b"ARC_FEED(");
    for value in [feed.end[first], feed.end[second], feed.first_centre, feed.second_centre] {
        out.push_number(value)?;
        out.push_fixed(b", ");
    }
    write!(out, "{}, ", feed.turns)?;
    push_numbers(out, &[feed.end[normal], feed.end[Axis::A], feed.end[Axis::B], feed.end[Axis::C]])
}

fn path_control(out: &mut TextBuffer, mode: PathControl) -> io::Result<()> {
    match mode {
        PathControl::ExactPath => {
            out.push_fixed(b"SET_MOTION_CONTROL_MODE(CANON_EXACT_PATH)");
            Ok(())
        }
        // The tolerance of most programs, which every drilling cycle restores.
        PathControl::Continuous { tolerance } if tolerance.to_bits() == 0 => {
            out.push_fixed(b"SET_MOTION_CONTROL_MODE(CANON_CONTINUOUS, 0.000000)");
            Ok(())
        }
        PathControl::ExactStop => write!(out, "SET_MOTION_CONTROL_MODE(CANON_EXACT_STOP)"),
        PathControl::Continuous { tolerance } => {
            write!(out, "SET_MOTION_CONTROL_MODE(CANON_CONTINUOUS, {tolerance:.6})")
        }
    }
}

fn tool_offset(out: &mut TextBuffer, offset: &Pose) -> io::Result<()> {
    let [x, y, z, a, b, c, u, v, w] = offset.0;
    write!(out, "USE_TOOL_LENGTH_OFFSET({x:.4} {y:.4} {z:.4}, {a:.4} {b:.4} {c:.4}, {u:.4} {v:.4} {w:.4})")
}

fn tool_entry(out: &mut TextBuffer, index: u32, tool: &Tool) -> io::Result<()> {
    write!(out, "SET_TOOL_TABLE_ENTRY({index}, {},", tool.number)?;
    for length in tool.offset.0 {
        write!(out, " {length:.4}")?;
    }
    write!(out, ", {:.4}, {:.4}, {:.0})", tool.front_angle, tool.back_angle, tool.orientation)
}
