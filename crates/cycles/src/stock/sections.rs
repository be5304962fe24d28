//! Sections: the profile without relief cuts, the relief cuts under it, and the levels in which each is cut.
//!
//! Invariant: the profile never falls. Each relief cut is a chain that begins and ends at its rim and is nowhere above
//! it. Levels divide a depth equally, by at most the infeed depth, and the last one is the bottom itself.

use super::piece::{Piece, TINY};
use super::{Point, StockRemovalError};

/// Minimum depth of a relief cut, a hump or a remainder, and minimum width of a relief cut. Smaller ones are left
/// uncut: they are below any machine's resolution.
pub(super) const SHALLOW: f64 = 1e-6;

/// Maximum number of levels of one section.
const MAX_LEVELS: f64 = 10_000.0;

/// Profile and relief cuts of a rough contour.
#[derive(Clone, Debug, Default)]
pub(super) struct Sections {
    /// Running maximum along the cut direction; relief cuts are bridged parallel to the cut axis.
    pub profile: Vec<Piece>,
    /// Relief cuts in cut direction.
    pub reliefs: Vec<Vec<Piece>>,
}

/// Divides a chain into its sections.
pub(super) fn divide(chain: &[Piece]) -> Sections {
    let mut sections = Sections::default();
    let mut open: Option<(Point, Vec<Piece>)> = None;
    for piece in chain {
        match &mut open {
            None if piece.to.v < piece.from.v - TINY => open = Some((piece.from, vec![*piece])),
            None => sections.append_profile(*piece),
            Some((rim, relief)) if piece.to.v < rim.v - TINY => relief.push(*piece),
            Some((rim, relief)) => {
                let close = piece.at_height(rim.v.min(piece.to.v));
                relief.push(piece.until(close));
                sections.bridge(*rim, close, std::mem::take(relief), piece.line);
                sections.append_profile(piece.after(Point::new(close.u, rim.v.min(piece.to.v))));
                open = None;
            }
        }
    }
    if let Some((rim, mut relief)) = open {
        // Not reached by a shape, which ends at its largest v. In any case the relief cut has two sides.
        let end = relief.last().map_or(rim, |piece| piece.to);
        let close = Point::new(end.u, rim.v);
        relief.push(Piece::straight(end, close, 0));
        sections.bridge(rim, close, relief, 0);
    }
    sections
}

impl Sections {
    fn append_profile(&mut self, piece: Piece) {
        if piece.is_nothing() {
            return;
        }
        match self.profile.last_mut() {
            // Land and bridge are one cut.
            Some(last) if last.is_flat() && piece.is_flat() => last.to.u = piece.to.u,
            _ => self.profile.push(piece),
        }
    }

    fn bridge(&mut self, rim: Point, close: Point, relief: Vec<Piece>, line: u32) {
        let bottom = relief.iter().map(|piece| piece.to.v).fold(rim.v, f64::min);
        self.append_profile(Piece::straight(rim, Point::new(close.u, rim.v), line));
        if rim.v - bottom > SHALLOW && rim.u - close.u > SHALLOW {
            self.reliefs.push(relief);
        }
    }
}

/// Returns the levels of a section, from below its top to its bottom: equal steps of at most the infeed depth.
pub(super) fn levels(top: f64, bottom: f64, mid: f64) -> Result<Vec<f64>, StockRemovalError> {
    let depth = top - bottom;
    if depth <= SHALLOW {
        return Ok(Vec::new());
    }
    // A depth that is a whole number of infeeds except for the last digit needs no further level.
    let count = (depth / mid - 1e-9).ceil().max(1.0);
    if count > MAX_LEVELS {
        return Err(StockRemovalError::InfeedDepth);
    }
    let step = depth / count;
    let count = count as u32;
    Ok((1..=count).map(|level| if level == count { bottom } else { top - step * f64::from(level) }).collect())
}
