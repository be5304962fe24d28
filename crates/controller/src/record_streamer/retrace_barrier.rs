//! Barriers to reverse run: the last one counts, and the one before it while the last one is open (REV-8).
//!
//! Invariant: barriers are opened from the last one on, and closed in the opposite order; none is open once another
//! has been set. Nothing is allocated for them on the motion path.

use std::collections::VecDeque;

use retrace_core::RecordIndex;

use super::RecordStreamer;

/// A place before which nothing is reversed to, and the code of the instruction there.
type RetraceBarrier = (RecordIndex, &'static str);

/// Barriers that can be open at a time, and the one before them.
const RETAINED: usize = 257;

/// The last barriers. The first of them is never opened: what was before it is not known.
#[derive(Debug)]
pub(super) struct RetraceBarriers {
    barriers: VecDeque<RetraceBarrier>,
    /// The last ones that the operator has opened, until they are passed again.
    opened: usize,
    /// Whether barriers before the first one were forgotten.
    has_forgotten: bool,
}

impl Default for RetraceBarriers {
    fn default() -> Self {
        Self { barriers: VecDeque::with_capacity(RETAINED), opened: 0, has_forgotten: false }
    }
}

impl RetraceBarriers {
    /// The barrier that counts.
    pub(super) fn last(&self) -> Option<RetraceBarrier> {
        self.barriers.len().checked_sub(self.opened + 1).map(|at| self.barriers[at])
    }

    /// Places of those that are open, the one that was opened last first.
    fn open(&self) -> impl Iterator<Item = RecordIndex> {
        self.barriers.iter().skip(self.barriers.len() - self.opened).map(|(place, _)| *place)
    }

    /// Opens the one that counts. Returns false where there is none, or nothing is known of what was before it.
    fn open_last(&mut self) -> bool {
        let may_open = self.barriers.len() - self.opened > usize::from(self.has_forgotten);
        self.opened += usize::from(may_open);
        may_open
    }

    /// Sets another one. Where there is no space the first is forgotten.
    fn set(&mut self, barrier: RetraceBarrier) {
        self.barriers.truncate(self.barriers.len() - self.opened);
        self.opened = 0;
        if self.barriers.len() == RETAINED {
            self.barriers.pop_front();
            self.has_forgotten = true;
        }
        self.barriers.push_back(barrier);
    }
}

impl<const A: usize> RecordStreamer<'_, A> {
    /// Code of the barrier, if one limits reverse run.
    #[must_use]
    pub fn barrier(&self) -> Option<&'static str> {
        self.barriers.last().filter(|(place, _)| *place == self.oldest()).map(|(_, code)| code)
    }

    /// Sets a barrier before `place`, because of `what`.
    pub fn barrier_before(&mut self, place: RecordIndex, what: &'static str) {
        if self.oldest().is_before(place) {
            self.set_barrier((place, what));
        }
    }

    pub(super) fn set_barrier(&mut self, barrier: RetraceBarrier) {
        self.barriers.set(barrier);
    }

    /// Opens the barrier that counts: reverse run goes on to the one before it. Returns false where it stays.
    pub fn open_barrier(&mut self) -> bool {
        self.barriers.open_last()
    }

    /// Closes the barrier again that was opened last.
    pub fn close_barrier(&mut self) {
        self.barriers.opened = self.barriers.opened.saturating_sub(1);
    }

    /// Opens the barriers behind `place`, as long as they are among `ends`.
    pub(crate) fn open_barriers_behind(&mut self, place: RecordIndex, ends: &[RecordIndex]) {
        let is_behind = |(at, _)| place.is_before(at) && ends.contains(&at);
        while self.barriers.last().is_some_and(is_behind) && self.open_barrier() {}
    }

    /// Whether the barrier before this place is open.
    #[must_use]
    pub fn is_open(&self, place: RecordIndex) -> bool {
        self.barriers.open().any(|at| at == place)
    }

    /// Closes the barriers that were opened and that lie at this place or before it.
    pub fn close_barriers_until(&mut self, place: RecordIndex) {
        while self.barriers.open().next().is_some_and(|at| !place.is_before(at)) {
            self.close_barrier();
        }
    }
}
