//! Canonical functions as text, one a line, as LinuxCNC's `rs274 -g` prints them.
//!
//! Invariant: the counter goes up by one with every line but those of PRINT, which go out as they are.

use crate::canon::{ArcFeed, Canon, FeedMode, LengthUnit, PathControl, Plane, Step};
use crate::pose::{Axis, Pose};
use crate::tool::Tool;
use std::io::{self, Write};

/// Bytes that are gathered before they are written.
const GATHERED: usize = 1 << 15;

/// Writes steps in the form of `rs274 -g`: `    7 N0020  STRAIGHT_FEED(1.0000, …)`.
#[derive(Debug)]
pub struct CanonText<W> {
    out: W,
    lines: u64,
    /// Lines that are to be written.
    text: Vec<u8>,
}

impl<W: Write> CanonText<W> {
    /// A writer that counts from 1.
    pub fn new(out: W) -> CanonText<W> {
        CanonText { out, lines: 0, text: Vec::new() }
    }

    /// Takes one step; its line is written with those that follow, at the latest by [`CanonText::into_inner`].
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write(&mut self, step: &Step) -> io::Result<()> {
        if let Canon::Wait(_) | Canon::UserCode { .. } = &step.canon {
            // The peer waits for nothing and knows no user codes: it prints nothing.
            return Ok(());
        }
        let text = &mut self.text;
        if let Canon::Print(message) = &step.canon {
            writeln!(text, "{message}")?;
        } else {
            self.lines += 1;
            padded(text, self.lines);
            match step.number {
                Some(number) => block_number(text, number)?,
                None => text.extend_from_slice(b"N..... "),
            }
            call(text, &step.canon)?;
            text.push(b'\n');
        }
        if self.text.len() < GATHERED { Ok(()) } else { self.flush() }
    }

    /// Writes what has been gathered.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn flush(&mut self) -> io::Result<()> {
        let written = self.out.write_all(&self.text);
        self.text.clear();
        written?;
        self.out.flush()
    }

    /// The writer back, with everything written.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn into_inner(mut self) -> io::Result<W> {
        self.flush()?;
        Ok(self.out)
    }
}

/// The counter, five characters wide, and a blank.
fn padded(out: &mut Vec<u8>, count: u64) {
    let digits = Digits::of(count);
    let digits = digits.text();
    out.extend_from_slice(&b"     "[digits.len().min(5)..]);
    out.extend_from_slice(digits);
    out.push(b' ');
}

/// N and its digits as they are written, seven characters wide.
fn block_number(out: &mut Vec<u8>, number: crate::block::BlockNumber) -> io::Result<()> {
    let start = out.len();
    write!(out, "N{number}")?;
    while out.len() < start + 7 {
        out.push(b' ');
    }
    Ok(())
}

/// The digits of a number.
struct Digits {
    text: [u8; 20],
    first: usize,
}

/// All pairs of digits.
const PAIRS: [[u8; 2]; 100] = {
    let mut pairs = [[0; 2]; 100];
    let mut value = 0;
    while value < 100 {
        pairs[value] = [b'0' + (value / 10) as u8, b'0' + (value % 10) as u8];
        value += 1;
    }
    pairs
};

impl Digits {
    fn of(mut value: u64) -> Digits {
        let mut digits = Digits { text: [b'0'; 20], first: 20 };
        while value >= 100 {
            digits.first -= 2;
            digits.text[digits.first..digits.first + 2].copy_from_slice(&PAIRS[(value % 100) as usize]);
            value /= 100;
        }
        let pair = PAIRS[(value % 100) as usize];
        digits.first -= 2;
        digits.text[digits.first..digits.first + 2].copy_from_slice(&pair);
        digits.first += usize::from(value < 10);
        digits
    }

    fn text(&self) -> &[u8] {
        &self.text[self.first..]
    }
}

fn call(out: &mut Vec<u8>, canon: &Canon) -> io::Result<()> {
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
            out.extend_from_slice(b"SET_FEED_RATE(");
            list(out, &[*rate])
        }
        Canon::StraightTraverse(end) => pose(out, "STRAIGHT_TRAVERSE", end),
        Canon::StraightFeed(end) => pose(out, "STRAIGHT_FEED", end),
        Canon::ArcFeed(feed) => arc(out, feed),
        Canon::NurbsFeed(spline) => write!(out, "NURBS_FEED({}, ...)", spline.points.len()),
        Canon::StraightProbe(end, _) => pose(out, "STRAIGHT_PROBE", end),
        Canon::SelectPlane(Plane::Xy) => write!(out, "SELECT_PLANE(CANON_PLANE_XY)"),
        Canon::SelectPlane(Plane::Zx) => write!(out, "SELECT_PLANE(CANON_PLANE_XZ)"),
        Canon::SelectPlane(Plane::Yz) => write!(out, "SELECT_PLANE(CANON_PLANE_YZ)"),
        Canon::SelectPlane(_) => write!(out, "SELECT_PLANE(CANON_PLANE_UNKNOWN)"),
        Canon::SetMotionControlMode(mode) => path_control(out, *mode),
        Canon::SetNaivecamTolerance(tolerance) => {
            out.extend_from_slice(b"SET_NAIVECAM_TOLERANCE(");
            list(out, &[*tolerance])
        }
        Canon::Dwell(seconds) => {
            out.extend_from_slice(b"DWELL(");
            list(out, &[*seconds])
        }
        Canon::SetSpindleSpeed(rpm) => write!(out, "SET_SPINDLE_SPEED(0, {rpm:.4})"),
        Canon::SetSpindleMode(limit) => write!(out, "SET_SPINDLE_MODE(0 {limit:.4})"),
        Canon::ChangeTool { index, .. } => write!(out, "CHANGE_TOOL({index})"),
        Canon::OrientSpindle { degrees, mode } => write!(out, "ORIENT_SPINDLE(0, {degrees:.4}, {mode})"),
        Canon::WaitSpindleOrientComplete(seconds) => write!(out, "SPINDLE.0.WAIT_ORIENT_COMPLETE({seconds:.4})"),
        Canon::StartSpeedFeedSynch { pitch } => write!(out, "START_SPEED_FEED_SYNC({pitch:.6},0)"),
        Canon::RigidTap(end) => {
            out.extend_from_slice(b"RIGID_TAP(");
            list(out, end)
        }
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
        plain => out.write_all(plain_name(plain).as_bytes()),
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

/// Numbers with commas between them and a parenthesis behind.
fn list(out: &mut Vec<u8>, numbers: &[f64]) -> io::Result<()> {
    for (index, value) in numbers.iter().enumerate() {
        out.extend_from_slice(if index == 0 { b"" } else { b", " });
        number(out, *value)?;
    }
    out.push(b')');
    Ok(())
}

/// A number with four decimals, rounded as `printf` does: from the exact value, a tie to even.
#[inline]
fn number(out: &mut Vec<u8>, value: f64) -> io::Result<()> {
    if value.to_bits() == 0 {
        out.extend_from_slice(b"0.0000");
        return Ok(());
    }
    let scaled = value.abs() * 10_000.0;
    // Of what is no number or too large, the conversion gives the nearest there is, and the rest is then no fraction.
    let whole = scaled as u32;
    let fraction = scaled - f64::from(whole);
    // The product is off by less than 10⁻⁶ where it is below 10⁹, so what is farther from a tie rounds as the exact value does.
    if !(scaled < 1e9 && (fraction - 0.5).abs() >= 1e-6) {
        return write!(out, "{value:.4}");
    }
    let rounded = whole + u32::from(fraction > 0.5);
    let (integer, decimals) = (rounded / 10_000, rounded % 10_000);
    // Room for a sign, five digits before the point and four behind it.
    let mut text = *b"00000000.0000";
    text[9..11].copy_from_slice(&PAIRS[(decimals / 100) as usize]);
    text[11..13].copy_from_slice(&PAIRS[(decimals % 100) as usize]);
    let mut first = 8;
    let mut rest = integer;
    while rest >= 100 {
        first -= 2;
        text[first..first + 2].copy_from_slice(&PAIRS[(rest % 100) as usize]);
        rest /= 100;
    }
    first -= 2;
    text[first..first + 2].copy_from_slice(&PAIRS[(rest % 100) as usize]);
    first += usize::from(rest < 10);
    if value.is_sign_negative() {
        first -= 1;
        text[first] = b'-';
    }
    out.extend_from_slice(&text[first..]);
    Ok(())
}

fn six(out: &mut Vec<u8>, pose: &Pose) -> io::Result<()> {
    list(out, &pose.0[..6])
}

fn pose(out: &mut Vec<u8>, name: &str, pose: &Pose) -> io::Result<()> {
    out.extend_from_slice(name.as_bytes());
    out.push(b'(');
    six(out, pose)
}

fn arc(out: &mut Vec<u8>, feed: &ArcFeed) -> io::Result<()> {
    let [first, second, normal] = feed.plane.axes();
    out.extend_from_slice(b"ARC_FEED(");
    for value in [feed.end[first], feed.end[second], feed.first_centre, feed.second_centre] {
        number(out, value)?;
        out.extend_from_slice(b", ");
    }
    write!(out, "{}, ", feed.turns)?;
    list(out, &[feed.end[normal], feed.end[Axis::A], feed.end[Axis::B], feed.end[Axis::C]])
}

fn path_control(out: &mut Vec<u8>, mode: PathControl) -> io::Result<()> {
    match mode {
        PathControl::ExactPath => {
            out.extend_from_slice(b"SET_MOTION_CONTROL_MODE(CANON_EXACT_PATH)");
            Ok(())
        }
        // The tolerance of most programs, which every drilling cycle comes back to.
        PathControl::Continuous { tolerance } if tolerance.to_bits() == 0 => {
            out.extend_from_slice(b"SET_MOTION_CONTROL_MODE(CANON_CONTINUOUS, 0.000000)");
            Ok(())
        }
        PathControl::ExactStop => write!(out, "SET_MOTION_CONTROL_MODE(CANON_EXACT_STOP)"),
        PathControl::Continuous { tolerance } => {
            write!(out, "SET_MOTION_CONTROL_MODE(CANON_CONTINUOUS, {tolerance:.6})")
        }
    }
}

fn tool_offset(out: &mut Vec<u8>, offset: &Pose) -> io::Result<()> {
    let [x, y, z, a, b, c, u, v, w] = offset.0;
    write!(out, "USE_TOOL_LENGTH_OFFSET({x:.4} {y:.4} {z:.4}, {a:.4} {b:.4} {c:.4}, {u:.4} {v:.4} {w:.4})")
}

fn tool_entry(out: &mut Vec<u8>, index: u32, tool: &Tool) -> io::Result<()> {
    write!(out, "SET_TOOL_TABLE_ENTRY({index}, {},", tool.number)?;
    for length in tool.offset.0 {
        write!(out, " {length:.4}")?;
    }
    write!(out, ", {:.4}, {:.4}, {:.0})", tool.front_angle, tool.back_angle, tool.orientation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn text(value: f64) -> String {
        let mut out = Vec::new();
        number(&mut out, value).expect("memory");
        String::from_utf8(out).expect("digits")
    }

    proptest! {
        #[test]
        fn a_number_is_rounded_from_its_exact_value(value in any::<f64>(), scale in -1_000_000_000..1_000_000_000_i64) {
            // Ties and their neighbours, and any value at all.
            let tie = scale as f64 / 20_000.0;
            for value in [value, tie, tie.next_up(), tie.next_down(), scale as f64 / 32.0, scale as f64 * 1e-9] {
                prop_assert_eq!(text(value), format!("{value:.4}"));
            }
        }
    }

    #[test]
    fn the_counter_has_five_places_or_as_many_as_it_needs() {
        for value in [1, 9, 10, 99_999, 100_000, 12_345_678, u64::MAX] {
            let mut out = Vec::new();
            padded(&mut out, value);
            assert_eq!(String::from_utf8(out).expect("digits"), format!("{value:5} "));
        }
    }

    #[test]
    fn signs_of_zero_and_ends_of_the_fast_way() {
        for value in [0.0, -0.0, -0.00004, 0.00005, 99_999.999_95, 99_999.999_9, 100_000.0, 1e300, f64::NAN] {
            assert_eq!(text(value), format!("{value:.4}"));
        }
    }
}
