//! The rough contour: the part's boundary moved to its free side by the finishing allowances.
//!
//! Invariant: it is the boundary of the part lengthened by the allowance along the cut axis to both sides and raised by
//! the allowance along the infeed axis. It is therefore a chain like the contour, ends at its largest v, and is nowhere
//! below the contour.

use super::Point;
use super::envelope;
use super::piece::{Piece, TINY};

/// Finishing allowances in normalised coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Allowance {
    pub cut: f64,
    pub infeed: f64,
}

/// Returns the rough contour of a shape: each wall is moved towards its free side, tops grow on both sides, floors
/// shrink.
pub(super) fn raise(pieces: &[Piece], allowance: Allowance) -> Vec<Piece> {
    let Allowance { cut, infeed } = allowance;
    let mut raised: Vec<Piece> = Vec::with_capacity(pieces.len() + 2);
    // The front of the part counts as a rising wall.
    let mut side = cut;
    let mut joined = true;
    for (number, piece) in pieces.iter().enumerate() {
        let shift = if piece.is_flat() {
            let ahead = pieces[number + 1..].iter().find(|piece| !piece.is_flat());
            // Behind its end the part is longer by the allowance too.
            ahead.map_or(-cut, |piece| if piece.rises() { cut } else { -cut })
        } else if piece.rises() {
            cut
        } else {
            -cut
        };
        if piece.is_flat() {
            let (from, to) = (piece.from.plus(Point::new(side, infeed)), piece.to.plus(Point::new(shift, infeed)));
            if to.u < from.u {
                raised.push(Piece { from, to, ..*piece });
            }
            joined &= to.u <= from.u;
        } else {
            if shift < side {
                // A top: the land over it is as wide as both allowances.
                let from = piece.from.plus(Point::new(side, infeed));
                raised.push(Piece::straight(from, piece.from.plus(Point::new(shift, infeed)), piece.line));
            }
            joined &= shift <= side;
            raised.push(piece.shifted(Point::new(shift, infeed)));
        }
        side = shift;
    }
    if side > -cut {
        let end = pieces.last().map_or(Point::default(), |piece| piece.to);
        let line = pieces.last().map_or(0, |piece| piece.line);
        let land = |side| end.plus(Point::new(side, infeed));
        raised.push(Piece::straight(land(side), land(-cut), line));
    }
    // Where two walls are closer to each other than both allowances, the valley between them closes up.
    if joined {
        return raised;
    }
    let mut chain = envelope::upper(&raised);
    if let Some((start, first)) = raised.first().zip(chain.first().copied()) {
        // An envelope does not include the front wall below its first point.
        if first.from.v > start.from.v + TINY {
            chain.insert(0, Piece::straight(start.from, first.from, start.line));
        }
    }
    chain
}
