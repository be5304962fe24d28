//! The part of the plan that is committed and not emitted, withdrawn to be planned again.
//!
//! Invariant: the state at the end of the last record does not change, nor do pieces, glides and stops; only the speed
//! on the pieces between glides and stops changes.

use std::collections::VecDeque;

use super::{Emitter, PlanItem};
use crate::glide::glide_segment::GlideSegment;
use crate::piece::PathPiece;

impl<const A: usize> Emitter<A> {
    /// Withdraws all items that are committed and not emitted; [`Emitter::recommit`] puts them back. A span in front
    /// then begins in the state at the end of the last record, or later.
    pub(crate) fn withdraw(&mut self) -> VecDeque<PlanItem<A>> {
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

    /// Commits items that were withdrawn and planned again.
    pub(crate) fn recommit(&mut self, items: VecDeque<PlanItem<A>>) {
        self.items = items;
        // A glide or a stop in front was entered already.
        if let Some(PlanItem::Span { .. }) = self.items.front() {
            self.enter();
        }
    }

    /// Start of the front span, or of the next one: number of the front piece, and the distance from its start in mm.
    pub(crate) fn front(&self) -> (u64, f64) {
        (self.first_piece, -self.piece_start)
    }

    /// What is committed and not emitted.
    pub(crate) fn items(&self) -> &VecDeque<PlanItem<A>> {
        &self.items
    }

    /// Piece number `number`, unless it is passed.
    pub(crate) fn piece(&self, number: u64) -> Option<&PathPiece<A>> {
        self.pieces.get(usize::try_from(number.checked_sub(self.first_piece)?).ok()?)
    }

    /// The glide after `before` other glides.
    pub(crate) fn glide_after(&self, before: usize) -> Option<&GlideSegment<A>> {
        self.glides.get(before)
    }
}
