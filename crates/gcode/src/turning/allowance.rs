//! The path at a distance from a profile, on the side of the tool.
//!
//! Invariant: around an outer corner the path is an arc about it; at an inner corner the two neighbours end where they
//! meet.

use super::RoughingError;
use super::frame::{Point, Segment, SegmentArc, TINY};

/// Minimum length of the arc of an outer corner along the profile, in either unit. At smaller corners the neighbours
/// are extended until they meet, if they do.
const MIN_ARC: f64 = 0.01;

/// Returns the segments at `distance` above these. A segment that vanishes at this distance is absorbed: its neighbours
/// end where they meet.
///
/// # Errors
/// [`RoughingError::Allowance`] where nothing remains, or where the profile turns back.
pub(super) fn offset(segments: &[Segment], distance: f64) -> Result<Vec<Segment>, RoughingError> {
    if distance == 0.0 {
        return Ok(segments.to_vec());
    }
    let mut path: Vec<Segment> = Vec::with_capacity(segments.len() * 2);
    // Whether something was absorbed after the last segment of the path.
    let mut has_gap = false;
    for segment in segments {
        match displaced(segment, distance) {
            Some(moved) => has_gap = append(&mut path, moved, segment, has_gap)?,
            None => has_gap = true,
        }
    }
    match (path.is_empty(), segments.last()) {
        (true, Some(last)) => Err(RoughingError::Allowance(last.element)),
        _ => Ok(path),
    }
}

/// Appends a displaced segment to the path; true where it is absorbed itself.
fn append(path: &mut Vec<Segment>, moved: Segment, of: &Segment, mut has_gap: bool) -> Result<bool, RoughingError> {
    while let Some(before) = path.last_mut() {
        let (into, out) = (before.direction(before.to), moved.direction(moved.from));
        let turn = into.cross(out);
        if !has_gap && turn <= 1e-7 {
            let is_blunt = turn < -1e-7 && (moved.from.a - before.to.a).abs() <= MIN_ARC;
            if is_blunt && let Some(meet) = meeting(before, &moved, of.from) {
                before.to = meet;
                path.push(Segment { from: meet, ..moved });
                return Ok(false);
            }
            if turn < -1e-7 {
                let arc = Some(SegmentArc { centre: of.from, counterclockwise: false });
                let from = before.to;
                path.push(Segment { from, to: moved.from, arc, continues: false, element: of.element });
            } else if into.dot(out) < 0.0 {
                return Err(RoughingError::Allowance(of.element));
            }
            break;
        }
        let meet = meeting(before, &moved, of.from);
        let keeps_before = meet.is_some_and(|meet| shortens(&Segment { to: meet, ..*before }, before));
        if let Some(meet) = meet
            && keeps_before
        {
            let moved = Segment { from: meet, ..moved };
            if !shortens_from(&moved, of) {
                return Ok(true);
            }
            before.to = meet;
            path.push(moved);
            return Ok(false);
        }
        path.pop();
        has_gap = true;
    }
    path.push(moved);
    Ok(false)
}

/// Moves a segment to its left; `None` where it vanishes.
fn displaced(segment: &Segment, distance: f64) -> Option<Segment> {
    let shift = |at: Point| at.plus(segment.direction(at).rotate_left(), distance);
    if let Some(arc) = segment.arc
        && arc.counterclockwise
        && segment.from.distance(arc.centre) <= distance + TINY
    {
        return None;
    }
    Some(Segment { from: shift(segment.from), to: shift(segment.to), ..*segment })
}

/// Whether a segment with its end shortened still has its own direction.
fn shortens(short: &Segment, long: &Segment) -> bool {
    match long.arc {
        None => short.to.minus(short.from).dot(long.to.minus(long.from)) >= -TINY,
        Some(_) => long.sweep(short.to) <= long.sweep(long.to) + 1e-7,
    }
}

/// Whether a segment with its beginning shortened still has the direction of the profile's segment.
fn shortens_from(short: &Segment, of: &Segment) -> bool {
    match of.arc {
        None => short.to.minus(short.from).dot(of.to.minus(of.from)) >= -TINY,
        Some(_) => short.sweep(short.to) <= of.sweep(of.to) + 1e-7,
    }
}

/// Returns the intersection of two segments next to a corner.
fn meeting(one: &Segment, other: &Segment, corner: Point) -> Option<Point> {
    let candidates = match (one.arc, other.arc) {
        (None, None) => {
            let (along, across) = (one.to.minus(one.from), other.to.minus(other.from));
            let share = other.from.minus(one.from).cross(across) / along.cross(across);
            [Some(one.from.plus(along, share)), None]
        }
        (None, Some(arc)) => line_and_circle(one, arc.centre, other.from.distance(arc.centre)),
        (Some(arc), None) => line_and_circle(other, arc.centre, one.from.distance(arc.centre)),
        (Some(arc), Some(with)) => {
            let radii = (one.from.distance(arc.centre), other.from.distance(with.centre));
            circles(arc.centre, with.centre, radii)
        }
    };
    let near = |point: &Point| point.distance(corner);
    candidates.into_iter().flatten().filter(|point| near(point).is_finite()).min_by(|p, q| near(p).total_cmp(&near(q)))
}

fn line_and_circle(line: &Segment, centre: Point, radius: f64) -> [Option<Point>; 2] {
    let along = line.to.minus(line.from).unit();
    let foot = line.from.plus(along, centre.minus(line.from).dot(along));
    let rest = radius * radius - foot.distance(centre).powi(2);
    if rest < -TINY {
        return [None, None];
    }
    let half = rest.max(0.0).sqrt();
    [Some(foot.plus(along, half)), Some(foot.plus(along, -half))]
}

fn circles(one: Point, other: Point, (first, second): (f64, f64)) -> [Option<Point>; 2] {
    let apart = one.distance(other);
    if apart < TINY {
        return [None, None];
    }
    let along = other.minus(one).unit();
    let reach = (apart * apart + first * first - second * second) / (2.0 * apart);
    let rest = first * first - reach * reach;
    if rest < -TINY {
        return [None, None];
    }
    let (foot, half) = (one.plus(along, reach), rest.max(0.0).sqrt());
    [Some(foot.plus(along.rotate_left(), half)), Some(foot.plus(along.rotate_left(), -half))]
}
