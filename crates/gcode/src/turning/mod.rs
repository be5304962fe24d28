//! Turning cycles G70, G71 and G72: finishing of a profile in passes, and roughing of the material above it in levels.
//!
//! Invariant: the calculation is done in a [`Frame`] in which the profile runs towards greater `a`, the tool is at
//! greater `h`, and infeed is towards smaller `h`. Inputs and outputs are X and Z of the program, in program units.

mod allowance;
mod frame;
mod profile;
mod rough;

pub(crate) use frame::{Frame, XzPoint};
pub(crate) use profile::Profile;

use frame::{Point, Segment};
use rough::MAX_LEVELS;
use std::fmt;

/// Pockets that G71 and G72 rough.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pockets {
    /// G71, G72: each pocket in its order.
    Included,
    /// G71.1, G72.1: none; the tool passes over them.
    Skipped,
    /// G71.2, G72.2: pockets only.
    Only,
}

/// Operation along a profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum TurningJob {
    /// G70: passes at allowances that decrease from `first` to `last`, which the last pass leaves.
    Finish { first: f64, last: f64, passes: u32 },
    /// G71 (along Z) and G72 (`facing`, along X).
    Rough { facing: bool, pockets: Pockets, allowance: f64, infeed: f64, retreat: f64 },
}

/// A move of a turning cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum TurningMove {
    Rapid(XzPoint),
    Feed(XzPoint),
    /// Counter-clockwise as G3 in G18: seen with Z to the right and X upwards.
    Arc {
        end: XzPoint,
        centre: XzPoint,
        counterclockwise: bool,
    },
}

/// Reason why a profile cannot be turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RoughingError {
    /// It has no element after its first point.
    Empty,
    /// It turns back along its own direction, in the element of this index.
    NotMonotonic(usize),
    /// The allowance leaves nothing of the profile, or the remaining parts do not meet at the element of this index.
    Allowance(usize),
    /// The infeed is too small for the height to be roughed.
    TooManyLevels,
}

impl RoughingError {
    /// The index of the element at fault, where one is.
    pub(crate) const fn element(self) -> Option<usize> {
        match self {
            Self::NotMonotonic(element) | Self::Allowance(element) => Some(element),
            Self::Empty | Self::TooManyLevels => None,
        }
    }
}

impl fmt::Display for RoughingError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Empty => "the profile has no line and no arc after its first point",
            Self::NotMonotonic(_) => "the profile turns back along its own direction",
            Self::Allowance(_) => "the allowance D is too great for the profile: its elements no longer meet",
            Self::TooManyLevels => "the infeed I is so small that there would be more than 10 000 levels",
        })
    }
}

impl std::error::Error for RoughingError {}

/// Turns a profile from `start`, and passes each move to the output.
///
/// # Errors
/// The profile does not allow it; no move has been output then.
pub(crate) fn turn(
    profile: &Profile,
    start: XzPoint,
    job: &TurningJob,
    out: &mut impl FnMut(TurningMove),
) -> Result<(), RoughingError> {
    let facing = matches!(job, TurningJob::Rough { facing: true, .. });
    let frame = Frame::new(profile, start, facing)?;
    let mut segments: Vec<Segment> = profile.segments(&frame);
    if matches!(job, TurningJob::Rough { .. })
        && let Some(back) = segments.iter().find(|segment| !segment.is_monotonic())
    {
        return Err(RoughingError::NotMonotonic(back.element));
    }
    let mut start = frame.point(start);
    start.a = start.a.min(frame.point(profile.first).a);
    match *job {
        TurningJob::Finish { first, last, passes } => {
            let step = (first - last) / f64::from(passes);
            let paths: Result<Vec<_>, _> =
                (1..=passes).map(|pass| allowance::offset(&segments, first - step * f64::from(pass))).collect();
            let mut tool = TurningTool { frame: &frame, at: start, out };
            for path in paths? {
                tool.rapid(start);
                tool.rapid(path.first().map_or(start, |segment| segment.from));
                for segment in &path {
                    tool.along(segment, segment.to);
                }
            }
        }
        TurningJob::Rough { pockets, allowance, infeed, retreat, .. } => {
            // Where the profile ends below the stock there is a shoulder, which keeps its allowance too.
            if let Some(last) = segments.last().copied()
                && last.to.h < start.h
                && frame.point(profile.first).h < start.h
                && (last.to.a - last.from.a).abs() > 0.0
            {
                let top = Point { a: last.to.a, h: start.h };
                segments.push(Segment { from: last.to, to: top, arc: None, ..last });
            }
            let path = allowance::offset(&segments, allowance)?;
            let lowest = path.iter().map(|segment| segment.to.h).fold(f64::INFINITY, f64::min);
            if path.iter().any(|segment| (segment.to.h - lowest) / infeed > MAX_LEVELS)
                || (start.h - lowest) / infeed > MAX_LEVELS
            {
                return Err(RoughingError::TooManyLevels);
            }
            let tool = TurningTool { frame: &frame, at: start, out };
            rough::rough(path, start, (pockets, infeed, retreat), tool);
        }
    }
    Ok(())
}

/// The tool in the frame.
struct TurningTool<'a, O> {
    frame: &'a Frame,
    at: Point,
    out: &'a mut O,
}

impl<O: FnMut(TurningMove)> TurningTool<'_, O> {
    fn rapid(&mut self, to: Point) {
        self.at = to;
        (self.out)(TurningMove::Rapid(self.frame.place(to)));
    }

    fn feed(&mut self, to: Point) {
        self.at = to;
        (self.out)(TurningMove::Feed(self.frame.place(to)));
    }

    /// Moves along a segment, on which the tool is, up to `to`.
    fn along(&mut self, segment: &Segment, to: Point) {
        match segment.arc {
            None => self.feed(to),
            Some(_) if self.at.distance(to) < frame::TINY => {}
            Some(arc) => {
                self.at = to;
                let centre = self.frame.place(arc.centre);
                let counterclockwise = arc.counterclockwise != self.frame.mirrors();
                (self.out)(TurningMove::Arc { end: self.frame.place(to), centre, counterclockwise });
            }
        }
    }
}
