//! The upper envelope of pieces: the highest piece at each place along the cut axis, and walls where it jumps.
//!
//! Invariant: the envelope is joined exactly, and no given piece is above it by more than [`TINY`] times its slope.

use super::Point;
use super::curve::intersect;
use super::piece::{Piece, TINY};

/// Returns the upper envelope of pieces that cover a range of the cut axis without a gap.
pub(super) fn upper(pieces: &[Piece]) -> Vec<Piece> {
    let mut chain: Vec<Piece> = Vec::new();
    let places = places(pieces);
    for pair in places.windows(2) {
        let middle = f64::midpoint(pair[0], pair[1]);
        let over = pieces.iter().filter(|piece| piece.from.u >= pair[0] - TINY && piece.to.u <= pair[1] + TINY);
        let highest =
            over.filter(|piece| !piece.is_upright()).max_by(|a, b| a.height(middle).total_cmp(&b.height(middle)));
        let Some(piece) = highest else { continue };
        let from = Point::new(pair[0], piece.height(pair[0]));
        let to = Point::new(pair[1], piece.height(pair[1]));
        append(&mut chain, Piece { from, to, ..*piece }.settled());
    }
    chain
}

/// Returns every place where the highest piece may change, in cut direction.
fn places(pieces: &[Piece]) -> Vec<f64> {
    let mut places: Vec<f64> = pieces.iter().flat_map(|piece| [piece.from.u, piece.to.u]).collect();
    for (number, a) in pieces.iter().enumerate() {
        for b in &pieces[number + 1..] {
            let (high, low) = (a.from.u.min(b.from.u), a.to.u.max(b.to.u));
            if high - low > TINY {
                let met = intersect(a.curve(), b.curve()).into_iter().flatten().map(|point| point.u);
                places.extend(met.filter(|u| (low..=high).contains(u)));
            }
        }
    }
    places.sort_by(|a, b| b.total_cmp(a));
    places.dedup_by(|later, kept| *kept - *later <= TINY);
    places
}

/// Appends a piece to the chain: as a longer last piece, joined, or behind a wall.
fn append(chain: &mut Vec<Piece>, mut piece: Piece) {
    let Some(last) = chain.last_mut() else {
        chain.push(piece);
        return;
    };
    close_narrow_dip(last, &mut piece);
    let step = piece.from.v - last.to.v;
    if step.abs() <= TINY {
        let same = last.bend == piece.bend && last.line == piece.line;
        let flats = last.is_flat() && piece.is_flat();
        let arcs = same && !matches!(piece.bend, super::piece::Bend::Straight);
        let both_rise = last.rises() == piece.rises() && last.falls() == piece.falls();
        let straight = last.heading(last.to).cross(piece.heading(piece.from)).abs() <= TINY;
        if flats || (both_rise && (arcs || (same && straight))) {
            last.to = Point::new(piece.to.u, if flats { last.to.v } else { piece.to.v });
            return;
        }
        piece.from = last.to;
        if !piece.is_nothing() {
            if piece.bend == super::piece::Bend::Straight && (piece.to.v - piece.from.v).abs() <= TINY {
                piece.to.v = piece.from.v;
            }
            chain.push(piece);
        }
        return;
    }
    let from = last.to;
    piece.from.u = from.u;
    chain.push(Piece::straight(from, piece.from, piece.line));
    chain.push(piece);
}

/// Joins two pieces at the height of the upper one where the lower one reaches that height within [`TINY`] of the
/// joint.
///
/// Places closer than that are one place, so a crossing beside the upright start of an arc falls on that start. Without
/// this, the envelope would go down to it: by the square root of the radius times twice [`TINY`].
fn close_narrow_dip(last: &mut Piece, piece: &mut Piece) {
    let (ended, begun) = (last.to, piece.from);
    if begun.v < ended.v && piece.to.v >= ended.v {
        if begun.u - piece.at_height(ended.v).u <= TINY {
            piece.from = Point::new(begun.u, ended.v);
        }
    } else if begun.v > ended.v && last.from.v >= begun.v && last.at_height(begun.v).u - ended.u <= TINY {
        last.to.v = begun.v;
    }
}
