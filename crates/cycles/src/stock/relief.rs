//! Roughing of relief cuts, level by level: plunge along the falling flank, cut to the rising one, climb it to the
//! previous level.
//!
//! Invariant: rapid moves inside a relief cut stay within the region that its levels have cleared. The part behind an
//! inner hump becomes a pocket of its own, whose top is the last level cut over the hump.

use super::move_writer::MoveWriter;
use super::piece::{Piece, TINY};
use super::sections::{SHALLOW, levels};
use super::{Feed, Point, StockRemovalError};

/// Parameters that all relief cuts of a job share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cutting {
    /// Start point of the cycle.
    pub start: Point,
    /// Maximum infeed depth.
    pub mid: f64,
    /// Lift-off.
    pub lift: f64,
}

/// A hollow to be cleared: a chain from its rim at the height of its top, down, and up again to that height.
struct Pocket {
    top: f64,
    chain: Vec<Piece>,
}

/// Cuts the relief cuts; the tool is at the start point before and after.
pub(super) fn rough(
    writer: &mut MoveWriter,
    reliefs: &[Vec<Piece>],
    cutting: Cutting,
) -> Result<(), StockRemovalError> {
    for relief in reliefs {
        let Some(top) = relief.first().map(|piece| piece.from.v) else { continue };
        // The last one pushed is the nearest along the cut direction.
        let mut waiting = vec![Pocket { top, chain: relief.clone() }];
        while let Some(pocket) = waiting.pop() {
            clear(writer, pocket, cutting, &mut waiting)?;
        }
    }
    writer.rapid_cut_axis(cutting.start.u)
}

fn clear(
    writer: &mut MoveWriter,
    pocket: Pocket,
    cutting: Cutting,
    waiting: &mut Vec<Pocket>,
) -> Result<(), StockRemovalError> {
    let Pocket { top, chain } = pocket;
    let mut chain = without_land(chain, top);
    let bottom = first_bottom(&chain, top);
    let levels = levels(top, bottom, cutting.mid)?;
    if levels.is_empty() {
        return Ok(());
    }
    let lift = cutting.lift;
    let (mut before, mut length) = (top, f64::INFINITY);
    for (number, &level) in levels.iter().enumerate() {
        let Some(Split { descent, floor, climb }) = split(&chain, level) else { break };
        let flank = descent.first().map_or(writer.at(), |piece| piece.from);
        if number == 0 {
            writer.rapid_cut_axis(flank.u)?;
            writer.rapid_infeed_axis(top + lift)?;
        } else {
            // Clear of the falling flank, where the previous level has made space.
            let clear = lift.min(length / 2.0);
            writer.rapid_cut_axis(flank.u - clear)?;
            writer.rapid_infeed_axis(before + clear)?;
        }
        writer.line(Point::new(flank.u, before), Feed::Plunge)?;
        writer.follow(&descent, Feed::Plunge)?;
        let (begin, end) = (writer.at().u, climb.first().map_or(writer.at().u, |piece| piece.from.u));
        length = begin - end;
        writer.cut(end)?;
        let (climb, hump) = up_to_hump(climb);
        writer.follow(&climb, Feed::Rough)?;
        if let Some(behind) = hump {
            waiting.push(pocket_behind_hump(behind, before));
        }
        writer.rapid(writer.at().plus(Point::new(lift.min(length / 2.0), lift)))?;
        chain = floor;
        before = level;
    }
    writer.rapid_infeed_axis(cutting.start.v)
}

/// Returns the chain without the part at the height of the top before it falls.
fn without_land(chain: Vec<Piece>, top: f64) -> Vec<Piece> {
    let land = chain.iter().take_while(|piece| piece.to.v >= top - TINY).count();
    chain.into_iter().skip(land).collect()
}

/// Returns the lowest point before the chain first rises again.
fn first_bottom(chain: &[Piece], top: f64) -> f64 {
    let mut low = top;
    for piece in chain {
        if piece.to.v > low + SHALLOW {
            break;
        }
        low = low.min(piece.to.v);
    }
    low
}

/// A chain divided at a level: down to it, below it, and from where it first rises above it.
struct Split {
    descent: Vec<Piece>,
    floor: Vec<Piece>,
    climb: Vec<Piece>,
}

fn split(chain: &[Piece], level: f64) -> Option<Split> {
    let down = chain.iter().position(|piece| piece.to.v <= level + TINY)?;
    let up = down + chain[down..].iter().position(|piece| piece.to.v > level + TINY)?;
    let (falling, rising) = (&chain[down], &chain[up]);
    let reach = falling.at_height(level.clamp(falling.to.v, falling.from.v.max(falling.to.v)));
    let leave = if rising.from.v >= level { rising.from } else { rising.at_height(level) };
    let mut descent = chain[..down].to_vec();
    descent.push(falling.until(reach));
    let mut floor = vec![falling.after(reach)];
    floor.extend_from_slice(&chain[down + 1..up]);
    floor.push(rising.until(leave));
    floor.retain(|piece| !piece.is_nothing());
    let mut climb = vec![rising.after(leave)];
    climb.extend_from_slice(&chain[up + 1..]);
    Some(Split { descent, floor, climb })
}

/// Splits a climb where it first falls again; returns the part after that hump as well.
fn up_to_hump(climb: Vec<Piece>) -> (Vec<Piece>, Option<Vec<Piece>>) {
    let (mut high, mut peak) = (f64::NEG_INFINITY, 0);
    for (number, piece) in climb.iter().enumerate() {
        if piece.to.v < high - SHALLOW {
            let behind = climb[peak..].to_vec();
            return (climb[..peak].to_vec(), Some(behind));
        }
        if piece.to.v > high + TINY {
            (high, peak) = (piece.to.v, number + 1);
        }
    }
    (climb, None)
}

/// Returns the pocket behind a hump, whose top is the last level cut over it. At the hump's peak it begins with an
/// upright flank.
fn pocket_behind_hump(behind: Vec<Piece>, top: f64) -> Pocket {
    let mut chain = Vec::with_capacity(behind.len() + 1);
    if let Some(first) = behind.first() {
        let flank = Piece::straight(Point::new(first.from.u, top), first.from, first.line);
        chain.extend([flank].into_iter().filter(|flank| !flank.is_nothing()));
    }
    chain.extend(behind);
    Pocket { top, chain }
}
