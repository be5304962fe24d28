//! The nose: the chain of the programmed point for which a round nose touches the contour, and the check that the nose
//! fits.
//!
//! Invariant: the centre of the nose is at least its radius away from every point of the chain, so nothing is cut that
//! must remain.

use super::envelope;
use super::piece::{Bend, Piece, TINY};
use super::{Point, StockRemovalError};

/// Number of points of an element that are tried before it counts as not reached by the nose.
const SAMPLES: u32 = 33;

/// Distance within which an element counts as reached.
const REACHED: f64 = 1e-6;

/// Returns the chain of the programmed point: the contour of the nose's centre, moved from the centre to that point.
///
/// In front of the chain is air at the height of its first point, and behind it land at the height of its last.
pub(super) fn offset(pieces: &[Piece], radius: f64, tip: Point) -> Vec<Piece> {
    let Some((first, last)) = pieces.first().zip(pieces.last()) else { return Vec::new() };
    let reach = Point::new(4.0 * radius, 0.0);
    let mut chain = vec![Piece::straight(first.from.plus(reach), first.from, first.line)];
    chain.extend_from_slice(pieces);
    chain.push(Piece::straight(last.to, last.to.minus(reach), last.line));
    let centres = envelope::upper(&grow(&chain, radius));
    // The ends of the air and of the land behind do not belong to the part: the path does not go around them.
    let (start, end) = (first.from.u + radius, last.to.u - 2.0 * radius);
    let move_by = tip.times(radius);
    let mut path: Vec<Piece> = Vec::with_capacity(centres.len());
    for centre in centres.iter().filter(|centre| centre.from.u > end + TINY && centre.to.u <= start + TINY) {
        let from = if centre.from.u > start { Point::new(start, centre.height(start)) } else { centre.from };
        let to = if centre.to.u < end { Point::new(end, centre.height(end)) } else { centre.to };
        let piece = centre.after(from).until(to);
        if !piece.is_nothing() {
            path.push(piece.shifted(move_by).settled());
        }
    }
    path
}

/// Refuses a contour into which the nose does not fit: every element must be touched somewhere.
pub(super) fn check(pieces: &[Piece], radius: f64) -> Result<(), StockRemovalError> {
    let centres = envelope::upper(&grow(pieces, radius));
    let height = |u: f64| {
        let over = centres.iter().filter(|piece| piece.from.u >= u && piece.to.u <= u && !piece.is_upright());
        over.map(|piece| piece.height(u)).fold(f64::NEG_INFINITY, f64::max)
    };
    let reached = |piece: &&Piece| {
        (1..=SAMPLES).any(|sample| {
            let (at, outward) = piece.sample(f64::from(sample) / f64::from(SAMPLES + 1));
            let centre = at.plus(outward.times(radius + REACHED));
            height(centre.u) <= centre.v + REACHED
        })
    };
    // An element shorter than the tolerance is reached with its neighbours.
    let long = |piece: &&Piece| piece.from.distance(piece.to) > 10.0 * REACHED;
    match pieces.iter().filter(long).find(|piece| !reached(piece)) {
        Some(piece) => Err(StockRemovalError::NoseTooLarge(piece.line)),
        None => Ok(()),
    }
}

/// Returns everything that can be the boundary of the part grown by the nose: elements moved outwards and arcs around
/// the corners.
fn grow(pieces: &[Piece], radius: f64) -> Vec<Piece> {
    let mut grown = Vec::with_capacity(3 * pieces.len() + 4);
    for (number, piece) in pieces.iter().enumerate() {
        grown.extend(outwards(piece, radius));
        let corner = match number.checked_sub(1).map(|before| &pieces[before]) {
            // The free side is on the right: a left turn is a corner to go around, and so is the edge of a blade, up
            // and down again.
            Some(before) => {
                let (arrive, leave) = (before.heading(before.to), piece.heading(piece.from));
                let turn = arrive.cross(leave);
                turn > TINY || (turn > -TINY && arrive.dot(leave) < 0.0 && before.rises())
            }
            None => true,
        };
        if corner {
            around(piece.from, radius, piece.line, &mut grown);
        }
    }
    if let Some(last) = pieces.last() {
        around(last.to, radius, last.line, &mut grown);
    }
    grown
}

fn outwards(piece: &Piece, radius: f64) -> Option<Piece> {
    match piece.bend {
        Bend::Straight => {
            let out = piece.heading(piece.from).rotate_left().times(-radius);
            Some(piece.shifted(out)).filter(|moved| !moved.is_upright())
        }
        Bend::Over { centre, radius: own } => {
            let scale = |point: Point| centre.plus(point.minus(centre).times((own + radius) / own));
            let bend = Bend::Over { centre, radius: own + radius };
            Some(Piece { from: scale(piece.from), to: scale(piece.to), bend, line: piece.line })
        }
        Bend::Under { centre, radius: own } if own - radius > TINY => {
            let scale = |point: Point| centre.plus(point.minus(centre).times((own - radius) / own));
            let bend = Bend::Under { centre, radius: own - radius };
            Some(Piece { from: scale(piece.from), to: scale(piece.to), bend, line: piece.line })
        }
        Bend::Under { .. } => None,
    }
}

/// Adds the upper half of the circle around a point, as two quarters.
fn around(centre: Point, radius: f64, line: u32, into: &mut Vec<Piece>) {
    let bend = Bend::Over { centre, radius };
    let (right, top) = (centre.plus(Point::new(radius, 0.0)), centre.plus(Point::new(0.0, radius)));
    let left = centre.minus(Point::new(radius, 0.0));
    into.push(Piece { from: right, to: top, bend, line });
    into.push(Piece { from: top, to: left, bend, line });
}
