//! Chamfers and roundings between two segments of a contour.
//!
//! Invariant: both segments are only shortened, and the inserted element begins and ends on them. An element that does
//! not fit is an error.

use super::curve::{Curve, intersect};
use super::segment::{Arc, Segment};
use super::{Corner, Point, StockRemovalError};

/// Maximum sine between two headings that count as straight, without a corner to break.
const STRAIGHT: f64 = 1e-6;

/// Breaks the corner where `before` ends and `after` begins; returns the inserted element.
pub(super) fn break_corner(
    before: &mut Segment,
    after: &mut Segment,
    corner: Corner,
) -> Result<Option<Segment>, StockRemovalError> {
    let at = before.end;
    let (arrive, leave) = (before.heading(at), after.heading(at));
    let turn = arrive.cross(leave);
    if corner == Corner::None || (turn.abs() < STRAIGHT && arrive.dot(leave) > 0.0) {
        return Ok(None);
    }
    let error = StockRemovalError::Corner(before.line);
    if turn.abs() < STRAIGHT {
        return Err(error);
    }
    let (from, to, arc) = match corner {
        Corner::None => return Ok(None),
        Corner::Rounding(radius) => rounding(before, after, radius.abs(), turn > 0.0).ok_or(error)?,
        Corner::ChamferLeg(leg) => chamfer(before, after, leg.abs()).ok_or(error)?,
        Corner::ChamferLength(length) => {
            // An isosceles triangle over the chamfer: half its base and a leg enclose half the turn.
            let half_turn = turn.atan2(arrive.dot(leave)).abs() / 2.0;
            chamfer(before, after, length.abs() / (2.0 * half_turn.cos())).ok_or(error)?
        }
    };
    if !before.contains(from) || !after.contains(to) {
        return Err(error);
    }
    before.end = from;
    after.start = to;
    Ok(Some(Segment { start: from, end: to, arc, line: before.line }))
}

type Between = (Point, Point, Option<Arc>);

/// Returns the arc of this radius that touches both segments on the inner side of the corner.
fn rounding(before: &Segment, after: &Segment, radius: f64, left: bool) -> Option<Between> {
    let aside = if left { radius } else { -radius };
    let at = before.end;
    intersect(before.offset_curve(aside)?, after.offset_curve(aside)?)
        .into_iter()
        .flatten()
        .map(|centre| (before.nearest(centre), after.nearest(centre), centre))
        .filter(|(from, to, _)| before.contains(*from) && after.contains(*to))
        .min_by(|a, b| a.2.distance(at).total_cmp(&b.2.distance(at)))
        .map(|(from, to, centre)| (from, to, Some(Arc { centre, counterclockwise: left })))
}

/// Returns the line between the points at this distance from the corner on both segments (on an arc, measured as a
/// chord).
fn chamfer(before: &Segment, after: &Segment, leg: f64) -> Option<Between> {
    let at = before.end;
    let around = Curve::Circle { centre: at, radius: leg };
    let on = |segment: &Segment| {
        intersect(segment.offset_curve(0.0)?, around).into_iter().flatten().find(|point| segment.contains(*point))
    };
    Some((on(before)?, on(after)?, None))
}
