//! Alarms of running cycles, and the table of the control's alarm numbers.
//!
//! Invariant: cycles raise alarms by the numbers of this table's first column, and users see those of the second.
//! Numbers can so be corrected here without changing a cycle.

use crate::cycle::CycleId;
use crate::error_codes::ErrorCode;
use crate::host::CycleStoppedError;
use std::fmt;

/// A run that has ended with an alarm. If the alarm comes from a check of the parameters, none of the cycle's motion
/// has taken place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Alarm {
    /// Error code of this project; [`ErrorCode::CycleAlarm`] for an alarm that a cycle raises with SETAL.
    pub code: ErrorCode,
    /// The control's alarm number, if it has one.
    pub number: Option<u32>,
    /// Cycle that was running.
    pub cycle: CycleId,
    /// Line of its source, from 1.
    pub line: u32,
    /// Description: cycle, parameter and value.
    pub text: String,
}

impl Alarm {
    /// Returns the remedy: that of the control's alarm if it has a number, otherwise that of the error code.
    #[must_use]
    pub fn help(&self) -> &'static str {
        self.number.and_then(alarm_text).map_or(self.code.remedy(), |text| text.remedy)
    }
}

impl fmt::Display for Alarm {
    /// Writes `alarm 61101: CYCLE81: …`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(number) = self.number {
            write!(f, "alarm {number}: ")?;
        }
        f.write_str(&self.text)
    }
}

impl std::error::Error for Alarm {}

/// Reason why a run has ended early.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CycleRunError {
    /// An alarm of the cycle.
    Alarm(Box<Alarm>),
    /// The host stopped at a block, and has the reason.
    Stopped,
}

impl fmt::Display for CycleRunError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Alarm(alarm) => alarm.fmt(f),
            Self::Stopped => CycleStoppedError.fmt(f),
        }
    }
}

impl std::error::Error for CycleRunError {}

/// An alarm of the control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlarmText {
    /// Number as written in the cycles.
    pub written: u32,
    /// Number as displayed.
    pub number: u32,
    /// Description.
    pub title: &'static str,
    /// Remedy.
    pub remedy: &'static str,
}

const fn text(written: u32, title: &'static str, remedy: &'static str) -> AlarmText {
    AlarmText { written, number: written, title, remedy }
}

/// All alarms that the shipped cycles and stock removal raise. Numbers apart from 61815 are from memory of the control;
/// 61890 and 62801 … 62805 are this project's own.
pub(crate) const ALARMS: &[AlarmText] = &[
    text(10930, "interpolation not allowed in the contour", "Write the contour with G0, G1, G2 and G3 only."),
    text(10931, "contour faulty", "Leave G41 and G42 out of the contour, and split arcs of more than 180 degrees."),
    text(10933, "contour has too few blocks", "Write at least three blocks with motion in the plane."),
    text(10934, "contour has too many elements", "Split the contour into several."),
    text(15800, "contour does not begin with a motion code", "Write G0, G1, G2 or G3 into the first block with axes."),
    text(61000, "no tool offset active", "Select a tool and its offset before the call."),
    text(
        61001,
        "thread pitch wrong",
        "Give a size (MPIT) or a pitch (PIT) within its range; if both, they must agree.",
    ),
    text(61002, "machining type wrong", "Give a value that the parameter knows."),
    text(61003, "no feed", "Program F above zero before the call, or give the feed parameter."),
    text(
        61101,
        "reference plane wrong",
        "Put the retraction plane and the depth on opposite sides of the reference plane.",
    ),
    text(61102, "no spindle direction", "Give 3, 4 or 5."),
    text(61103, "number of holes is zero", "Give at least one hole."),
    text(61107, "first depth wrong", "Put the first depth between the reference plane and the final depth."),
    text(61604, "tool violates the contour", "Use a tool with a larger clearance angle or a smaller nose."),
    text(61605, "contour wrong", "Correct the contour subprogram."),
    text(61606, "contour preparation failed", "Correct the contour subprogram."),
    text(61607, "start point wrong", "Begin outside of the blank."),
    text(61610, "no infeed depth", "Give an infeed depth above zero."),
    text(61808, "depth missing", "Give the depth (DP) or the depth from the reference plane (DPR)."),
    text(61815, "cutter compensation active", "Program G40 before the call."),
    text(61890, "no spindle speed", "Program S before the call, or give the speed or the dwell in another way."),
    text(62100, "no modal cycle active", "Program MCALL with a drilling cycle before it."),
    text(62801, "sign ignored", "Enter the value without sign."),
    text(62802, "depth given twice", "Give the depth either absolute or from the reference plane."),
    text(
        62803,
        "taken as full retraction",
        "Nothing needs to be done: a tap is always fully retracted between strokes.",
    ),
    text(62804, "parameter without effect", "Leave the parameter out."),
    text(62805, "value limited", "Give a value within the range."),
];

/// Returns the texts of an alarm, by the number that a cycle writes.
#[must_use]
pub fn alarm_text(written: u32) -> Option<&'static AlarmText> {
    ALARMS.iter().find(|alarm| alarm.written == written)
}
