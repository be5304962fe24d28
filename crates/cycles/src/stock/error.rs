//! Reasons for refusing a stock removal job: the control's alarm number and a sentence.
//!
//! Invariant: every error has a number of the control's alarm list. Its sentence is formatted when it is displayed, not
//! before.

use std::fmt;

/// Reason why a job has no path. The contour reader uses the errors of a contour too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StockRemovalError {
    /// VARI is not in 1 to 12 or 201 to 212.
    MachiningType(i32),
    /// The falling flank of this line is steeper than the clearance angle.
    ClearanceAngle {
        /// Line of the contour's source.
        line: u32,
        /// Steepest angle of the flank against the cut axis, in degrees.
        flank: f64,
        /// Clearance angle of the tool, in degrees.
        clearance: f64,
    },
    /// The nose does not fit into the contour at this line, so finishing would leave the element out.
    NoseTooLarge(u32),
    /// The first block lacks an axis of the plane.
    MissingAxis(u32),
    /// A tool, offset, plane or frame change inside the contour.
    ChangeInside(u32),
    /// An element does not begin where the previous one ends.
    Gap(u32),
    /// The contour moves backward in the cut direction at this line.
    Overhang(u32),
    /// The element of this line runs back over the previous one.
    DoublesBack(u32),
    /// Start and end of the contour have the same position along the cut axis.
    NoExtent,
    /// The chamfer or rounding of this line does not fit its elements.
    Corner(u32),
    /// The centre does not have the same distance from both ends of the arc.
    Centre(u32),
    /// A number is not finite or beyond [`super::LARGEST`].
    Number(&'static str),
    /// The tool is inside the blank at the call.
    StartInBlank,
    /// MID is 0, or so small that the levels cannot be counted.
    InfeedDepth,
    /// The element is not a G0, G1, G2 or G3.
    Interpolation(u32),
    /// An arc of more than half a turn.
    LongArc(u32),
    /// Cutter radius compensation is switched inside the contour.
    CompensationInside(u32),
    /// Fewer than three blocks with motion in the plane.
    TooFewBlocks,
    /// More elements than the cycle's table holds.
    TooManyElements,
    /// The job needs more moves than the maximum of one path.
    TooManyMoves,
    /// The first block has none of G0 to G3.
    MissingMotion(u32),
}

impl StockRemovalError {
    /// Returns the control's alarm number.
    pub const fn number(&self) -> u32 {
        match self {
            Self::MachiningType(_) => 61002,
            Self::ClearanceAngle { .. } | Self::NoseTooLarge(_) => 61604,
            Self::MissingAxis(_)
            | Self::ChangeInside(_)
            | Self::Gap(_)
            | Self::Overhang(_)
            | Self::DoublesBack(_)
            | Self::NoExtent
            | Self::Corner(_)
            | Self::Centre(_)
            | Self::Number(_) => 61605,
            Self::StartInBlank => 61607,
            Self::InfeedDepth => 61610,
            Self::Interpolation(_) => 10930,
            Self::LongArc(_) | Self::CompensationInside(_) => 10931,
            Self::TooFewBlocks => 10933,
            Self::TooManyElements | Self::TooManyMoves => 10934,
            Self::MissingMotion(_) => 15800,
        }
    }

    /// Returns the alarm that follows it: 61606, contour preparation failed, after each alarm of the contour reader.
    pub const fn followed_by(&self) -> Option<u32> {
        match self.number() {
            10930..=10934 | 15800 => Some(61606),
            _ => None,
        }
    }

    /// Returns the line of the contour's source, if the error has one.
    pub const fn line(&self) -> Option<u32> {
        match *self {
            Self::ClearanceAngle { line, .. }
            | Self::NoseTooLarge(line)
            | Self::MissingAxis(line)
            | Self::ChangeInside(line)
            | Self::Gap(line)
            | Self::Overhang(line)
            | Self::DoublesBack(line)
            | Self::Corner(line)
            | Self::Centre(line)
            | Self::Interpolation(line)
            | Self::LongArc(line)
            | Self::CompensationInside(line)
            | Self::MissingMotion(line) => Some(line),
            _ => None,
        }
    }
}

impl fmt::Display for StockRemovalError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sentence = match self {
            Self::MachiningType(vari) => return write!(out, "VARI is {vari}; it must be 1 to 12 or 201 to 212"),
            Self::ClearanceAngle { flank, clearance, .. } => {
                return write!(out, "the flank falls by {flank:.2} degrees, the tool clears {clearance:.2} degrees");
            }
            Self::Number(name) => return write!(out, "{name} is not a finite number within the limits"),
            Self::NoseTooLarge(_) => "the tool's nose does not fit into the contour here",
            Self::MissingAxis(_) => "the first block of the contour must name both axes of the plane",
            Self::ChangeInside(_) => "tool, offset, plane and frame must not change inside the contour",
            Self::Gap(_) => "the element does not begin where the previous one ends",
            Self::Overhang(_) => "the contour turns back along the cut axis; an overhang cannot be cut",
            Self::DoublesBack(_) => "the element runs back over the previous one",
            Self::NoExtent => "the contour begins and ends at the same place along the cut axis",
            Self::Corner(_) => "the chamfer or rounding does not fit its elements",
            Self::Centre(_) => "the centre of the arc is not at the same distance from both its ends",
            Self::StartInBlank => "the tool is inside the blank at the call",
            Self::InfeedDepth => "the infeed depth MID is 0 or too small",
            Self::Interpolation(_) => "a contour may have G0, G1, G2 and G3 only",
            Self::LongArc(_) => "an arc of the contour must not be longer than half a turn",
            Self::CompensationInside(_) => "G40, G41 and G42 are not allowed inside the contour",
            Self::TooFewBlocks => "a contour needs at least three blocks with motion in the plane",
            Self::TooManyElements => "the contour has too many elements; split it",
            Self::TooManyMoves => "the job needs too many moves; enlarge MID or DAM, or split the contour",
            Self::MissingMotion(_) => "the first block of the contour must contain one of G0 to G3",
        };
        out.write_str(sentence)
    }
}

impl std::error::Error for StockRemovalError {}
