//! How long frames are made: on a line that loses many, short ones get through more often.
//!
//! Invariant: between the least and the most payload.

/// What words and reports are gathered to at most; an opening may be longer.
const MOST: usize = 200;
/// A head, and an entry or two.
const LEAST: usize = 40;
/// By how much a frame may be longer after one that arrived.
const GROWTH: usize = 8;

/// The longest payload that is worth sending.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameSize(usize);

impl FrameSize {
    /// As long as there is.
    pub(crate) const fn new() -> Self {
        Self(MOST)
    }

    /// Bytes of payload.
    pub(crate) const fn most(self) -> usize {
        self.0
    }

    /// A frame had to be sent again.
    pub(crate) fn lost(&mut self) {
        self.0 = (self.0 / 2).max(LEAST);
    }

    /// What was sent is confirmed.
    pub(crate) fn arrived(&mut self) {
        self.0 = (self.0 + GROWTH).min(MOST);
    }
}
