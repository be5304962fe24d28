//! The window as far as the cursor may run: it ends at the place of an instruction that is not executed, and behind a
//! geared stretch that was passed.
//!
//! Invariant: it is never longer than the window below.

use retrace_core::drive::RecordWindow;
use retrace_core::{RapidCap, RecordIndex};

/// Window that begins and ends at a place, if the window below extends further.
pub(crate) struct PlayedWindow<'w, R> {
    window: &'w R,
    low: RecordIndex,
    high: RecordIndex,
}

impl<'w, R> PlayedWindow<'w, R> {
    pub(crate) fn new<const A: usize>(window: &'w R, begin: Option<RecordIndex>, end: Option<RecordIndex>) -> Self
    where
        R: RecordWindow<A>,
    {
        let high = end.filter(|&end| end.is_before(window.high())).unwrap_or(window.high());
        let low = begin.filter(|&begin| window.low().is_before(begin)).unwrap_or(window.low());
        Self { window, low, high }
    }
}

impl<const A: usize, R: RecordWindow<A>> RecordWindow<A> for PlayedWindow<'_, R> {
    fn low(&self) -> RecordIndex {
        self.low
    }

    fn high(&self) -> RecordIndex {
        self.high
    }

    fn rests_at(&self, place: RecordIndex) -> bool {
        self.window.rests_at(place)
    }

    fn cap(&self, place: RecordIndex) -> RapidCap {
        self.window.cap(place)
    }

    fn increments(&self, place: RecordIndex) -> [i16; A] {
        self.window.increments(place)
    }

    fn is_rapid(&self, place: RecordIndex) -> bool {
        self.window.is_rapid(place)
    }
}
