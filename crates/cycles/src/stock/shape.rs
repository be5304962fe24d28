//! The contour in normalised coordinates: machining direction, arcs split at the axis extremes, overhangs refused, the
//! closing wall.
//!
//! Invariant: the pieces are joined exactly, u never grows along them, no wall runs back over another, and the roughed
//! part ends at its largest v.

use std::f64::consts::{FRAC_PI_2, TAU};

use super::frame::Frame;
use super::piece::{Bend, Piece, TINY};
use super::rough::Allowance;
use super::segment::{Arc, Segment};
use super::{Point, StockRemovalError};

/// Maximum number of elements after splitting.
pub(super) const MAX_ELEMENTS: usize = 100;

/// Maximum backward distance of the contour along the cut axis: the error of a quarter circle whose centre has three
/// decimals.
const OVERHANG: f64 = 1e-5;

/// Positions along one axis that differ by less are equal.
const SAME: f64 = 1e-6;

/// The contour, prepared for cutting.
#[derive(Clone, Debug)]
pub(super) struct Shape {
    pub frame: Frame,
    /// The contour itself, joined exactly.
    pub contour: Vec<Piece>,
    /// Part to be roughed: the contour up to a wall that closes it at its largest v.
    pub pieces: Vec<Piece>,
    /// Whether it is machined against the programmed direction.
    pub reversed: bool,
}

impl Shape {
    fn ends(&self) -> (Point, Point) {
        let first = self.pieces.first().map_or(Point::default(), |piece| piece.from);
        (first, self.pieces.last().map_or(first, |piece| piece.to))
    }

    /// Whether a place is inside the blank, whose surface is the contour's highest point.
    pub(super) fn contains(&self, at: Point) -> bool {
        let (first, last) = self.ends();
        last.u + SAME < at.u && at.u < first.u - SAME && at.v < last.v - SAME
    }

    /// Returns the start point of finishing alone: above the contour, in front of where the finishing pass begins.
    pub(super) fn start_of_finishing(&self, allowance: Allowance, lift: f64, with_the_cut: bool) -> Point {
        let (first, last) = self.ends();
        let before = allowance.cut + lift;
        let u = if with_the_cut { first.u + before } else { last.u - before };
        Point::new(u, last.v + allowance.infeed + lift)
    }
}

/// Position of VARI, of four, in which the contour is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Orientation {
    pub face: bool,
    pub inside: bool,
}

/// Returns the shape of a contour.
pub(super) fn normalise(segments: &[Segment], orientation: Orientation) -> Result<Shape, StockRemovalError> {
    let infeed = if orientation.inside { -1.0 } else { 1.0 };
    let mut frame = Frame { face: orientation.face, cut: 1.0, infeed };
    let ends = segments.first().zip(segments.last()).ok_or(StockRemovalError::NoExtent)?;
    let (first, last) = (frame.into(ends.0.start), frame.into(ends.1.end));
    // The cut starts at the deep, open end.
    let reversed = first.v > last.v + SAME;
    let along = if reversed { first.u - last.u } else { last.u - first.u };
    if along.abs() <= SAME {
        return Err(StockRemovalError::NoExtent);
    }
    if along > 0.0 {
        frame.cut = -1.0;
    }
    let mut chain = Chain { pieces: Vec::new(), at: frame.into(if reversed { ends.1.end } else { ends.0.start }) };
    if reversed {
        segments.iter().rev().try_for_each(|segment| chain.take(&segment.reversed(), frame))?;
    } else {
        segments.iter().try_for_each(|segment| chain.take(segment, frame))?;
    }
    let pieces = close(&chain.pieces);
    Ok(Shape { frame, contour: chain.pieces, pieces, reversed })
}

struct Chain {
    pieces: Vec<Piece>,
    at: Point,
}

impl Chain {
    fn take(&mut self, segment: &Segment, frame: Frame) -> Result<(), StockRemovalError> {
        let end = frame.into(segment.end);
        let Some(arc) = segment.arc else {
            return self.push(end, Bend::Straight, segment.line);
        };
        let arc = Arc { centre: frame.into(arc.centre), counterclockwise: arc.counterclockwise != frame.mirrors() };
        let start = frame.into(segment.start);
        let radius = start.distance(arc.centre);
        // Travelling towards -u, counterclockwise is over the centre.
        let bend = if arc.counterclockwise {
            Bend::Over { centre: arc.centre, radius }
        } else {
            Bend::Under { centre: arc.centre, radius }
        };
        for extreme in extremes(arc, start, end, radius).into_iter().flatten() {
            self.push(extreme, bend, segment.line)?;
        }
        self.push(end, bend, segment.line)
    }

    fn push(&mut self, to: Point, bend: Bend, line: u32) -> Result<(), StockRemovalError> {
        let from = self.at;
        if to.u > from.u + OVERHANG {
            return Err(StockRemovalError::Overhang(line));
        }
        // A piece that goes back by less is made upright; one that hardly rises is made flat.
        let steep = to.u > from.u - TINY;
        let bend = if steep { Bend::Straight } else { bend };
        let level = bend == Bend::Straight && (to.v - from.v).abs() <= TINY;
        let to = Point::new(if steep { from.u } else { to.u }, if level { from.v } else { to.v });
        let piece = Piece { from, to, bend, line }.settled();
        if !piece.is_nothing() {
            let over = |last: &Piece| last.is_upright() && piece.is_upright() && last.rises() != piece.rises();
            if self.pieces.last().is_some_and(over) {
                return Err(StockRemovalError::DoublesBack(line));
            }
            self.pieces.push(piece);
            self.at = to;
        }
        if self.pieces.len() > MAX_ELEMENTS { Err(StockRemovalError::TooManyElements) } else { Ok(()) }
    }
}

/// Closes the contour: where it ends below its largest v, a wall leads up to it. The part before the wall is then a
/// relief cut.
fn close(contour: &[Piece]) -> Vec<Piece> {
    let mut pieces = contour.to_vec();
    let top = pieces.iter().map(|piece| piece.from.v.max(piece.to.v)).fold(f64::NEG_INFINITY, f64::max);
    // Between a wall down at the very end and the closing wall there is no space to cut.
    while pieces.len() > 1 && pieces.last().is_some_and(|piece| piece.is_upright() && piece.falls()) {
        pieces.pop();
    }
    if let Some(&Piece { to, line, .. }) = pieces.last().filter(|last| last.to.v < top - TINY) {
        pieces.push(Piece::straight(to, Point::new(to.u, top), line));
    }
    pieces
}

/// Returns the axis extremes that an arc of at most half a turn passes, in order.
fn extremes(arc: Arc, start: Point, end: Point, radius: f64) -> [Option<Point>; 2] {
    const AXES: [Point; 4] = [Point::new(1.0, 0.0), Point::new(0.0, 1.0), Point::new(-1.0, 0.0), Point::new(0.0, -1.0)];
    let whole = arc.sweep(start, end);
    // An extreme this near to an end is that end.
    let near = (0.1 * SAME / radius).min(0.1);
    let out = start.minus(arc.centre);
    let mut found = [None; 2];
    let first = (out.v.atan2(out.u).rem_euclid(TAU) / FRAC_PI_2).floor() as usize;
    let mut place = 0;
    for step in 0..4 {
        let quarter = if arc.counterclockwise { first + 1 + step } else { first + 4 - step };
        let extreme = arc.centre.plus(AXES[quarter % 4].times(radius));
        let swept = arc.sweep(start, extreme);
        if swept > near && swept < whole - near && place < found.len() {
            found[place] = Some(extreme);
            place += 1;
        }
    }
    found
}
