//! Reading of the contour: the checks of the control, chamfers and roundings, correction of centres.
//!
//! Invariant: the resulting segments are joined end to end, every segment has length, and no arc is longer than half a
//! turn.

use std::f64::consts::PI;

use super::corner::break_corner;
use super::segment::{Arc, Segment};
use super::{Corner, Element, Kind, LARGEST, Point, StockRemovalError};

/// Maximum distance between an end and the next start, and length below which an element is ignored.
const JOINT: f64 = 1e-6;

/// Maximum difference of the radii at the two ends of an arc, as controls allow for programs written with three
/// decimals.
const RADII: f64 = 0.01;

/// Returns the contour as segments in programmed order.
pub(super) fn read(elements: &[Element]) -> Result<Vec<Segment>, StockRemovalError> {
    if let Some(other) = elements.iter().find(|element| element.kind == Kind::Other) {
        return Err(StockRemovalError::Interpolation(other.line));
    }
    // The block that defines the start is one of the three, and is not an element.
    if elements.len() < 2 {
        return Err(StockRemovalError::TooFewBlocks);
    }
    // Far more than the table holds: refused before any work is done on them.
    if elements.len() > 10 * super::shape::MAX_ELEMENTS {
        return Err(StockRemovalError::TooManyElements);
    }
    for (number, element) in elements.iter().enumerate() {
        check_numbers(element)?;
        if number > 0 && elements[number - 1].end.distance(element.start) > JOINT {
            return Err(StockRemovalError::Gap(element.line));
        }
    }
    let mut segments: Vec<(Segment, Corner)> = Vec::with_capacity(elements.len());
    for element in elements {
        // A corner belongs to the last motion before it, even where an element without length follows.
        match segment(element)? {
            Some(segment) => segments.push((segment, element.corner)),
            None => {
                if let Some((_, corner)) = segments.last_mut().filter(|_| element.corner != Corner::None) {
                    *corner = element.corner;
                }
            }
        }
    }
    with_corners(segments)
}

fn check_numbers(element: &Element) -> Result<(), StockRemovalError> {
    let corner = match element.corner {
        Corner::None => 0.0,
        Corner::ChamferLength(size) | Corner::ChamferLeg(size) | Corner::Rounding(size) => size,
    };
    let centre = if is_arc(element.kind) { element.centre } else { Point::default() };
    for point in [element.start, element.end, centre] {
        check_number("a coordinate of the contour", point.u)?;
        check_number("a coordinate of the contour", point.v)?;
    }
    check_number("a chamfer or rounding", corner)
}

/// Checks that a number is finite and small enough for the arithmetic.
pub(super) fn check_number(name: &'static str, value: f64) -> Result<(), StockRemovalError> {
    if value.abs() <= LARGEST { Ok(()) } else { Err(StockRemovalError::Number(name)) }
}

fn is_arc(kind: Kind) -> bool {
    matches!(kind, Kind::Clockwise | Kind::Counterclockwise)
}

fn segment(element: &Element) -> Result<Option<Segment>, StockRemovalError> {
    let Element { start, end, line, .. } = *element;
    let nothing = start.distance(end) <= JOINT;
    if !is_arc(element.kind) {
        return Ok((!nothing).then_some(Segment { start, end, arc: None, line }));
    }
    // Both ends at one place: a full turn.
    if nothing {
        return Err(StockRemovalError::LongArc(line));
    }
    if (start.distance(element.centre) - end.distance(element.centre)).abs() > RADII {
        return Err(StockRemovalError::Centre(line));
    }
    // The centre is moved to where both radii are equal: onto the perpendicular bisector of the chord.
    let middle = start.plus(end).times(0.5);
    let upright = end.minus(start).rotate_left().unit();
    let centre = middle.plus(upright.times(element.centre.minus(middle).dot(upright)));
    let arc = Arc { centre, counterclockwise: element.kind == Kind::Counterclockwise };
    if arc.sweep(start, end) > PI + 1e-6 {
        return Err(StockRemovalError::LongArc(line));
    }
    Ok(Some(Segment { start, end, arc: Some(arc), line }))
}

fn with_corners(mut segments: Vec<(Segment, Corner)>) -> Result<Vec<Segment>, StockRemovalError> {
    let mut whole = Vec::with_capacity(segments.len());
    for number in 0..segments.len() {
        let (mut before, corner) = segments[number];
        let between = match segments.get_mut(number + 1) {
            Some((after, _)) => break_corner(&mut before, after, corner)?,
            None => None,
        };
        whole.extend([Some(before), between].into_iter().flatten().filter(|segment| segment.length() > JOINT));
    }
    if whole.is_empty() {
        return Err(StockRemovalError::NoExtent);
    }
    Ok(whole)
}
