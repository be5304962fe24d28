//! Output of moves in plane coordinates, from points in normalised ones.
//!
//! Invariant: a move without length is not written, and no path grows beyond [`MAX_MOVES`].

use super::frame::Frame;
use super::piece::{Bend, Piece, TINY};
use super::{Axes, Compensation, Feed, MAX_MOVES, Move, MoveKind, Point, StockRemovalError};

/// Writer of the moves of a path.
#[derive(Debug)]
pub(super) struct MoveWriter {
    frame: Frame,
    /// Distance after which a roughing cut dwells; 0 is never.
    dam: f64,
    at: Point,
    compensation: Compensation,
    moves: Vec<Move>,
}

impl MoveWriter {
    /// Creates a writer at the start point of the cycle. The approach depends on the tool position, so both axes are
    /// always written.
    pub(super) fn at_start(frame: Frame, dam: f64, start: Point, approach: &[Axes]) -> Self {
        let end = frame.out(start);
        let compensation = Compensation::Unchanged;
        let mut moves = Vec::with_capacity(64);
        for &axes in approach {
            let kind = MoveKind::Rapid;
            moves.push(Move { kind, end, centre: end, feed: Feed::Rapid, axes, compensation, dwell_after: false });
        }
        Self { frame, dam, at: start, compensation, moves }
    }

    /// Returns the plane axis of the infeed.
    pub(super) fn infeed_axis(frame: Frame) -> Axes {
        if frame.face { Axes::First } else { Axes::Second }
    }

    /// Returns the plane axis of the cuts.
    pub(super) fn cut_axis(frame: Frame) -> Axes {
        if frame.face { Axes::Second } else { Axes::First }
    }

    pub(super) fn at(&self) -> Point {
        self.at
    }

    pub(super) fn into_moves(self) -> Vec<Move> {
        self.moves
    }

    /// Switches compensation with the next move that is written.
    pub(super) fn compensate(&mut self, compensation: Compensation) {
        self.compensation = compensation;
    }

    pub(super) fn rapid(&mut self, to: Point) -> Result<(), StockRemovalError> {
        self.straight(MoveKind::Rapid, to, Feed::Rapid)
    }

    pub(super) fn rapid_cut_axis(&mut self, u: f64) -> Result<(), StockRemovalError> {
        self.rapid(Point::new(u, self.at.v))
    }

    pub(super) fn rapid_infeed_axis(&mut self, v: f64) -> Result<(), StockRemovalError> {
        self.rapid(Point::new(self.at.u, v))
    }

    pub(super) fn line(&mut self, to: Point, feed: Feed) -> Result<(), StockRemovalError> {
        self.straight(MoveKind::Line, to, feed)
    }

    /// Writes a roughing cut along the cut axis, with a dwell after each section of length DAM but not at its end.
    pub(super) fn cut(&mut self, u: f64) -> Result<(), StockRemovalError> {
        let (from, length) = (self.at, (self.at.u - u).abs());
        if self.dam > 0.0 {
            let stops = ((length - TINY) / self.dam).floor();
            if stops > MAX_MOVES as f64 {
                return Err(StockRemovalError::TooManyMoves);
            }
            for stop in 1..=stops.max(0.0) as u32 {
                let along = (u - from.u).signum() * self.dam * f64::from(stop);
                self.line(Point::new(from.u + along, from.v), Feed::Rough)?;
                if let Some(last) = self.moves.last_mut() {
                    last.dwell_after = true;
                }
            }
        }
        self.line(Point::new(u, from.v), Feed::Rough)
    }

    /// Writes moves along pieces of a chain, in their direction.
    pub(super) fn follow(&mut self, pieces: &[Piece], feed: Feed) -> Result<(), StockRemovalError> {
        for piece in pieces {
            match piece.bend {
                Bend::Straight => self.line(piece.to, feed)?,
                Bend::Over { centre, .. } => self.arc(piece.to, centre, true, feed)?,
                Bend::Under { centre, .. } => self.arc(piece.to, centre, false, feed)?,
            }
        }
        Ok(())
    }

    pub(super) fn arc(
        &mut self,
        to: Point,
        centre: Point,
        counterclockwise: bool,
        feed: Feed,
    ) -> Result<(), StockRemovalError> {
        self.write(self.frame.arc(counterclockwise), to, centre, feed)
    }

    fn straight(&mut self, kind: MoveKind, to: Point, feed: Feed) -> Result<(), StockRemovalError> {
        self.write(kind, to, to, feed)
    }

    fn write(&mut self, kind: MoveKind, to: Point, centre: Point, feed: Feed) -> Result<(), StockRemovalError> {
        let (across, up) = ((to.u - self.at.u).abs() > TINY, (to.v - self.at.v).abs() > TINY);
        let axes = match (across, up) {
            // Compensation is switched with a move that has length.
            (false, false) => return Ok(()),
            (true, false) if kind != MoveKind::Clockwise && kind != MoveKind::Counterclockwise => {
                Self::cut_axis(self.frame)
            }
            (false, true) if kind != MoveKind::Clockwise && kind != MoveKind::Counterclockwise => {
                Self::infeed_axis(self.frame)
            }
            _ => Axes::Both,
        };
        if self.moves.len() >= MAX_MOVES {
            return Err(StockRemovalError::TooManyMoves);
        }
        let compensation = std::mem::replace(&mut self.compensation, Compensation::Unchanged);
        let (end, centre) = (self.frame.out(to), self.frame.out(centre));
        self.moves.push(Move { kind, end, centre, feed, axes, compensation, dwell_after: false });
        self.at = to;
        Ok(())
    }
}
