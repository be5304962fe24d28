//! The last pass: the programmed contour in one pass, with compensation for the nose, relief cuts included.
//!
//! Invariant: the elements are as programmed (or all of them reversed), at their own positions, without allowance.

use super::frame::Frame;
use super::move_writer::MoveWriter;
use super::segment::Segment;
use super::{Compensation, Feed, Point, StockRemovalError};

/// Emits the moves along the contour and back to the start point. The tool is at the start point before and after.
pub(super) fn finish(
    writer: &mut MoveWriter,
    segments: &[Segment],
    frame: Frame,
    with_the_cut: bool,
) -> Result<(), StockRemovalError> {
    let start = writer.at();
    let Some((first, last)) = segments.first().zip(segments.last()) else { return Ok(()) };
    writer.compensate(side(frame, with_the_cut));
    writer.rapid(frame.into(first.start))?;
    for segment in segments {
        let to = frame.into(segment.end);
        match segment.arc {
            None => writer.line(to, Feed::Finish)?,
            Some(arc) => {
                writer.arc(to, frame.into(arc.centre), arc.counterclockwise != frame.mirrors(), Feed::Finish)?;
            }
        }
    }
    writer.compensate(Compensation::Off);
    let end = frame.into(last.end);
    if end.v < highest(segments, frame) - super::piece::TINY {
        writer.rapid_infeed_axis(start.v)?;
        writer.rapid_cut_axis(start.u)
    } else {
        writer.rapid(start)
    }
}

/// Returns the side of compensation. With the material left of the travel, the tool is on the right: G42. Travelling
/// with the cut in normalised coordinates, the part is on the left.
fn side(frame: Frame, with_the_cut: bool) -> Compensation {
    if with_the_cut != frame.mirrors() { Compensation::Right } else { Compensation::Left }
}

/// Returns the largest v of the contour; arcs extend beyond their ends.
fn highest(segments: &[Segment], frame: Frame) -> f64 {
    let tops = segments.iter().map(|segment| {
        let ends = frame.into(segment.start).v.max(frame.into(segment.end).v);
        let Some(arc) = segment.arc else { return ends };
        let radius = segment.start.distance(arc.centre);
        let top = frame.out(frame.into(arc.centre).plus(Point::new(0.0, radius)));
        let passed = arc.sweep(segment.start, top) <= arc.sweep(segment.start, segment.end);
        if passed { ends.max(frame.into(top).v) } else { ends }
    });
    tops.fold(f64::NEG_INFINITY, f64::max)
}
