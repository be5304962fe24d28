//! Roughing without relief cuts: level by level along the cut axis, then along the rough contour to the previous level.
//!
//! Invariant: rapid moves run only in front of the blank or above the region that the previous levels have cleared.

use super::move_writer::MoveWriter;
use super::piece::{Piece, TINY};
use super::{Feed, Point, StockRemovalError};

/// Cuts the section of a profile; the tool is at the start point before and after.
pub(super) fn rough(
    writer: &mut MoveWriter,
    profile: &[Piece],
    levels: &[f64],
    top: f64,
    lift: f64,
) -> Result<(), StockRemovalError> {
    let start = writer.at();
    let mut before = top;
    for &level in levels {
        writer.rapid_infeed_axis(level)?;
        let climb = climb(profile, level, before);
        let Some(first) = climb.first() else { break };
        writer.cut(first.from.u)?;
        writer.follow(&climb, Feed::Rough)?;
        writer.rapid(writer.at().plus(Point::new(lift, lift)))?;
        writer.rapid_cut_axis(start.u)?;
        before = level;
    }
    writer.rapid_infeed_axis(start.v)
}

/// Returns the part of a profile that rises from one height to another, from the last point at the lower to the first
/// at the upper one.
fn climb(profile: &[Piece], from: f64, to: f64) -> Vec<Piece> {
    let mut climb = Vec::new();
    for piece in profile.iter().skip_while(|piece| piece.to.v <= from + TINY) {
        let piece = if climb.is_empty() && piece.from.v < from { piece.after(piece.at_height(from)) } else { *piece };
        if piece.to.v >= to - TINY {
            climb.push(piece.until(piece.at_height(to.min(piece.to.v))));
            break;
        }
        climb.push(piece);
    }
    climb
}
