//! What is committed and not emitted, taken back to be planned anew.
//!
//! Invariant: the state at the end of the last record stays what it is, and so do pieces, glides and stops: only how fast the
//! pieces between glides and stops are passed changes.

use std::collections::VecDeque;

use super::{Emitter, PlanItem};
use crate::glide::glide_segment::GlideSegment;
use crate::piece::PathPiece;

impl<const A: usize> Emitter<A> {
    /// Takes back all that is committed and not emitted; [`Emitter::recommit`] puts it back. A span in front then begins in the
    /// state at the end of the last record, or later.
    pub(crate) fn take_back(&mut self) -> VecDeque<PlanItem<A>> {
        if self.time > 0.0
            && let Some(PlanItem::Span { profile, duration, length, .. }) = self.items.front_mut()
        {
            let done = profile.at(self.time).s;
            *profile = profile.cut(self.time).1;
            *duration = profile.duration();
            *length -= done;
            self.piece_start -= done;
            self.time = 0.0;
        }
        std::mem::take(&mut self.items)
    }

    /// Commits what was taken back, planned anew.
    pub(crate) fn recommit(&mut self, items: VecDeque<PlanItem<A>>) {
        self.items = items;
        // A glide or a stop in front was entered already.
        if let Some(PlanItem::Span { .. }) = self.items.front() {
            self.enter();
        }
    }

    /// Where the span in front, or the next one, begins: number of the piece in front, and the way from its start in mm.
    pub(crate) fn front(&self) -> (u64, f64) {
        (self.first_piece, -self.piece_start)
    }

    /// Piece number `number`, if it is not passed.
    pub(crate) fn piece(&self, number: u64) -> Option<&PathPiece<A>> {
        self.pieces.get(usize::try_from(number.checked_sub(self.first_piece)?).ok()?)
    }

    /// The glide that `before` others precede.
    pub(crate) fn glide_after(&self, before: usize) -> Option<&GlideSegment<A>> {
        self.glides.get(before)
    }
}
