//! Geometry of cutter radius compensation: the end of a compensated move, and its junction with the previous move.
//!
//! Invariant: only points are read and returned. The order of operations is that of LinuxCNC's interpreter, to the last
//! digit: the residue near zero prints with its sign.

use crate::angle::{plus_quarters, times_sine};
use crate::compensation::Point;
use crate::compensation::Side;
use crate::diag::{BlockResult, Span, fault};
use crate::error_codes::ErrorCode;

/// Angle in radians up to which a corner is treated as smooth.
const SMOOTH: f64 = 0.05;

/// Minimum cosine between a chord and the entry arc; below it, no arc passes through the end.
const MIN_COSINE: f64 = 0.0001;

/// The tool at its radius from the path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cutter {
    pub(super) side: Side,
    /// Radius in program units, greater than 0.
    pub(super) radius: f64,
}

impl Cutter {
    /// Whether the tool is on the inside of an arc.
    pub(super) fn is_inside(self, turns: i32) -> bool {
        (self.side == Side::Left) == (turns > 0)
    }

    /// Returns the direction in which the tool moves about an outer corner, counted as the turns of an arc.
    pub(super) const fn corner_turns(self) -> i32 {
        match self.side {
            Side::Left => -1,
            Side::Right => 1,
        }
    }

    /// Returns the point at the tool radius from another one, in this direction.
    fn offset_point(self, point: Point, direction: f64) -> Point {
        polar(point, self.radius, direction)
    }
}

/// Junction of two moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct CompensationCorner {
    /// Programmed point.
    pub(super) programmed: Point,
    /// Centre of the tool at the end of the previous move.
    pub(super) centre: Point,
    /// Compensated arc that leads there; `None` for a straight move, or when the arc has been emitted already.
    pub(super) arc: Option<PriorArc>,
}

/// The compensated arc before a corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct PriorArc {
    pub(super) centre: Point,
    pub(super) radius: f64,
    pub(super) turns: i32,
}

/// An arc as programmed.
#[derive(Clone, Copy, Debug)]
pub(super) struct ProgrammedArc {
    pub(super) centre: Point,
    pub(super) end: Point,
    pub(super) turns: i32,
}

/// Connection of two moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum CornerKind {
    /// No connection: one move continues into the other.
    Smooth,
    /// An arc about the corner, to this point.
    Convex(Point),
    /// Both moves end at this point, before the corner.
    Concave(Point),
}

fn direction(from: Point, to: Point) -> f64 {
    (to.1 - from.1).atan2(to.0 - from.0)
}

fn distance(from: Point, to: Point) -> f64 {
    (to.0 - from.0).hypot(to.1 - from.1)
}

fn polar(centre: Point, radius: f64, angle: f64) -> Point {
    (centre.0 + radius * angle.cos(), centre.1 + radius * angle.sin())
}

/// Checks a cosine or sine: outside −1 … 1 the point does not exist.
fn ratio(value: f64, at: Span) -> BlockResult<f64> {
    if (-1.0..=1.0).contains(&value) {
        return Ok(value);
    }
    fault(ErrorCode::CompensationCorner, at, "the tool does not fit into the corner before this move")
}

/// Returns the end of the first move, which leads to the path.
///
/// # Errors
/// E1654 when the move is not longer than the tool's radius.
pub(super) fn entry_line(cutter: Cutter, from: Point, to: Point, at: Span) -> BlockResult<(Point, f64)> {
    check_entry(cutter, from, to, at)?;
    let quarters = if cutter.side == Side::Left { 1 } else { -1 };
    let normal = plus_quarters(direction(from, to), quarters, 0.0);
    Ok((cutter.offset_point(to, normal), normal))
}

pub(super) fn check_entry(cutter: Cutter, from: Point, to: Point, at: Span) -> BlockResult<()> {
    if (to.0 - from.0).hypot(to.1 - from.1) > cutter.radius {
        return Ok(());
    }
    let (length, radius) = (distance(from, to), cutter.radius);
    fault(
        ErrorCode::CompensationEntry,
        at,
        format!("the entry move is {length:.4} long, and the tool's radius is {radius:.4}"),
    )
}

/// Returns end and centre of the arc that leads to the path. The centre moves so that the arc still begins at the tool
/// position.
///
/// # Errors
/// E1659 when no such arc exists.
pub(super) fn entry_arc(cutter: Cutter, from: Point, arc: &ProgrammedArc, at: Span) -> BlockResult<(Point, Point)> {
    let end = cutter.offset_point(arc.end, end_normal(cutter, arc));
    let half = distance(end, from) / 2.0;
    let to_centre = direction(end, arc.centre);
    let cosine = (direction(end, from) - to_centre).cos();
    if cosine.abs() < MIN_COSINE {
        return too_small(cutter, at);
    }
    Ok((end, polar(end, half / cosine, to_centre)))
}

/// Checks that an arc is greater than the tool, where the tool is on its inside.
///
/// # Errors
/// E1659 when it is not.
pub(super) fn check_arc(cutter: Cutter, radius: f64, turns: i32, at: Span) -> BlockResult<()> {
    if cutter.is_inside(turns) && radius <= cutter.radius { too_small(cutter, at) } else { Ok(()) }
}

fn too_small<T>(cutter: Cutter, at: Span) -> BlockResult<T> {
    fault(ErrorCode::CompensationArc, at, format!("the tool's radius {:.4} is too great for this arc", cutter.radius))
}

/// Returns the direction from the end of an arc to the tool's centre.
fn end_normal(cutter: Cutter, arc: &ProgrammedArc) -> f64 {
    if cutter.is_inside(arc.turns) { direction(arc.end, arc.centre) } else { direction(arc.centre, arc.end) }
}

/// Returns the end of a straight move, and the connection before it.
///
/// # Errors
/// E1657 when the tool does not fit into the corner.
pub(super) fn to_line(
    cutter: Cutter,
    corner: &CompensationCorner,
    to: Point,
    at: Span,
) -> BlockResult<(Point, CornerKind)> {
    let mut before = direction(corner.programmed, corner.centre);
    let along = direction(corner.programmed, to);
    let mut after = along;
    let quarters = match cutter.side {
        Side::Left => {
            if before < after {
                before = plus_quarters(before, 4, 0.0);
            }
            1
        }
        Side::Right => {
            if after < before {
                after = plus_quarters(after, 4, 0.0);
            }
            -1
        }
    };
    let opening = plus_quarters(if quarters > 0 { before - after } else { after - before }, -1, 0.0);
    let right_angle = plus_quarters(0.0, quarters, 0.0);
    let normal = after + right_angle;
    let end = cutter.offset_point(to, normal);
    // A straight move up from the top of an outer arc: both directions around the corner are possible, and the tool
    // takes the shorter one.
    let turns_back =
        opening > plus_quarters(-SMOOTH, 2, 0.0) && corner.arc.is_some_and(|arc| !cutter.is_inside(arc.turns));
    let kind = if opening < -SMOOTH || opening > plus_quarters(SMOOTH, 2, 0.0) || turns_back {
        CornerKind::Concave(match &corner.arc {
            Some(arc) => arc_to_line(cutter, corner.programmed, arc, along, at)?,
            None => {
                let half = plus_quarters(opening, 2, 0.0) / 2.0;
                if half == 0.0 {
                    return fault(ErrorCode::CompensationCorner, at, "the path turns back into itself at this corner");
                }
                polar(corner.centre, cutter.radius / half.tan(), before + right_angle)
            }
        })
    } else if opening > SMOOTH {
        CornerKind::Convex(cutter.offset_point(corner.programmed, normal))
    } else {
        CornerKind::Smooth
    };
    Ok((end, kind))
}

/// Returns the intersection of a compensated arc with a compensated straight move.
fn arc_to_line(cutter: Cutter, corner: Point, arc: &PriorArc, along: f64, at: Span) -> BlockResult<Point> {
    let across = plus_quarters(along, if arc.turns > 0 { 1 } else { -1 }, 0.0);
    let inside = cutter.is_inside(arc.turns);
    let programmed_radius = if inside { arc.radius + cutter.radius } else { arc.radius - cutter.radius };
    // Distance of the programmed line from the arc's centre, and of the compensated one.
    let from_centre = programmed_radius * (across - direction(corner, arc.centre)).cos();
    let from_centre = if inside { from_centre - cutter.radius } else { from_centre + cutter.radius };
    let angle = ratio(from_centre / arc.radius, at)?.acos();
    let angle = if inside == (arc.turns > 0) { -angle } else { angle };
    Ok(polar(arc.centre, arc.radius, plus_quarters(angle + across, 2, 0.0)))
}

/// Returns the end of an arc, and the connection before it.
///
/// # Errors
/// E1657 when the tool does not fit into the corner, E1659 when it does not fit into the arc.
pub(super) fn to_arc(
    cutter: Cutter,
    corner: &CompensationCorner,
    arc: &ProgrammedArc,
    at: Span,
) -> BlockResult<(Point, CornerKind)> {
    let radius = distance(arc.end, arc.centre);
    check_arc(cutter, radius, arc.turns, at)?;
    let inside = cutter.is_inside(arc.turns);
    let quarters = if cutter.side == Side::Left { -1 } else { 1 };
    let before = plus_quarters(direction(corner.programmed, corner.centre), quarters, 0.0);
    let to_centre = direction(corner.programmed, arc.centre);
    let after = plus_quarters(to_centre, if arc.turns > 0 { -1 } else { 1 }, 0.0);
    let mut opening = if cutter.side == Side::Left { before - after } else { after - before };
    if opening > plus_quarters(0.0, 3, 0.0) {
        opening = plus_quarters(opening, -4, 0.0);
    } else if opening < plus_quarters(0.0, -1, 0.0) {
        opening = plus_quarters(opening, 4, 0.0);
    }
    let end = cutter.offset_point(arc.end, end_normal(cutter, arc));
    let turns_back = plus_quarters(opening, -2, 0.0).abs() < SMOOTH && !inside;
    let kind = if opening < -SMOOTH || opening > plus_quarters(SMOOTH, 2, 0.0) || turns_back {
        CornerKind::Concave(match &corner.arc {
            Some(prior) => arc_to_arc(cutter, prior, arc, radius, at)?,
            None => line_to_arc(cutter, before, opening, arc, radius, at)?,
        })
    } else if opening > SMOOTH {
        let normal = if inside { to_centre } else { plus_quarters(to_centre, 2, 0.0) };
        CornerKind::Convex(cutter.offset_point(corner.programmed, normal))
    } else {
        CornerKind::Smooth
    };
    Ok((end, kind))
}

/// Returns the intersection of a compensated straight move, with direction `before`, and a compensated arc.
fn line_to_arc(
    cutter: Cutter,
    before: f64,
    opening: f64,
    arc: &ProgrammedArc,
    radius: f64,
    at: Span,
) -> BlockResult<Point> {
    let from_centre = times_sine(radius, opening, -1);
    if cutter.is_inside(arc.turns) {
        let radius = radius - cutter.radius;
        let angle = ratio((from_centre + cutter.radius) / radius, at)?.asin();
        return Ok(polar(arc.centre, radius, if arc.turns > 0 { before + angle } else { before - angle }));
    }
    let radius = radius + cutter.radius;
    let angle = ratio((from_centre - cutter.radius) / radius, at)?.asin();
    Ok(polar(arc.centre, radius, plus_quarters(before, 2, if arc.turns > 0 { -angle } else { angle })))
}

/// Returns the intersection of two compensated arcs.
fn arc_to_arc(cutter: Cutter, prior: &PriorArc, arc: &ProgrammedArc, radius: f64, at: Span) -> BlockResult<Point> {
    let radius = if cutter.is_inside(arc.turns) { radius - cutter.radius } else { radius + cutter.radius };
    let between = distance(arc.centre, prior.centre);
    if prior.radius == 0.0 || between == 0.0 {
        return fault(ErrorCode::CompensationCorner, at, "two arcs with a corner between them have the same centre");
    }
    let cosine = (prior.radius * prior.radius + between * between - radius * radius) / (2.0 * prior.radius * between);
    let back = ratio(cosine, at)?.acos();
    let to_centre = direction(prior.centre, arc.centre);
    let forward = cutter.is_inside(prior.turns) == (arc.turns > 0);
    Ok(polar(prior.centre, prior.radius, if forward { to_centre + back } else { to_centre - back }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ORIGIN: Point = (0.0, 0.0);

    fn side() -> impl Strategy<Value = Side> {
        prop_oneof![Just(Side::Left), Just(Side::Right)]
    }

    /// Returns the distance of a point from the line through the origin in a direction, positive on the side of the
    /// tool.
    fn distance_from_line(cutter: Cutter, direction: f64, point: Point) -> f64 {
        let left = direction.cos() * point.1 - direction.sin() * point.0;
        if cutter.side == Side::Left { left } else { -left }
    }

    /// Returns the vector from a point of the path in this direction to the tool's centre.
    fn tool(cutter: Cutter, direction: f64) -> Point {
        let quarter = std::f64::consts::FRAC_PI_2;
        cutter.offset_point(ORIGIN, if cutter.side == Side::Left { direction + quarter } else { direction - quarter })
    }

    /// Returns the centre of an arc that starts or ends at the origin in a direction, and the radius of the tool's path
    /// around it.
    fn arc(cutter: Cutter, direction: f64, radius: f64, turns: i32) -> (Point, f64) {
        let quarter = std::f64::consts::FRAC_PI_2 * f64::from(turns);
        let inside = cutter.is_inside(turns);
        (
            polar(ORIGIN, radius, direction + quarter),
            if inside { radius - cutter.radius } else { radius + cutter.radius },
        )
    }

    proptest! {
        #[test]
        fn two_lines_meet_at_the_radius_from_both(side in side(), radius in 0.1..5.0_f64, from in -3.0..3.0_f64,
            turn in -3.0..3.0_f64) {
            let cutter = Cutter { side, radius };
            let corner = CompensationCorner { programmed: ORIGIN, centre: tool(cutter, from), arc: None };
            let to = polar(ORIGIN, 50.0, from + turn);
            let (end, kind) = to_line(cutter, &corner, to, Span::default()).expect("a corner");
            prop_assert!((distance_from_line(cutter, from + turn, end) - radius).abs() < 1e-9);
            let is_inner = (turn > 0.0) == (side == Side::Left);
            match kind {
                CornerKind::Smooth => prop_assert!(turn.abs() < 0.050_001),
                CornerKind::Convex(point) => {
                    prop_assert!(!is_inner && distance(point, tool(cutter, from + turn)) < 1e-9);
                }
                CornerKind::Concave(point) => {
                    prop_assert!(is_inner);
                    prop_assert!((distance_from_line(cutter, from, point) - radius).abs() < 1e-9);
                    prop_assert!((distance_from_line(cutter, from + turn, point) - radius).abs() < 1e-9);
                }
            }
        }

        #[test]
        fn a_line_and_an_arc_meet_on_both_of_the_tools_paths(
            side in side(), radius in 0.1..5.0_f64, from in -3.0..3.0_f64, turn in -2.9..2.9_f64, size in 5.1..40.0_f64,
            turns in prop_oneof![Just(1), Just(-1)], sweep in 0.5..5.0_f64,
        ) {
            let cutter = Cutter { side, radius };
            let (centre, path) = arc(cutter, from + turn, size, turns);
            let end = polar(centre, size, direction(centre, ORIGIN) + sweep * f64::from(turns));
            let next = ProgrammedArc { centre, end, turns };
            let corner = CompensationCorner { programmed: ORIGIN, centre: tool(cutter, from), arc: None };
            if let Ok((to_centre, kind)) = to_arc(cutter, &corner, &next, Span::default()) {
                prop_assert!((distance(to_centre, centre) - path).abs() < 1e-9
                    && (distance(to_centre, end) - radius).abs() < 1e-9);
                match kind {
                    CornerKind::Smooth => prop_assert!(turn.abs() < 0.050_001),
                    CornerKind::Convex(point) => prop_assert!(distance(point, tool(cutter, from + turn)) < 1e-9),
                    CornerKind::Concave(point) => {
                        prop_assert!((distance_from_line(cutter, from, point) - radius).abs() < 1e-9);
                        prop_assert!((distance(point, centre) - path).abs() < 1e-9);
                    }
                }
            }
            // The same arc in the opposite direction, before a line.
            let (centre, path) = arc(cutter, from, size, turns);
            let prior = PriorArc { centre, radius: path, turns };
            let corner = CompensationCorner { programmed: ORIGIN, centre: tool(cutter, from), arc: Some(prior) };
            if let Ok((_, CornerKind::Concave(point))) = to_line(cutter, &corner, polar(ORIGIN, 9.0, from + turn),
                Span::default()) {
                prop_assert!((distance(point, centre) - path).abs() < 1e-9);
                prop_assert!((distance_from_line(cutter, from + turn, point) - radius).abs() < 1e-8);
            }
            // The same arc before another arc.
            let (other, other_path) = arc(cutter, from + turn, 2.0 * size, -turns);
            let next = ProgrammedArc { centre: other, end: polar(other, 2.0 * size, from), turns: -turns };
            if let Ok((_, CornerKind::Concave(point))) = to_arc(cutter, &corner, &next, Span::default()) {
                prop_assert!((distance(point, centre) - path).abs() < 1e-9);
                prop_assert!((distance(point, other) - other_path).abs() < 1e-7);
            }
        }

        #[test]
        fn the_entry_arc_begins_where_the_tool_is_and_ends_beside_the_path(
            side in side(), radius in 0.1..5.0_f64, size in 5.1..40.0_f64, turns in prop_oneof![Just(1), Just(-1)],
                sweep in 1.0..5.0_f64,
        ) {
            let cutter = Cutter { side, radius };
            let (centre, _) = arc(cutter, 0.3, size, turns);
            let end = polar(centre, size, direction(centre, ORIGIN) + sweep * f64::from(turns));
            if let Ok((to, new_centre)) = entry_arc(cutter, ORIGIN, &ProgrammedArc { centre, end, turns },
                Span::default()) {
                let size = distance(new_centre, to);
                prop_assert!((distance(to, end) - radius).abs() < 1e-9
                    && (distance(new_centre, ORIGIN) - size).abs() < 1e-9 * (1.0 + size));
            }
        }
    }

    #[test]
    fn what_the_tool_does_not_fit_into_is_refused() {
        let cutter = Cutter { side: Side::Left, radius: 1.0 };
        let at = Span::default();
        let code = |outcome: BlockResult<(Point, CornerKind)>| outcome.map_err(|fault| fault.code).err();
        assert_eq!(
            entry_line(cutter, ORIGIN, (1.0, 0.0), at).map_err(|fault| fault.code).err(),
            Some(ErrorCode::CompensationEntry)
        );
        assert!(entry_line(cutter, ORIGIN, (1.001, 0.0), at).is_ok());
        // Through the centre of an arc that is not twice as great as the tool.
        let prior = PriorArc { centre: (0.0, -1.5), radius: 0.5, turns: 1 };
        let corner = CompensationCorner { programmed: ORIGIN, centre: (0.0, -1.0), arc: Some(prior) };
        assert_eq!(code(to_line(cutter, &corner, (0.0, -9.0), at)), Some(ErrorCode::CompensationCorner));
        let next = ProgrammedArc { centre: (0.0, -1.5), end: (1.0, -1.5), turns: -1 };
        assert_eq!(code(to_arc(cutter, &corner, &next, at)), Some(ErrorCode::CompensationCorner));
        let next = ProgrammedArc { centre: (0.0, -1.0), end: (1.0, -1.0), turns: 1 };
        assert_eq!(code(to_arc(cutter, &corner, &next, at)), Some(ErrorCode::CompensationArc));
    }
}
